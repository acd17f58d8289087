"""How close a completed region is to the true surface, whose vertices and faces are others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmp.geometry import face_normals
from dmp.mesh import BoolArray, FloatArray, IntArray, TriangleMesh
from dmp.surface_distance import nearest_on_surface


@dataclass(frozen=True, eq=False)
class HoleTruth:
    """A complete mesh in the place of the input, to measure inserted vertices and faces by.

    Attributes:
        mesh: the true surface, in the file's units and place; nothing is aligned.
        inserted: indices of the inserted vertices, (N,).
        faces: faces with an inserted vertex, (M, 3).
        edge_length: mean edge length of the input, file units.
    """

    mesh: TriangleMesh
    inserted: IntArray
    faces: IntArray
    edge_length: float

    @property
    def source(self) -> TriangleMesh:
        """The true surface as it was given."""
        return self.mesh

    @classmethod
    def for_filled(cls, truth: TriangleMesh, filled: TriangleMesh, known: BoolArray, edge_length: float) -> HoleTruth:
        """Prepare to measure the inserted part of ``filled``, whose original vertices are ``known`` (V,)."""
        return cls(truth, np.flatnonzero(~known), filled.faces[(~known)[filled.faces].any(axis=1)], edge_length)

    def measures(self, vertices: FloatArray) -> dict[str, float]:
        """Return the measures of predicted positions, (V, 3), file units.

        ``hole_distance`` is the mean distance of the inserted vertices to the true surface, in mean edge lengths;
        ``hole_normal_error`` the mean angle between the normals of the inserted faces and the true surface nearest to
        their centres, in degrees.
        """
        distance, _ = nearest_on_surface(vertices[self.inserted], self.mesh)
        _, nearest = nearest_on_surface(vertices[self.faces].mean(axis=1), self.mesh)
        normals = face_normals(vertices, self.faces)
        true_normals = face_normals(self.mesh.vertices, self.mesh.faces[nearest])
        cosines = np.clip(np.einsum("fc,fc->f", normals, true_normals), -1.0, 1.0)
        return {
            "hole_distance": float(distance.mean()) / self.edge_length,
            "hole_normal_error": float(np.degrees(np.arccos(cosines)).mean()),
        }
