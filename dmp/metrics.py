"""How far a mesh is from a reference: angles between normals, distances of vertices, distances between surfaces.

Angles are in degrees, distances in mean edge lengths of the reference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmp.errors import MeshError
from dmp.geometry import face_areas, face_normals, mean_edge_length
from dmp.mesh import BoolArray, FloatArray, IntArray, TriangleMesh
from dmp.surface_distance import distance_to_surface
from dmp.topology import connected_vertices, unique_edges


def angular_differences(vertices: FloatArray, reference_normals: FloatArray, faces: IntArray) -> FloatArray:
    """Return the angle between each face's normal and its reference, (F,), in degrees.

    A face without area has no normal; it counts with 90 degrees.
    """
    cosines = np.einsum("fc,fc->f", face_normals(np.asarray(vertices, dtype=np.float64), faces), reference_normals)
    return np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))


def mean_angular_difference(vertices: FloatArray, reference_vertices: FloatArray, faces: IntArray) -> float:
    """Return the MAD in degrees: the unweighted mean over faces of arccos(n . n_reference) (paper, section 4)."""
    return float(angular_differences(vertices, face_normals(reference_vertices, faces), faces).mean())


def surface_measures(mesh: TriangleMesh, reference: TriangleMesh) -> dict[str, float]:
    """Return the distances between two surfaces as they lie; they need not have the same faces.

    From each vertex of the one the way to the nearest point on the triangles of the other is measured; vertices without
    a face belong to no surface. As maxima are taken over vertices, a bulge in the middle of a large triangle is missed.

    Returns:
        ``surface_distance``, ``surface_distance_rms`` and ``surface_distance_max``: mean, root mean square and maximum over
        the vertices of ``mesh``; the same with ``surface_distance_back`` over those of ``reference``; ``hausdorff``, the
        larger of the two maxima; all in mean edge lengths of ``reference``.

    Raises:
        MeshError: when one of them has no faces, or the reference no edge of any length.
    """
    edge_length = reference_edge_length(reference)
    values = {}
    for name, start, end in (("surface_distance", mesh, reference), ("surface_distance_back", reference, mesh)):
        on_surface = start.vertices[np.unique(start.faces)]
        if not len(on_surface):
            raise MeshError("The mesh has no faces, so it has no surface to measure from.")
        distances = distance_to_surface(on_surface, end) / edge_length
        values[name] = float(distances.mean())
        values[f"{name}_rms"] = _root_mean_square(distances)
        values[f"{name}_max"] = float(distances.max())
    return {**values, "hausdorff": max(values["surface_distance_max"], values["surface_distance_back_max"])}


def _root_mean_square(values: FloatArray) -> float:
    return float(np.sqrt((values**2).mean()))


def reference_edge_length(reference: TriangleMesh) -> float:
    """Return the mean edge length of a mesh to compare with, the unit of all distances here.

    Raises:
        MeshError: when it has no edge of any length.
    """
    edges = unique_edges(reference.faces)
    length = mean_edge_length(reference.vertices, edges) if len(edges) else 0.0
    if length == 0:
        raise MeshError("The mesh to compare with has no edge of any length, so distances have no unit. Choose another one.")
    return length


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
            MeshError: when the two do not share their faces, or the truth has no edge of any length.
        """
        if not truth.same_connectivity(noisy):
            raise MeshError(
                f"The ground truth has {truth.n_vertices} vertices and {truth.n_faces} faces, the mesh has {noisy.n_vertices} "
                f"and {noisy.n_faces}, and they must be the same faces in the same order. Choose the clean version of this "
                "very mesh."
            )
        # Isolated vertices belong to no surface; one that lies far away would decide the alignment alone.
        used = connected_vertices(noisy.faces, noisy.n_vertices)
        alignment = align(truth.vertices[used], noisy.vertices[used])
        moved = truth.with_vertices(alignment.apply(truth.vertices))
        return cls(
            source=truth,
            mesh=moved,
            alignment=alignment,
            normals=face_normals(moved.vertices, moved.faces),
            edge_length=reference_edge_length(moved),
        )

    def restricted(self, vertices: IntArray, faces: IntArray, kept_faces: BoolArray) -> GroundTruth:
        """Return the truth of a part of the mesh, aligned as the whole is.

        Args:
            vertices: indices of the vertices in the part, (v,).
            faces: its faces in numbers of its own vertices, (f, 3).
            kept_faces: which faces of the whole these are, (F,) bool.
        """
        mesh = TriangleMesh(self.mesh.vertices[vertices], faces)
        return replace(self, mesh=mesh, normals=self.normals[kept_faces])

    def mad(self, vertices: FloatArray) -> float:
        """Return the mean angular difference to the truth, degrees."""
        return float(angular_differences(vertices, self.normals, self.mesh.faces).mean())

    def vertex_error(self, vertices: FloatArray) -> float:
        """Return the mean distance of the vertices to their true places, in mean edge lengths of the truth."""
        return float(np.linalg.norm(vertices - self.mesh.vertices, axis=1).mean()) / self.edge_length

    def measures(self, vertices: FloatArray) -> dict[str, float]:
        """Return ``mad`` and ``vertex_error`` of positions in file units."""
        return {"mad": self.mad(vertices), "vertex_error": self.vertex_error(vertices)}

    def full_measures(self, vertices: FloatArray) -> dict[str, float]:
        """Return all measures of positions (V, 3) in file units; the surface distances take a second on a large mesh.

        Returns:
            Those of :meth:`measures` and of :func:`surface_measures`, and

            - ``mad_area_weighted``: the mean angle weighted by the areas of the true faces, degrees.
            - ``vertex_error_rms`` and ``vertex_error_max``: root mean square and maximum of the distances of the vertices
              to their true places, in mean edge lengths of the truth.
            - ``flipped_faces``: share of the faces whose normal is more than 90 degrees from the true one. A face without
              area has no normal and counts as not flipped.

        Raises:
            MeshError: as for :func:`surface_measures`.
        """
        mesh = self.mesh.with_vertices(vertices)
        angles = angular_differences(mesh.vertices, self.normals, mesh.faces)
        areas = face_areas(self.mesh.vertices, self.mesh.faces)
        distances = np.linalg.norm(mesh.vertices - self.mesh.vertices, axis=1) / self.edge_length
        return {
            **self.measures(mesh.vertices),
            "mad_area_weighted": float((angles * areas).sum() / areas.sum()) if areas.any() else float(angles.mean()),
            "vertex_error_rms": _root_mean_square(distances),
            "vertex_error_max": float(distances.max()),
            "flipped_faces": float((angles > 90).mean()),
            **surface_measures(mesh, self.mesh),
        }
