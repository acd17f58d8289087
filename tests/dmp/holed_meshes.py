"""Meshes with holes that are hard to fill, made in code."""

from __future__ import annotations

import numpy as np

from dmp.mesh import BoolArray, TriangleMesh
from tests.meshes import grid_mesh, sphere_mesh


def without_faces(mesh: TriangleMesh, gone: np.bool_ | BoolArray) -> TriangleMesh:
    """Take faces away, and the vertices that no face needs any more."""
    faces = mesh.faces[~gone]
    used = np.zeros(mesh.n_vertices, dtype=bool)
    used[faces] = True
    return TriangleMesh(mesh.vertices[used], (np.cumsum(used) - 1)[faces])


def without_vertices(mesh: TriangleMesh, gone: BoolArray) -> TriangleMesh:
    """Take vertices away with all their faces."""
    return without_faces(mesh, gone[mesh.faces].any(axis=1))


def sphere_without_cap(lowest: float, subdivisions: int = 4) -> TriangleMesh:
    """The unit sphere without its vertices above the height ``lowest``."""
    sphere = sphere_mesh(subdivisions)
    return without_vertices(sphere, sphere.vertices[:, 2] > lowest)


def sphere_with_six_holes() -> TriangleMesh:
    sphere = sphere_mesh(4)
    return without_vertices(sphere, np.abs(sphere.vertices).max(axis=1) > 0.95)


def sheet_with_square_holes() -> TriangleMesh:
    """A flat sheet with two square holes, one of a single vertex and one of 16, and straight rims everywhere."""
    sheet = grid_mesh(14)
    x, y = sheet.vertices[:, 0], sheet.vertices[:, 1]
    return without_vertices(sheet, ((x == 3) & (y == 3)) | ((x > 6) & (x < 11) & (y > 6) & (y < 11)))


def touching_holes(n: int = 3) -> TriangleMesh:
    """A curved sheet with ``n`` square holes in a row, each touching the next one in a vertex."""
    sheet = grid_mesh(4 * n + 6)
    column, row = np.floor(sheet.vertices[sheet.faces].mean(axis=1)[:, :2]).astype(int).T
    gone = np.zeros(sheet.n_faces, dtype=bool)
    for k in range(n):
        low = 3 + 3 * k
        gone |= (column >= low) & (column < low + 3) & (row >= low) & (row < low + 3)
    curved = sheet.vertices.copy()
    curved[:, 2] = 0.02 * (curved[:, 0] - 8) ** 2
    return without_faces(sheet.with_vertices(curved), gone)


def ring_of_touching_holes() -> TriangleMesh:
    """Four holes that touch in four vertices around a square that hangs on these vertices alone."""
    sheet = grid_mesh(16)
    column, row = np.floor(sheet.vertices[sheet.faces].mean(axis=1)[:, :2]).astype(int).T
    gone = np.zeros(sheet.n_faces, dtype=bool)
    for left, top in ((3, 6), (9, 6), (6, 3), (6, 9)):
        gone |= (column >= left) & (column < left + 3) & (row >= top) & (row < top + 3)
    return without_faces(sheet, gone)


def open_tube(n_around: int = 24, n_along: int = 12) -> TriangleMesh:
    """A cylinder of radius 1 without lids, faces outward."""
    angle = 2 * np.pi * np.arange(n_around) / n_around
    height = np.arange(n_along + 1) * 2 * np.pi / n_around
    z, t = np.meshgrid(height, angle, indexing="ij")
    around, along = np.meshgrid(np.arange(n_around), np.arange(n_along))
    a = (along * n_around + around).ravel()
    b = (along * n_around + (around + 1) % n_around).ravel()
    faces = np.concatenate([np.stack([a, b, b + n_around], axis=1), np.stack([a, b + n_around, a + n_around], axis=1)])
    return TriangleMesh(np.stack([np.cos(t).ravel(), np.sin(t).ravel(), z.ravel()], axis=1), faces)


def fine_cube(n: int = 12) -> TriangleMesh:
    """The surface of the cube [0, n]^3 in unit squares, each cut into two triangles, faces outward."""
    corners: dict[tuple[int, int, int], int] = {}
    faces: list[list[int]] = []
    for axis in range(3):
        for side in (0, n):
            for i in range(n):
                for j in range(n):
                    quad = []
                    for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)):
                        point = [i + di, j + dj]
                        point.insert(axis, side)
                        quad.append(corners.setdefault((point[0], point[1], point[2]), len(corners)))
                    # The squares run anticlockwise as seen from above for axis 0 and 2, clockwise for axis 1.
                    if (side == 0) != (axis == 1):
                        quad.reverse()
                    faces += [quad[:3], [quad[0], quad[2], quad[3]]]
    return TriangleMesh(np.array(list(corners), dtype=float), np.array(faces))


def cube_with_hole_across_an_edge() -> TriangleMesh:
    cube = fine_cube()
    return without_vertices(cube, np.linalg.norm(cube.vertices - [12, 6, 12], axis=1) < 3.5)


def cube_without_a_corner() -> TriangleMesh:
    cube = fine_cube()
    return without_vertices(cube, np.linalg.norm(cube.vertices - [12, 12, 12], axis=1) < 4.5)


def sphere_with_ragged_hole(noise: float = 0.3, seed: int = 0) -> TriangleMesh:
    """A noisy sphere with a hole from whose rim single faces were taken at random."""
    random = np.random.default_rng(seed)
    sphere = sphere_mesh(4)
    gone = sphere.vertices[:, 2] > 0.8
    rim = gone[sphere.faces].any(axis=1)
    for _ in range(2):
        near = np.zeros(sphere.n_vertices, dtype=bool)
        near[sphere.faces[rim]] = True
        rim |= near[sphere.faces].any(axis=1) & (random.random(sphere.n_faces) < 0.35)
    edge_length = np.linalg.norm(np.diff(sphere.vertices[sphere.faces[:, :2]], axis=1), axis=2).mean()
    noisy = sphere.vertices + noise * edge_length * random.uniform(-1, 1, sphere.vertices.shape)
    return without_faces(sphere.with_vertices(noisy), rim)


def sheet_with_winding_slit() -> TriangleMesh:
    """A wavy sheet with one hole of about 1,000 edges: a corridor of one square's width that winds to and fro."""
    n = 64
    sheet = grid_mesh(n)
    column, row = np.floor(sheet.vertices[sheet.faces].mean(axis=1)[:, :2]).astype(int).T
    inside = (column >= 4) & (column < n - 5)
    lane = (row % 6 == 4) & inside & (row < n - 5)
    turn = (row % 12 >= 4) & (row % 12 < 10) & (column == n - 6) | ((row % 12 < 4) | (row % 12 >= 10)) & (column == 4)
    turn &= (row > 4) & (row < n - 9)
    wavy = sheet.vertices.copy()
    wavy[:, 2] = 2 * np.sin(wavy[:, 0] / 6) * np.cos(wavy[:, 1] / 7)
    return without_faces(sheet.with_vertices(wavy), lane | turn)


def sheet_with_large_round_hole(n_rim: int) -> TriangleMesh:
    """Three rows of triangles around a saddle-shaped hole of radius 1 with ``n_rim`` edges."""
    angle = 2 * np.pi * np.arange(n_rim) / n_rim
    step = 2 * np.pi / n_rim
    rows, faces = [], []
    for k in range(4):
        radius, turned = 1 + 0.866 * k * step, angle + (k % 2) * step / 2
        rows.append(radius * np.stack([np.cos(turned), np.sin(turned), 0.3 * np.cos(2 * turned)], axis=1))
    i = np.arange(n_rim)
    j = (i + 1) % n_rim
    for k in range(3):
        low, high = k * n_rim, (k + 1) * n_rim
        if k % 2 == 0:
            faces += [np.stack([low + i, high + i, low + j], axis=1), np.stack([low + j, high + i, high + j], axis=1)]
        else:
            faces += [np.stack([low + i, high + i, high + j], axis=1), np.stack([low + i, high + j, low + j], axis=1)]
    return TriangleMesh(np.concatenate(rows), np.concatenate(faces))


def seven_vertex_torus_without_a_vertex() -> TriangleMesh:
    """A hexagonal hole whose rim vertices are all joined to one another already, so that it has no free diagonal."""
    i = np.arange(7)
    faces = np.concatenate([np.stack([i, i + 1, i + 3], axis=1), np.stack([i, i + 3, i + 2], axis=1)]) % 7
    # Császár's polyhedron: the seven-vertex torus with flat faces that do not meet.
    points = np.array([[3, -3, 0], [3, 3, 1], [1, 2, 3], [-1, -2, 3], [-3, -3, 1], [-3, 3, 0], [0, 0, 15]], dtype=float)
    return without_vertices(TriangleMesh(points, faces), i == 6)


def hole_with_a_fin() -> TriangleMesh:
    """A sheet with a hole, and a third face on one edge of its rim's faces."""
    sheet = sheet_with_square_holes()
    inner = next(v for v in range(sheet.n_vertices) if tuple(sheet.vertices[v, :2]) == (6.0, 6.0))
    beside = next(v for v in range(sheet.n_vertices) if tuple(sheet.vertices[v, :2]) == (5.0, 5.0))
    points = np.concatenate([sheet.vertices, [[5.5, 5.5, 1.0]]])
    return TriangleMesh(points, np.concatenate([sheet.faces, [[inner, beside, sheet.n_vertices]]]))


def hole_with_a_turned_face() -> TriangleMesh:
    """A sheet with two holes, where one face at the rim of the larger one looks the other way."""
    sheet = sheet_with_square_holes()
    faces = sheet.faces.copy()
    centers = sheet.vertices[faces].mean(axis=1)
    turned = int(np.argmin(np.linalg.norm(centers[:, :2] - [5.7, 8.5], axis=1)))
    faces[turned] = faces[turned, ::-1]
    return TriangleMesh(sheet.vertices, faces)


def sheet_with_unwelded_seam() -> TriangleMesh:
    """A sheet cut along a line without a gap: both sides of the hole lie on one another."""
    sheet = grid_mesh(9)
    on_line = (sheet.vertices[:, 0] == 4) & (sheet.vertices[:, 1] > 1) & (sheet.vertices[:, 1] < 7)
    twin = np.arange(sheet.n_vertices)
    twin[on_line] = sheet.n_vertices + np.arange(np.count_nonzero(on_line))
    faces = sheet.faces.copy()
    right = sheet.vertices[faces].mean(axis=1)[:, 0] > 4
    faces[right] = twin[faces[right]]
    return TriangleMesh(np.concatenate([sheet.vertices, sheet.vertices[on_line]]), faces)
