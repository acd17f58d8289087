"""Every kind of broken or odd file that is known to upset readers, and every one that ever upset ours."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from dmp.meshio import READABLE_SUFFIXES
from tests.dmp.formats.broken_files import Broken, broken_files
from tests.soak.broken import check
from tests.soak.reading import SECONDS, Mesh, left_mesh
from tests.soak.reading_child import answer

FILES = list(broken_files())


def read_here(path: Path) -> tuple[dict[str, Any], Mesh | None]:
    told = answer(path)
    assert told["seconds"] < SECONDS, path
    return told, left_mesh(path.parent) if told["outcome"] == "read" else None


@pytest.mark.parametrize("part", range(10))
def test_broken_files_are_refused_in_words_and_odd_ones_read(tmp_path: Path, part: int) -> None:
    total, failures = check(tmp_path, read_here, FILES[part::10])
    assert not failures
    assert total > 50


def test_the_check_itself_notices_what_is_wrong(tmp_path: Path) -> None:
    name, content, _, origin = next(file for file in FILES if file[2] == "same" and file[3])
    other = next(file[1] for file in FILES if file[0] == "found_solid_header.stl")
    wrong: list[Broken] = [
        (name, content, "refused", origin),
        ("refused.ply", b"ply\n", "same", origin),
        ("other.stl", other, "same", "written.obj"),
        ("other.stl", other, "told", "written.obj"),
    ]
    assert check(tmp_path, read_here, wrong)[0] == len(wrong) == len(check(tmp_path, read_here, wrong)[1])


def test_the_files_have_names_of_their_own_and_cover_every_format() -> None:
    names = Counter(name for name, *_ in FILES)
    assert max(names.values()) == 1
    expected = Counter((Path(name).suffix.lower(), expected) for name, _, expected, _ in FILES)
    for suffix in READABLE_SUFFIXES:
        assert expected[suffix, "refused"] > 20
        assert expected[suffix, "same"] > 1
