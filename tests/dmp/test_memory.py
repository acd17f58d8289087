"""Memory that there is, and that a training will need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dmp import devices, memory, memory_needs
from dmp.errors import SettingsError
from dmp.memory import free_memory, gigabytes, held_memory, peak_memory
from dmp.memory_needs import check_memory, has_room_for_outputs, memory_needed
from dmp.mesh import TriangleMesh
from dmp.methods import train, training_for
from dmp.problem import denoising
from dmp.settings import settings_for


def _write(folder: Path, **texts: str) -> Path:
    for name, text in texts.items():
        path = folder / name.replace("__", "/").replace("_dot_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def test_the_system_tells_what_is_left(tmp_path: Path) -> None:
    _write(tmp_path, meminfo="MemTotal:  100 kB\nMemFree:   1 kB\nMemAvailable:   70 kB\n")
    assert memory._free_in_system(tmp_path) == 70 * 1024


def test_the_tightest_control_group_counts_and_caches_are_free(tmp_path: Path) -> None:
    proc = _write(tmp_path / "proc", self__cgroup="0::/outer/inner\n")
    root = _write(
        tmp_path / "groups",
        outer__memory_dot_max="5000",
        outer__memory_dot_current="4000",
        outer__memory_dot_stat="anon 1\ninactive_file 300\n",
        outer__inner__memory_dot_max="max",
        outer__inner__memory_dot_current="100",
    )
    assert memory._free_in_groups(proc, root) == 1300
    _write(root, outer__inner__memory_dot_max="350")
    assert memory._free_in_groups(proc, root) == 250


def test_the_older_kind_of_control_group_counts_too(tmp_path: Path) -> None:
    proc = _write(tmp_path / "proc", self__cgroup="9:cpu,cpuacct:/x\n4:memory:/not/here\n")
    root = _write(tmp_path / "groups", memory__memory_dot_limit_in_bytes="9000", memory__memory_dot_usage_in_bytes="2000")
    assert memory._free_in_groups(proc, root) == 7000
    _write(root, memory__memory_dot_limit_in_bytes=str(2**63 - 4096))
    assert memory._free_in_groups(proc, root) is None


def test_numbers_of_this_process_are_plausible() -> None:
    free = free_memory()
    assert free is not None and free > 0
    before = held_memory()
    array = np.ones(20_000_000)
    assert held_memory() - before > 0.9 * array.nbytes
    assert peak_memory() >= before + 0.9 * array.nbytes


def test_sizes_are_said_in_few_digits() -> None:
    assert [gigabytes(value) for value in (12.4e9, 6.04e9, 0.31e9)] == ["12 GB", "6.0 GB", "0.3 GB"]


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    def set_free(gigabytes_free: float) -> None:
        monkeypatch.setattr(memory_needs, "free_memory", lambda: int(gigabytes_free * 1e9))
        monkeypatch.setattr(memory_needs, "held_memory", lambda: 400_000_000)

    return set_free


def test_what_will_not_fit_is_refused_with_numbers_and_a_remedy(free: Callable[[float], None]) -> None:
    free(6)
    check_memory(settings_for("denoise", "compact"), 100_000)
    with pytest.raises(SettingsError, match=r"4,000,000 vertices.*needs about \d+ GB; 6.0 GB are free.*reduce the mesh"):
        check_memory(settings_for("denoise", "paper", device="cpu", precision="float32"), 4_000_000)
    with pytest.raises(SettingsError, match=r"Use --preset compact"):
        check_memory(settings_for("denoise", "paper", device="cpu", precision="float32"), 1_000_000)
    with pytest.raises(SettingsError, match=r"--memory 1 leaves 0.6 GB. Use --memory [12]\.\d or more."):
        check_memory(settings_for("denoise", "compact", memory=1, device="cpu", precision="float32"), 200_000)


def test_a_suggested_bound_and_a_suggested_size_are_accepted(free: Callable[[float], None]) -> None:
    free(6)
    for bound, size in ((1.0, 200_000), (0.0, 5_000_000)):
        settings = settings_for("denoise", "compact", memory=bound, device="cpu", precision="float32")
        with pytest.raises(SettingsError) as caught:
            check_memory(settings, size)
        words = str(caught.value).split()
        if bound:
            check_memory(replace(settings, memory=float(words[words.index("Use") + 2])), size)
        else:
            fitting = int(words[words.index("vertices", 10) - 1].replace(",", ""))
            assert fitting > 100_000
            check_memory(settings, fitting)


def test_a_training_and_its_command_are_refused_before_they_begin(
    noisy_sphere: TriangleMesh, free: Callable[[float], None]
) -> None:
    settings = settings_for("denoise", "compact", device="cpu")
    problem = denoising(noisy_sphere, settings)
    free(0.1)
    with pytest.raises(SettingsError, match="needs about"):
        training_for(problem, settings)


def test_bfloat16_is_taken_by_itself_only_where_it_wins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices, "has_fast_bfloat16", lambda: True)
    taken = [devices.type_between_layers("auto", widest, size) for widest, size in ((512, 100), (128, 14_000), (128, 16_000))]
    assert taken == [torch.bfloat16, torch.float32, torch.bfloat16]
    assert devices.type_between_layers("auto", 64, 10**6) == torch.float32
    assert devices.type_between_layers("bfloat16", 64, 100) == torch.bfloat16
    monkeypatch.setattr(devices, "has_fast_bfloat16", lambda: False)
    assert devices.type_between_layers("auto", 512, 10**6) == torch.float32


def test_a_bound_takes_the_longer_way_to_the_same_result(noisy_sphere: TriangleMesh, free: Callable[[float], None]) -> None:
    size = noisy_sphere.n_vertices
    # In float32 outputs are never kept where there is a product for packed weights.
    settings = settings_for("denoise", "compact", device="cpu", threads=1, steps=5, snapshot_every=5, precision="bfloat16")
    free(100)
    *_, plenty = train(denoising(noisy_sphere, settings), settings)
    between = (memory_needed(settings, size) + memory_needed(settings, size, keep_outputs=False)) / 2
    free(between / 1e9 / 0.9)
    assert not has_room_for_outputs(settings, size)
    *_, bounded = train(denoising(noisy_sphere, settings), settings)
    assert np.array_equal(plenty.vertices, bounded.vertices)
