"""How far a mesh is from a reference with the same connectivity: angles between normals, distances of vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmp.errors import MeshError
from dmp.geometry import face_normals, mean_edge_length
from dmp.mesh import FloatArray, IntArray, TriangleMesh
from dmp.topology import unique_edges


def angular_differences(vertices: FloatArray, reference_normals: FloatArray, faces: IntArray) -> FloatArray:
    """Return the angle between each face's normal and its reference, (F,), in degrees.

    A face without area has no normal; it counts with 90 degrees.
    """
    cosines = np.einsum("fc,fc->f", face_normals(np.asarray(vertices, dtype=np.float64), faces), reference_normals)
    return np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))


def mean_angular_difference(vertices: FloatArray, reference_vertices: FloatArray, faces: IntArray) -> float:
    """Return the MAD in degrees: the unweighted mean over faces of arccos(n . n_reference) (paper, section 4)."""
    return float(angular_differences(vertices, face_normals(reference_vertices, faces), faces).mean())


@dataclass(frozen=True)
class Alignment:
    """A scale and a shift, ``scale * x + shift``, without rotation."""

    scale: float
    shift: FloatArray

    def apply(self, positions: FloatArray) -> FloatArray:
        """Return the moved positions, (V, 3)."""
        return self.scale * positions + self.shift


def align(reference: FloatArray, target: FloatArray) -> Alignment:
    """Return scale and shift that bring ``reference`` closest to ``target`` in the least-squares sense.

    Meshes of published experiments were scaled one by one, noise and truth separately; vertex distances mean something
    only after this. Noise in ``target`` does not bias the fit.
    """
    reference_centre, target_centre = reference.mean(axis=0), target.mean(axis=0)
    centred = reference - reference_centre
    variance = float((centred**2).sum())
    scale = float((centred * (target - target_centre)).sum()) / variance if variance > 0 else 1.0
    return Alignment(scale, target_centre - scale * reference_centre)


@dataclass(frozen=True, eq=False)
class GroundTruth:
    """A clean mesh to compare with, moved to where the input lies.

    Attributes:
        source: the clean mesh as it was given.
        mesh: the same in the place and scale of the input.
        alignment: what moved it there.
        normals: its face normals, (F, 3).
        edge_length: its mean edge length h after the move, file units.
    """

    source: TriangleMesh
    mesh: TriangleMesh
    alignment: Alignment
    normals: FloatArray
    edge_length: float

    @classmethod
    def for_input(cls, truth: TriangleMesh, noisy: TriangleMesh) -> GroundTruth:
        """Align ``truth`` to ``noisy``.

        Raises:
            MeshError: when the two do not share their faces.
        """
        if not truth.same_connectivity(noisy):
            raise MeshError(
                f"The ground truth has {truth.n_vertices} vertices and {truth.n_faces} faces, the mesh has {noisy.n_vertices} "
                f"and {noisy.n_faces}, and they must be the same faces in the same order. Choose the clean version of this "
                "very mesh."
            )
        alignment = align(truth.vertices, noisy.vertices)
        moved = truth.with_vertices(alignment.apply(truth.vertices))
        return cls(
            source=truth,
            mesh=moved,
            alignment=alignment,
            normals=face_normals(moved.vertices, moved.faces),
            edge_length=mean_edge_length(moved.vertices, unique_edges(moved.faces)),
        )

    def mad(self, vertices: FloatArray) -> float:
        """Return the mean angular difference to the truth, degrees."""
        return float(angular_differences(vertices, self.normals, self.mesh.faces).mean())

    def vertex_error(self, vertices: FloatArray) -> float:
        """Return the mean distance of the vertices to their true places, in mean edge lengths of the truth."""
        return float(np.linalg.norm(vertices - self.mesh.vertices, axis=1).mean()) / self.edge_length

    def measures(self, vertices: FloatArray) -> dict[str, float]:
        """Return ``mad`` and ``vertex_error`` of positions in file units."""
        return {"mad": self.mad(vertices), "vertex_error": self.vertex_error(vertices)}
