"""The papers' formulas as loops over faces and vertices, slow and direct, to compare with."""

from __future__ import annotations

import math

import numpy as np

from dmp.mesh import FloatArray, IntArray, TriangleMesh


def neighbour_lists(faces: IntArray) -> dict[int, set[int]]:
    """Vertices joined to each vertex."""
    joined: dict[int, set[int]] = {}
    for face in faces.tolist():
        for a in face:
            joined.setdefault(a, set()).update(b for b in face if b != a)
    return joined


def laplacian_step(vertices: FloatArray, faces: IntArray, share: float) -> FloatArray:
    moved = vertices.copy()
    for vertex, around in neighbour_lists(faces).items():
        mean = sum(vertices[other] for other in around) / len(around)
        moved[vertex] = vertices[vertex] + share * (mean - vertices[vertex])
    return moved


def geometry_of_faces(vertices: FloatArray, faces: IntArray) -> tuple[list[FloatArray], list[float], list[FloatArray]]:
    """Unit normals (0 without an area), areas and centroids."""
    normals, areas, centroids = [], [], []
    for a, b, c in faces:
        vector = np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
        length = float(np.linalg.norm(vector))
        normals.append(vector / length if length > 0 else vector)
        areas.append(length / 2)
        centroids.append((vertices[a] + vertices[b] + vertices[c]) / 3)
    return normals, areas, centroids


def sharing(faces: IntArray, least: int) -> list[list[int]]:
    """For each face the others with at least so many vertices in common."""
    sets = [set(face) for face in faces.tolist()]
    return [[j for j in range(len(faces)) if j != i and len(sets[i] & sets[j]) >= least] for i in range(len(faces))]


def centroid_distance(centroids: list[FloatArray], faces: IntArray) -> float:
    distances = [np.linalg.norm(centroids[i] - centroids[j]) for i, around in enumerate(sharing(faces, 2)) for j in around]
    return float(np.mean(distances))


def follow(vertices: FloatArray, faces: IntArray, normals: list[FloatArray], steps: int) -> FloatArray:
    for _ in range(steps):
        centroids = geometry_of_faces(vertices, faces)[2]
        moved = vertices.copy()
        for vertex in range(len(vertices)):
            around = [f for f, face in enumerate(faces.tolist()) if vertex in face]
            for f in around:
                moved[vertex] += normals[f] * (normals[f] @ (centroids[f] - vertices[vertex])) / len(around)
        vertices = moved
    return vertices


def weight(difference: FloatArray, deviation: float) -> float:
    return math.exp(-float(difference @ difference) / (2 * deviation**2))


def bilateral(mesh: TriangleMesh, iterations: int, sigma: float, least_common: int, vertex_steps: int) -> FloatArray:
    normals, areas, centroids = geometry_of_faces(mesh.vertices, mesh.faces)
    around = sharing(mesh.faces, least_common)
    near = centroid_distance(centroids, mesh.faces)
    for _ in range(iterations):
        new = []
        for i in range(mesh.n_faces):
            total = np.zeros(3)
            for j in around[i]:
                closeness = weight(centroids[i] - centroids[j], near)
                total += areas[j] * closeness * weight(normals[i] - normals[j], sigma) * normals[j]
            new.append(total / np.linalg.norm(total))
        normals = new
    return follow(mesh.vertices, mesh.faces, normals, vertex_steps)


def inconsistency(patch: list[int], normals: list[FloatArray], beside: list[list[int]]) -> float:
    spread = max((float(np.linalg.norm(normals[j] - normals[k])) for j in patch for k in patch), default=0.0)
    inside = [float(np.linalg.norm(normals[j] - normals[k])) for j in patch for k in beside[j] if k in patch and k > j]
    return spread * max(inside, default=0.0) / (1e-9 + sum(inside))


def guided(mesh: TriangleMesh, iterations: int, sigma: float, radius: float, vertex_steps: int) -> FloatArray:
    faces, vertices = mesh.faces, mesh.vertices
    beside = sharing(faces, 2)
    patches = [sorted([i, *around]) for i, around in enumerate(sharing(faces, 1))]
    centroids = geometry_of_faces(vertices, faces)[2]
    reach = radius * centroid_distance(centroids, faces)
    two_rings = [sorted({k for j in patch for k in patches[j]}) for patch in patches]
    near = [[j for j in two_rings[i] if np.linalg.norm(centroids[i] - centroids[j]) <= reach] for i in range(len(faces))]
    for _ in range(iterations):
        normals, areas, centroids = geometry_of_faces(vertices, faces)
        distance = centroid_distance(centroids, faces)
        measures = [inconsistency(patch, normals, beside) for patch in patches]
        guides = []
        for candidates in patches:
            best = min(candidates, key=lambda patch: measures[patch])
            mean = sum(areas[j] * normals[j] for j in patches[best])
            guides.append(mean / np.linalg.norm(mean))
        target = []
        for i in range(len(faces)):
            total = np.zeros(3)
            for j in near[i]:
                closeness = weight(centroids[i] - centroids[j], distance)
                total += areas[j] * closeness * weight(guides[i] - guides[j], sigma) * normals[j]
            target.append(total / np.linalg.norm(total))
        vertices = follow(vertices, faces, target, vertex_steps)
    return vertices
