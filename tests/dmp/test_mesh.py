from __future__ import annotations

import numpy as np
import pytest

from dmp.errors import MeshError
from dmp.mesh import TriangleMesh


def test_arrays_are_copies_that_cannot_be_written() -> None:
    vertices, faces = np.eye(3), np.array([[0, 1, 2]], dtype=np.int32)
    mesh = TriangleMesh(vertices, faces)
    vertices[0, 0] = 7
    assert mesh.vertices[0, 0] == 1
    assert mesh.faces.dtype == np.int64
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 2


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (np.eye(2), [[0, 1, 1]], "shape"),
        (np.eye(3), [[0, 1]], "shape"),
        (np.eye(3), [[0, 1, 3]], "vertices 0 to 2"),
        (np.eye(3), [[0, 1, -1]], "Face 0"),
        ([[0, 0, 0], [1, np.nan, 0], [0, 1, 0]], [[0, 1, 2]], "vertex 1"),
    ],
)
def test_what_makes_no_mesh_is_refused_in_words(vertices: object, faces: object, words: str) -> None:
    with pytest.raises(MeshError, match=words):
        TriangleMesh(np.array(vertices, dtype=float), np.array(faces))


def test_attributes_survive_new_positions_and_must_fit() -> None:
    mesh = TriangleMesh(np.eye(3), np.array([[0, 1, 2]]), {"quality": np.array([1.0, 2, 3])})
    moved = mesh.with_vertices(np.eye(3) * 2)
    assert moved.vertex_attributes["quality"].tolist() == [1, 2, 3]
    assert set(mesh.with_attributes(mask=np.zeros(3)).vertex_attributes) == {"quality", "mask"}
    with pytest.raises(MeshError, match="'mask'"):
        mesh.with_attributes(mask=np.zeros(4))


def test_same_connectivity_looks_at_order() -> None:
    mesh = TriangleMesh(np.eye(3), np.array([[0, 1, 2]]))
    assert mesh.same_connectivity(mesh.with_vertices(np.eye(3) * 3))
    assert not mesh.same_connectivity(TriangleMesh(np.eye(3), np.array([[1, 2, 0]])))
