"""The triangle mesh that every other module works on, and what makes one valid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dmp.errors import MeshError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def read_only(array: ArrayLike, dtype: type) -> NDArray:
    """Return a C-contiguous copy of ``array`` as ``dtype`` that cannot be written to."""
    copy: NDArray = np.array(array, dtype=dtype, order="C")
    copy.flags.writeable = False
    return copy


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A triangle mesh with immutable arrays.

    Attributes:
        vertices: positions, (V, 3) float64, in the units of the file, finite.
        faces: vertex indices of each triangle, (F, 3) int64, 0 <= index < V.
        vertex_attributes: further values per vertex that a file carries, such as colours or a displacement, by name;
            each array has V rows, (V,) or (V, k), and survives to the output.

    Raises:
        MeshError: when a shape, an index or a coordinate is not as described above. Vertices without a face, faces
            without an area and edges with more than two faces are allowed here; see :func:`dmp.problem.check_trainable`.
    """

    vertices: FloatArray
    faces: IntArray
    vertex_attributes: Mapping[str, NDArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        vertices = read_only(self.vertices, np.float64)
        faces = read_only(self.faces, np.int64)
        if vertices.ndim != 2 or vertices.shape[1] != 3:
            raise MeshError(f"The vertices of a mesh must have shape (V, 3), not {vertices.shape}.")
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise MeshError(f"The faces of a mesh must have shape (F, 3), not {faces.shape}.")
        bad_rows = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
        if bad_rows.size:
            raise MeshError(
                f"{bad_rows.size} of {len(vertices)} vertices have a coordinate that is not a finite number "
                f"(the first is vertex {bad_rows[0]})."
            )
        if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
            bad_face = int(np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))[0])
            raise MeshError(
                f"Face {bad_face} refers to vertices {faces[bad_face].tolist()}, "
                f"but the mesh has vertices 0 to {len(vertices) - 1}."
            )
        attributes: dict[str, NDArray] = {}
        for name, values in self.vertex_attributes.items():
            copy = np.array(values)
            copy.flags.writeable = False
            if copy.ndim not in (1, 2) or len(copy) != len(vertices):
                raise MeshError(
                    f"The vertex attribute '{name}' has shape {copy.shape}; it needs {len(vertices)} rows, one for each vertex."
                )
            attributes[name] = copy
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "vertex_attributes", MappingProxyType(attributes))

    @property
    def n_vertices(self) -> int:
        """Number of vertices, V."""
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        """Number of triangles, F."""
        return len(self.faces)

    def with_vertices(self, vertices: ArrayLike) -> TriangleMesh:
        """Return the same connectivity and attributes with other positions, (V, 3)."""
        positions = np.asarray(vertices, dtype=np.float64)
        if positions.shape != self.vertices.shape:
            raise MeshError(f"Expected {self.vertices.shape} positions, got {positions.shape}.")
        return replace(self, vertices=positions)

    def with_attributes(self, **attributes: ArrayLike) -> TriangleMesh:
        """Return the mesh with vertex attributes added or replaced."""
        merged = {**self.vertex_attributes, **{name: np.asarray(values) for name, values in attributes.items()}}
        return replace(self, vertex_attributes=merged)

    def same_connectivity(self, other: TriangleMesh) -> bool:
        """Tell whether both meshes have the same number of vertices and the same faces in the same order."""
        return self.n_vertices == other.n_vertices and np.array_equal(self.faces, other.faces)
