"""A run from others uses nothing outside its folder, and no more memory than an honest one, which is usable."""

from __future__ import annotations

import os
import resource
import sys
import threading
from pathlib import Path
from typing import Any

from dmp.runs import Run, record
from tests.dmp.hostile_runs.damages import array_damages, change_description, use_everything, use_or_refuse


def test_an_honest_run_is_usable(folder: Path) -> None:
    use_everything(folder)
    assert Run.open(folder).warnings == []


_watched: list[str] | None = None


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    # Other threads have nothing to do with it.
    if _watched is not None and event == "open" and threading.current_thread() is threading.main_thread():
        _watched.append(os.fsdecode(arguments[0]) if isinstance(arguments[0], (str, bytes, os.PathLike)) else "")


def test_no_path_outside_the_folder_is_opened(folder: Path, tmp_path: Path) -> None:
    global _watched  # noqa: PLW0603
    outside = tmp_path / "elsewhere.ply"
    outside.write_bytes(b"ply\n")
    change_description(folder, input={"path": str(outside)}, ground_truth={"path": str(outside)})
    use_or_refuse(folder)  # so that all modules are loaded
    sys.addaudithook(_watch)
    _watched = []
    try:
        from dmp_viewer.tasks import open_run

        opened = open_run(folder)
        use_everything(folder)
        list(record(opened.run.resume(), opened.run))
    finally:
        seen, _watched = _watched, None
    assert any(name.endswith("input.ply") for name in seen)
    assert str(outside) not in seen
    foreign = [name for name in seen if str(tmp_path) in name and not name.startswith(str(folder))]
    assert foreign == []


def test_little_memory_is_enough_for_great_claims(folder: Path) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for content in (content for _, content in array_damages()):
        (folder / "base.npy").write_bytes(content)
        (folder / "input.ply").write_bytes(
            b"ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty double x\nproperty double y\n"
            b"property double z\nelement face 2000000000\nproperty list uchar int vertex_indices\nend_header\n" + content
        )
        use_or_refuse(folder)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB
