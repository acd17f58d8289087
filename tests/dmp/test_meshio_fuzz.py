"""Thousands of small injuries to good files: each is read as a valid mesh or refused in a sentence, quickly.

``DMP_FUZZ`` sets the number of injured files of each kind (150 unless set), ``DMP_FUZZ_SEED`` another seed.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dmp.errors import MeshFileError
from dmp.meshio import read_mesh_with_notes
from tests.dmp.formats.files import ply_header
from tests.dmp.test_meshio import SAMPLES

N_FILES = int(os.environ.get("DMP_FUZZ", "150"))
SEED = int(os.environ.get("DMP_FUZZ_SEED", "20210401"))

NASTY = [
    *(
        b"nan",
        b"inf",
        b"-1",
        b"0",
        b"1e999",
        b"-1e-400",
        b"4294967295",
        b"-2147483648",
        b"9223372036854775807",
        b"99999999999999999999",
    ),
    *(
        b"1,5",
        b"0x1F",
        b"1_000",
        b"",
        b" ",
        b"\n",
        b"\r",
        b"\\\n",
        b"\0",
        b"\xff\xfe",
        b"\xef\xbb\xbf",
        b"#",
        b"/",
        b"//",
        b"-",
        b".",
    ),
    *(
        b"v",
        b"f",
        b"end_header\n",
        b"element vertex 3\n",
        b"property list int int x\n",
        b"OFF\n",
        b"solid ",
        b"endsolid\n",
        b"ply\n",
    ),
]

Injury = Callable[[bytearray, np.random.Generator], bytearray]


def flip_bits(content: bytearray, rng: np.random.Generator) -> bytearray:
    for _ in range(rng.integers(1, 5)):
        content[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
    return content


def flip_bits_of_the_head(content: bytearray, rng: np.random.Generator) -> bytearray:
    content[rng.integers(min(300, len(content)))] ^= 1 << int(rng.integers(8))
    return content


def cut(content: bytearray, rng: np.random.Generator) -> bytearray:
    return content[: rng.integers(len(content))]


def delete(content: bytearray, rng: np.random.Generator) -> bytearray:
    start = int(rng.integers(len(content)))
    del content[start : start + int(rng.integers(1, 60))]
    return content


def repeat(content: bytearray, rng: np.random.Generator) -> bytearray:
    start, target = rng.integers(len(content), size=2)
    content[target:target] = content[start : start + int(rng.integers(1, 200))]
    return content


def zero(content: bytearray, rng: np.random.Generator) -> bytearray:
    start = int(rng.integers(len(content)))
    length = min(int(rng.integers(1, 500)), len(content) - start)
    content[start : start + length] = bytes(length)
    return content


def noise(content: bytearray, rng: np.random.Generator) -> bytearray:
    start = int(rng.integers(len(content)))
    length = min(int(rng.integers(1, 30)), len(content) - start)
    content[start : start + length] = rng.bytes(length)
    return content


def insert_something_nasty(content: bytearray, rng: np.random.Generator) -> bytearray:
    start = int(rng.integers(len(content)))
    content[start : start + int(rng.integers(0, 6))] = NASTY[rng.integers(len(NASTY))]
    return content


def replace_a_word(content: bytearray, rng: np.random.Generator) -> bytearray:
    words = content.split(b" ")
    words[rng.integers(len(words))] = bytearray(NASTY[rng.integers(len(NASTY))])
    return bytearray(b" ".join(words))


def shuffle_lines(content: bytearray, rng: np.random.Generator) -> bytearray:
    lines = content.split(b"\n")
    first, second = rng.integers(len(lines), size=2)
    lines[first], lines[second] = lines[second], lines[first]
    return bytearray(b"\n".join(lines))


INJURIES: list[Injury] = [
    *(flip_bits, flip_bits_of_the_head, cut, delete, repeat, zero, noise),
    *(insert_something_nasty, replace_a_word, shuffle_lines),
]


def more_samples() -> dict[str, bytes]:
    """Files with everything that a format can hold."""
    return {
        "rich.obj": b"mtllib a.mtl\no a\n"
        + b"".join(b"v %d %d %d 0.5 0.5 1\nvt 0 %d\n" % (i, i * i % 7, i * 3 % 5, i) for i in range(12))
        + b"g b\ns 1\nf 1/1 2/2 3/3\nf -1//1 -2//1 -3//1 -5//1\nf 4 5 6 \\\n7 8\nl 1 2\nf 9/1/1 10/1/1 11/1/1\n",
        "rich.off": b"STCNOFF # all\n4 2 0\n"
        + b"".join(b"%d %d %d 0 0 1 255 %d 0 255 0.5 0.5\n" % (i, i * i, i % 3, i) for i in range(4))
        + b"3 0 1 2 1 0 0\n3 0 2 3\n",
        "rich.ply": ply_header(
            "ascii", 4, 2, "uchar red;uchar green;uchar blue;list uchar int n", "list uchar float w;int id"
        ).encode()
        + b"0 0 0 1 2 3 2 5 5\n1 0 0 1 2 3 0\n1 1 0 1 2 3 1 7\n0 1 0 1 2 3 0\n3 0 1 2 1 0.5 7\n3 0 2 3 0 9\n",
    }


ALL = {**SAMPLES, **more_samples()}


@pytest.mark.parametrize("name", ALL)
def test_injured_files_are_read_as_valid_meshes_or_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    n_read = 0
    for index in range(N_FILES):
        rng = np.random.default_rng([SEED, index, *name.encode()])
        content = bytearray(ALL[name])
        for _ in range(int(rng.integers(1, 3))):
            if content:
                content = INJURIES[rng.integers(len(INJURIES))](content, rng)
        path.write_bytes(content)
        start = time.perf_counter()
        try:
            mesh, notes = read_mesh_with_notes(path)
        except MeshFileError as error:
            # A refusal has a cause of its own; one that a reader did not foresee tells the class of the error.
            assert "the file cannot be read (" not in str(error), (index, error)
        else:
            # TriangleMesh itself refuses coordinates that are not finite and indices out of range.
            n_read += 1
            assert mesh.n_faces > 0
            assert np.isin(np.arange(mesh.n_vertices), mesh.faces).all()
            assert all(note.endswith(".") for note in notes)
        assert time.perf_counter() - start < 5, index
    # Neither a reader that refuses everything nor one that takes everything would pass.
    assert 0 < n_read < N_FILES
