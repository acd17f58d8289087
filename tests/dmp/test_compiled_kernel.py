"""Compiling, keeping and launching of kernels."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from dmp.compiled import kernel as compiling
from dmp.compiled.__main__ import all_kernels
from dmp.compiled.kernel import Kernel, kernel
from dmp.compiled.launching import launch
from dmp.compiled.pointers import floats as rows
from dmp.compiled.pointers import take_next
from dmp.compiled.vectors import load, store


def _double(job):  # type: ignore[no-untyped-def]
    # Values, their number: doubles those of each part.
    values, count = rows(job[2]), job[3]
    while True:
        part = take_next(job)
        if part >= job[1]:
            break
        for place in range(part * count // job[1], (part + 1) * count // job[1]):
            store(values, place, load(values, place) + load(values, place))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where compiled kernels are kept in this test."""
    monkeypatch.setattr(compiling, "_FOLDER", tmp_path / "kernels")
    return tmp_path / "kernels"


@pytest.fixture
def three_threads() -> Iterator[None]:
    """Three threads for torch and for the kernels."""
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    yield
    torch.set_num_threads(before)


def _works(made: Kernel, dtype: torch.dtype = torch.float32) -> bool:
    values = torch.arange(1, 101, dtype=torch.float32).to(dtype)
    launch(made.of(dtype), (values.data_ptr(), len(values)), parts=7)
    return torch.equal(values, 2 * torch.arange(1, 101, dtype=torch.float32).to(dtype))


def test_every_part_is_done_once_whatever_the_number_of_threads(folder: Path, three_threads: None) -> None:
    made = kernel(_double)
    assert all(_works(made) for _ in range(200))
    torch.set_num_threads(1)
    assert _works(made)


def test_rows_of_either_type_are_kept_apart_and_found_again(folder: Path) -> None:
    assert _works(kernel(_double)) and _works(kernel(_double), torch.bfloat16)
    kept = {path: path.stat().st_mtime_ns for path in folder.rglob("*.nbc")}
    assert len(kept) == 2
    again = kernel(_double)
    assert _works(again, torch.bfloat16) and _works(again)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.nbc")} == kept


@pytest.mark.parametrize("suffix", ["nbc", "nbi"])
@pytest.mark.parametrize("content", [b"", b"\x80\x05 no pickle", b"half"])
def test_a_damaged_file_of_a_kernel_is_replaced(folder: Path, suffix: str, content: bytes) -> None:
    assert _works(kernel(_double))
    (path,) = folder.rglob(f"*.{suffix}")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if content == b"half" else content)
    assert _works(kernel(_double))
    assert _works(kernel(_double))


def test_where_nothing_can_be_kept_kernels_work_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a file").touch()
    monkeypatch.setattr(compiling, "_FOLDER", tmp_path / "a file" / "kernels")
    assert _works(kernel(_double))


def test_a_change_of_the_sources_leads_to_another_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("kernel.py", "pointers.py"):
        (tmp_path / name).write_text("one = 1\n")
    monkeypatch.setattr(compiling, "__file__", str(tmp_path / "kernel.py"))
    before = compiling._folder()
    assert compiling._folder() == before
    (tmp_path / "pointers.py").write_text("one = 2\n")
    assert compiling._folder() != before


def test_the_folder_can_be_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert compiling._folder().is_relative_to(tmp_path)


def test_all_kernels_can_be_compiled_beforehand() -> None:
    addresses = [made.address for made in all_kernels()]
    assert len(set(addresses)) == len(addresses) > 20
    assert np.all(np.array(addresses) != 0)
