"""Who is joined to whom: edges, adjacency, boundaries and components of a triangle mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from dmp.mesh import BoolArray, IntArray, TriangleMesh


def proper_faces(faces: IntArray) -> IntArray:
    """Return the faces with three different vertices, (n, 3); the same array when that is all of them."""
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return faces if proper.all() else faces[proper]


def connected_vertices(faces: IntArray, n_vertices: int) -> BoolArray:
    """Tell which vertices have a neighbour, (V,): those of a face with three different vertices."""
    connected = np.zeros(n_vertices, dtype=bool)
    connected[proper_faces(faces).ravel()] = True
    return connected


def edge_face_counts(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Return the undirected edges (E, 2), each row and the whole sorted, and in how many faces each occurs (E,).

    Faces that name a vertex twice have no sides and are overlooked.
    """
    faces = proper_faces(faces)
    half_edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    half_edges.sort(axis=1)
    # One integer a pair makes the sort several times faster than np.unique over rows.
    n_vertices = int(faces.max()) + 1 if faces.size else 0
    keys, counts = np.unique(half_edges[:, 0] * n_vertices + half_edges[:, 1], return_counts=True)
    edges = np.column_stack([keys // max(n_vertices, 1), keys % max(n_vertices, 1)])
    return edges, counts


def unique_edges(faces: IntArray) -> IntArray:
    """Return each undirected edge once, (E, 2) int64, smaller index first, sorted."""
    return edge_face_counts(faces)[0]


def adjacency(faces: IntArray, n_vertices: int) -> sparse.csr_array:
    """Return the symmetric 0/1 adjacency matrix A, (V, V) float64, without self-loops."""
    edges, _ = edge_face_counts(faces)
    rows, columns = np.concatenate([edges, edges[:, ::-1]]).T
    matrix = sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=(n_vertices, n_vertices))
    matrix.sort_indices()
    return matrix


def n_components(faces: IntArray, n_vertices: int) -> int:
    """Return the number of connected components of the vertex graph; an isolated vertex is one of its own."""
    return int(csgraph.connected_components(adjacency(faces, n_vertices), directed=False)[0])


@dataclass(frozen=True)
class TopologyReport:
    """Counts that describe the connectivity of a mesh.

    A face that names a vertex twice is collapsed: it counts as a face, and joins nothing.
    """

    vertices: int
    faces: int
    edges: int
    components: int
    boundary_edges: int
    non_manifold_edges: int
    unreferenced_vertices: int
    collapsed_faces: int
    valence_min: int
    valence_mean: float
    valence_max: int

    @property
    def euler_characteristic(self) -> int:
        """V - E + F, counting only vertices that belong to a face, and faces with three different vertices."""
        return self.vertices - self.unreferenced_vertices - self.edges + self.faces - self.collapsed_faces

    @property
    def is_closed(self) -> bool:
        """Whether each edge has exactly two faces."""
        return self.boundary_edges == 0 and self.non_manifold_edges == 0


def topology_report(mesh: TriangleMesh) -> TopologyReport:
    """Count components, boundary and non-manifold edges, unreferenced vertices and valences of ``mesh``."""
    edges, counts = edge_face_counts(mesh.faces)
    valences = np.bincount(edges.ravel(), minlength=mesh.n_vertices)
    used = connected_vertices(mesh.faces, mesh.n_vertices)
    unreferenced = int(np.count_nonzero(~used))
    return TopologyReport(
        vertices=mesh.n_vertices,
        faces=mesh.n_faces,
        edges=len(edges),
        components=n_components(mesh.faces, mesh.n_vertices) - unreferenced,
        boundary_edges=int(np.count_nonzero(counts == 1)),
        non_manifold_edges=int(np.count_nonzero(counts > 2)),
        unreferenced_vertices=unreferenced,
        collapsed_faces=mesh.n_faces - len(proper_faces(mesh.faces)),
        valence_min=int(valences[used].min()) if used.any() else 0,
        valence_mean=float(valences[used].mean()) if used.any() else 0.0,
        valence_max=int(valences.max()) if len(valences) else 0,
    )
