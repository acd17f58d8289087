"""Meshes as scanners and converters leave them behind, made in code: each by name, with a fault of one kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from dmp.mesh import FloatArray, IntArray, TriangleMesh
from dmp.shapes.alterations import with_holes
from tests.meshes import grid_mesh, sphere_mesh


def _ball() -> TriangleMesh:
    """A noisy unit sphere with 66 vertices."""
    ball = sphere_mesh(2)
    return ball.with_vertices(ball.vertices + 0.03 * np.random.default_rng(0).standard_normal(ball.vertices.shape))


def _more(mesh: TriangleMesh, vertices: Sequence[ArrayLike] = (), faces: Sequence[Sequence[int]] = ()) -> TriangleMesh:
    new_vertices = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    new_faces = np.array(faces, dtype=np.int64).reshape(-1, 3)
    return TriangleMesh(np.vstack([mesh.vertices, new_vertices]), np.vstack([mesh.faces, new_faces]))


def joined(first: TriangleMesh, second: TriangleMesh) -> TriangleMesh:
    """Return both meshes in one, without common vertices."""
    faces = np.vstack([first.faces, second.faces + first.n_vertices])
    return TriangleMesh(np.vstack([first.vertices, second.vertices]), faces)


def non_manifold_edge() -> TriangleMesh:
    ball = _ball()
    return _more(ball, [[0, 0, 3.0]], [[ball.faces[0, 0], ball.faces[0, 1], ball.n_vertices]])


def non_manifold_vertex() -> TriangleMesh:
    """Two balls that share vertex 0."""
    ball = _ball()
    mirrored = 2 * ball.vertices[0] - ball.vertices
    faces = np.where(ball.faces == 0, 0, ball.faces + ball.n_vertices - 1)[:, ::-1]
    return TriangleMesh(np.vstack([ball.vertices, mirrored[1:]]), np.vstack([ball.faces, faces]))


def fan() -> TriangleMesh:
    """Five faces at one edge."""
    return TriangleMesh(np.random.default_rng(1).standard_normal((7, 3)), np.array([[0, 1, k] for k in range(2, 7)]))


def isolated_vertices() -> TriangleMesh:
    """One before, one among and one behind the others, the last one far away."""
    ball = _ball()
    vertices = np.vstack([[[9.0, 9, 9]], ball.vertices[:30], [[0.0, 0, 0]], ball.vertices[30:], [[1e9, 0, 0]]])
    return TriangleMesh(vertices, np.where(ball.faces < 30, ball.faces + 1, ball.faces + 2))


def collapsed_faces() -> TriangleMesh:
    """Faces that name a vertex twice or three times; the last vertex belongs to no others."""
    ball = _ball()
    last = ball.n_vertices
    return _more(ball, [[0, 0, 1.5]], [[0, 0, 1], [1, 1, 1], [last, last, last], [last, last, 2], [2, 3, 2]])


def cap() -> TriangleMesh:
    """A closed ball with a triangle without area: the middle of an edge was put into one of its two faces only."""
    ball = _ball()
    a, b, c = ball.faces[0].tolist()
    middle = ball.n_vertices
    mesh = _more(ball, [(ball.vertices[a] + ball.vertices[b]) / 2], [[a, middle, c], [middle, b, c], [a, b, middle]])
    return TriangleMesh(mesh.vertices, mesh.faces[1:])


def coincident_vertices() -> TriangleMesh:
    """A ball that is cut open along the faces of the upper half, as files with one normal a face leave it."""
    ball = _ball()
    upper = (ball.vertices[ball.faces][:, :, 2] > 0).all(axis=1)
    corners = ball.faces[upper]
    doubled = np.vstack([ball.vertices, ball.vertices[corners].reshape(-1, 3)])
    faces = ball.faces.copy()
    faces[upper] = ball.n_vertices + np.arange(corners.size).reshape(-1, 3)
    return _without_isolated(doubled, faces)


def duplicate_faces() -> TriangleMesh:
    """Five faces twice, four more a second time the other way round, one of them turned."""
    ball = _ball()
    copies = np.vstack([ball.faces[:4], np.roll(ball.faces[4:5], 1, axis=1), ball.faces[5:9, ::-1]])
    return TriangleMesh(ball.vertices, np.vstack([ball.faces, copies]))


def several_pieces() -> TriangleMesh:
    """A ball, a tenth of it beside it, and a single triangle."""
    ball = _ball()
    small = ball.with_vertices(0.1 * ball.vertices + 5)
    return joined(joined(ball, small), TriangleMesh(np.array([[9.0, 9, 9], [9, 10, 9], [10, 9, 9]]), np.array([[0, 1, 2]])))


def single_triangle() -> TriangleMesh:
    return TriangleMesh(np.eye(3), np.array([[0, 1, 2]]))


def tetrahedron() -> TriangleMesh:
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return TriangleMesh(corners, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))


def flat_square() -> TriangleMesh:
    return TriangleMesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]]))


def flipped_faces() -> TriangleMesh:
    """Every third face looks inwards."""
    ball = _ball()
    faces = ball.faces.copy()
    faces[::3] = faces[::3, ::-1]
    return TriangleMesh(ball.vertices, faces)


def inside_out() -> TriangleMesh:
    ball = _ball()
    return TriangleMesh(ball.vertices, ball.faces[:, ::-1])


def moebius_strip(n: int = 12) -> TriangleMesh:
    """A strip with one side only."""
    turn = np.repeat(np.linspace(0, 2 * np.pi, n, endpoint=False), 2)
    across = np.tile([-0.3, 0.3], n)
    radius = 1 + across * np.cos(turn / 2)
    vertices = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), across * np.sin(turn / 2)])
    faces = []
    for i in range(n):
        a, b = 2 * i, 2 * i + 1
        c, d = (2 * i + 2, 2 * i + 3) if i < n - 1 else (1, 0)
        faces += [[a, c, b], [b, c, d]]
    return TriangleMesh(vertices, np.array(faces))


def needles() -> TriangleMesh:
    """A sheet that is a thousand times as long as it is wide."""
    sheet = grid_mesh(6)
    return sheet.with_vertices(sheet.vertices * [1000.0, 1.0, 1.0])


def scaled(factor: float, shift: float = 0.0) -> TriangleMesh:
    ball = _ball()
    return ball.with_vertices(factor * ball.vertices + shift)


ODD_MESHES: dict[str, Callable[[], TriangleMesh]] = {
    "a ball": _ball,
    "non-manifold edge": non_manifold_edge,
    "non-manifold vertex": non_manifold_vertex,
    "fan": fan,
    "isolated vertices": isolated_vertices,
    "collapsed faces": collapsed_faces,
    "cap": cap,
    "coincident vertices": coincident_vertices,
    "duplicate faces": duplicate_faces,
    "several pieces": several_pieces,
    "single triangle": single_triangle,
    "tetrahedron": tetrahedron,
    "flat square": flat_square,
    "flipped faces": flipped_faces,
    "inside out": inside_out,
    "Moebius strip": moebius_strip,
    "needles": needles,
    "size 1e-6": lambda: scaled(1e-6),
    "size 1e7": lambda: scaled(1e7),
    "1e7 away": lambda: scaled(1.0, 1e7),
    "small and 1e7 away": lambda: scaled(1e-3, 1e7),
}


def with_a_holed_sheet(mesh: TriangleMesh) -> TriangleMesh:
    """Return a mesh with a sheet beside it, of about its size, that has a hole to fill."""
    used = mesh.vertices[np.unique(mesh.faces)]
    size = float(np.ptp(used, axis=0).max())
    even = grid_mesh(14)
    # Uneven, so that nothing in hole filling hangs on the last digit of equal lengths.
    uneven = even.with_vertices(even.vertices + 0.1 * np.random.default_rng(2).standard_normal(even.vertices.shape))
    sheet = with_holes(uneven, [(6.0, 6.0, 0.0)], [9])
    return joined(mesh, sheet.with_vertices(0.1 * size * sheet.vertices + used.mean(axis=0) + [0, 0, 2 * size]))


def _without_isolated(vertices: FloatArray, faces: IntArray) -> TriangleMesh:
    used, numbers = np.unique(faces, return_inverse=True)
    return TriangleMesh(vertices[used], numbers.reshape(-1, 3))
