"""Spread a closed mesh without handles over a sphere, without turning any face over.

After Gotsman, Gu and Sheffer, Fundamentals of spherical parameterization for 3D meshes (2003): each vertex lies in the middle
of its neighbours, as far as the sphere lets it. Their system has many solutions in which everything gathers in one point, and
solvers that start anywhere may end there. Here

1. the mesh without one face is laid into the plane by Tutte's method, which never turns a face over, and brought onto the
   sphere by stereographic projection;
2. among all conformal maps of the sphere the one is taken that puts the mean of the vertices into the centre, again after each
   step that follows, which is what keeps the vertices from gathering;
3. the sum of squared edge lengths is brought down by steps that never turn a face over.

The result is a minimum of that sum among all positions on the sphere whose mean is the centre. Long thin parts come out
small: along a tube the size shrinks by a constant factor with each turn of its circumference.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.sparse.linalg import SuperLU, splu

from dmp.errors import NoSphereError
from dmp.mesh import FloatArray, IntArray, TriangleMesh
from dmp.sphere_like import check_sphere_like
from dmp.topology import adjacency, connected_vertices, proper_faces

# The steps end when the sum of squared lengths falls by less than this share; on real meshes after about ten.
_ENOUGH = 1e-9
_MOST_STEPS = 200


def spherical_smoothing(mesh: TriangleMesh) -> FloatArray:
    """Return the mesh spread over a sphere that fits it.

    The centre is the mean of the vertices, the radius their mean distance from it, and the sphere is turned so that the squared
    distances between the vertices and their places on it are least. Faces look outwards on it if they do so on the mesh.

    Args:
        mesh: closed, of one piece, without handles. Isolated vertices stay where they are.

    Returns:
        Positions, (V, 3) float64.

    Raises:
        NoSphereError: when the mesh is something else (the text says what), or has parts too long and thin to be spread.
    """
    check_sphere_like(mesh)
    used = np.flatnonzero(connected_vertices(mesh.faces, mesh.n_vertices))
    number = np.zeros(mesh.n_vertices, dtype=np.int64)
    number[used] = np.arange(len(used))
    faces = number[proper_faces(mesh.faces)]
    placed = mesh.vertices.copy()
    placed[used] = _fitted(spherical_embedding(faces, len(used)), mesh.vertices[used], faces)
    return placed


def spherical_embedding(faces: IntArray, n_vertices: int) -> FloatArray:
    """Return places on the unit sphere, (V, 3) float64, on which all faces look outwards.

    Args:
        faces: (F, 3), those of a closed surface of one piece without handles, consistently oriented.
        n_vertices: V; each belongs to a face.

    Raises:
        NoSphereError: when faces would turn over, because their images are smaller than rounding.
    """
    neighbours = adjacency(faces, n_vertices)
    laplacian = sparse.csr_array(sparse.diags_array(neighbours.sum(axis=1)) - neighbours)
    fewest = len(faces)
    for face in (_face_in_the_middle(faces, neighbours), 0, len(faces) // 2):
        places = _relaxed(_centred(_onto_sphere(_in_plane(faces, laplacian, face))), faces, laplacian)
        flipped = _n_flipped(places, faces)
        if not flipped:
            return places
        fewest = min(fewest, flipped)
    raise NoSphereError(
        f"Parts of the mesh are too long and thin to be spread over a sphere: {fewest} faces would turn over. "
        "Use the smoothing 'laplacian'."
    )


def _face_in_the_middle(faces: IntArray, neighbours: sparse.csr_array) -> int:
    """Return a face far from all ends: opposite to it in the plane, ends come out larger than in any other place."""

    def steps_from(vertex: int) -> FloatArray:
        return csgraph.dijkstra(neighbours, unweighted=True, indices=[vertex])[0]

    from_one = steps_from(int(steps_from(0).argmax()))
    from_other = steps_from(int(from_one.argmax()))
    middle = np.maximum(from_one, from_other).argmin()
    return int((faces == middle).any(axis=1).argmax())


def _in_plane(faces: IntArray, laplacian: sparse.csr_array, outer_face: int) -> FloatArray:
    """Return the embedding of Tutte (How to draw a graph, 1963), (V, 2), with one face as the outer triangle."""
    outer = faces[outer_face]
    inner = np.setdiff1d(np.arange(laplacian.shape[0]), outer)
    # Clockwise: seen from its own side the outer face surrounds all others.
    angles = -2.0 * np.pi * np.arange(3) / 3.0
    places = np.zeros((laplacian.shape[0], 2))
    places[outer] = np.column_stack([np.cos(angles), np.sin(angles)])
    rows = laplacian[inner]
    solve = _factorised(rows[:, inner]).solve
    # Once more on what is left: the faces in the middle are so small that the first solution's rounding shows.
    for _ in range(2):
        places[inner] -= solve(rows @ places)
    return places


def _onto_sphere(places: FloatArray) -> FloatArray:
    """Return places (V, 2) of the plane on the unit sphere, (V, 3), half of them on either side."""
    places = places - np.median(places, axis=0)
    places /= max(float(np.median(np.linalg.norm(places, axis=1))), np.finfo(float).tiny)
    squared = (places**2).sum(axis=1)
    # Seen from outside the projection from the south pole keeps anticlockwise faces anticlockwise.
    return np.column_stack([2.0 * places, 1.0 - squared]) / (1.0 + squared)[:, None]


def _centred(places: FloatArray, most: int = 100) -> FloatArray:
    """Return the places after the conformal map of the sphere that brings their mean into the centre (Newton's method)."""
    for _ in range(most):
        mean = places.mean(axis=0)
        if np.linalg.norm(mean) < 1e-12:
            break
        shift = np.linalg.solve(2.0 * (np.eye(3) - places.T @ places / len(places)), mean)
        # A map of the sphere onto itself needs a point inside, and far steps go astray.
        shift /= max(1.0, np.linalg.norm(shift) / 0.8)
        moved = places - shift
        places = _unit((1.0 - shift @ shift) * moved / (moved**2).sum(axis=1, keepdims=True) - shift)
    return places


def _relaxed(places: FloatArray, faces: IntArray, laplacian: sparse.csr_array) -> FloatArray:
    """Bring the sum of squared edge lengths down, keeping the mean in the centre and turning no more faces over."""
    n_vertices = len(places)
    # The lowest eigenvalues of the Laplacian on a sphere of V vertices are about 44 / V; with something of that size added, its
    # inverse takes the curvature of the sphere into account well enough for a handful of steps.
    solve = _factorised(laplacian + (10.0 / n_vertices) * sparse.eye_array(n_vertices)).solve
    energy, flipped, length = _energy(places, laplacian), _n_flipped(places, faces), 1.0
    for _ in range(_MOST_STEPS):
        direction = _across(solve(_across(laplacian @ places, places)), places)
        while True:
            moved = _centred(_unit(places - length * direction))
            moved_energy = _energy(moved, laplacian)
            if moved_energy < energy and (moved_flipped := _n_flipped(moved, faces)) <= flipped:
                break
            length /= 2.0
            if length < 1e-6:
                return places
        gain = energy - moved_energy
        places, energy, flipped, length = moved, moved_energy, moved_flipped, min(1.0, 2.0 * length)
        if gain < _ENOUGH * energy:
            break
    return places


def _fitted(places: FloatArray, vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Move, scale and turn places on the unit sphere (V, 3) so that they come close to the vertices (V, 3)."""
    centre = vertices.mean(axis=0)
    around = vertices - centre
    left, _, right = np.linalg.svd(around.T @ places)
    # Where the faces of the mesh look inwards they shall do so on the sphere: then it takes a mirror image.
    side = 1.0 if _volumes(around, faces).sum() >= 0 else -1.0
    turn = left @ np.diag([1.0, 1.0, side * np.sign(np.linalg.det(left @ right))]) @ right
    return np.asarray(centre + np.linalg.norm(around, axis=1).mean() * places @ turn.T)


def _volumes(places: FloatArray, faces: IntArray) -> FloatArray:
    """Return six times the signed volumes between the faces and the origin, (F,): positive where faces look outwards."""
    first, second, third = places[faces[:, 0]], places[faces[:, 1]], places[faces[:, 2]]
    return np.einsum("fc,fc->f", first, np.cross(second - first, third - first))


def _n_flipped(places: FloatArray, faces: IntArray) -> int:
    return int(np.count_nonzero(_volumes(places, faces) <= 0))


def _energy(places: FloatArray, laplacian: sparse.csr_array) -> float:
    return float(np.vdot(places, laplacian @ places))


def _across(vectors: FloatArray, places: FloatArray) -> FloatArray:
    """Return what of the vectors is tangential to the sphere."""
    return vectors - places * np.einsum("vc,vc->v", vectors, places)[:, None]


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _factorised(matrix: sparse.csr_array) -> SuperLU:
    return splu(sparse.csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
