"""Arrays from others: nothing in them is run, and they hold finite numbers of the right shape or are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dmp.errors import RunError
from dmp.runs import Run
from tests.dmp.hostile_runs.damages import array_damages, change_description


@pytest.mark.parametrize(("name", "content"), list(array_damages()), ids=lambda value: value if isinstance(value, str) else "")
def test_arrays_that_are_none_are_refused(
    name: str, content: bytes, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MALICE", str(tmp_path / "harm"))
    (folder / "snapshots" / "000002.npy").write_bytes(content)
    with pytest.raises(RunError):
        Run.open(folder).snapshot(2)
    # Neither the base, whose digest stands in the description, nor where there is no digest.
    (folder / "base.npy").write_bytes(content)
    with pytest.raises(RunError, match="not what was written"):
        Run.open(folder).problem()
    change_description(folder, files={})
    with pytest.raises(RunError, match=r"base\.npy"):
        Run.open(folder).problem()
    assert not (tmp_path / "harm").exists()


def test_a_flipped_bit_of_a_snapshot_is_found(folder: Path) -> None:
    path = folder / "snapshots" / "000002.npy"
    content = path.read_bytes()
    for position in np.random.default_rng(1).integers(0, len(content), 60):
        flipped = bytearray(content)
        flipped[position] ^= 1 << int(position % 8)
        path.write_bytes(flipped)
        with pytest.raises(RunError):
            Run.open(folder).snapshot(2)


def test_other_programs_read_the_snapshots_too(folder: Path) -> None:
    displacement = np.load(folder / "snapshots" / "000002.npy")
    run = Run.open(folder)
    assert np.array_equal(run.problem().base + displacement, run.snapshot(2).vertices)
    # And such as have no digest are read here.
    np.save(folder / "snapshots" / "000002.npy", displacement)
    assert np.array_equal(run.snapshot(2).vertices, run.problem().base + displacement)
