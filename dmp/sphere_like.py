"""Whether a mesh is, as a surface, like a sphere: closed, of one piece, without handles."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from dmp.errors import NoSphereError
from dmp.mesh import IntArray, TriangleMesh
from dmp.topology import proper_faces, topology_report


def check_sphere_like(mesh: TriangleMesh) -> None:
    """Raise :class:`dmp.errors.NoSphereError` with the reason unless the surface is closed, of one piece, without handles."""
    report = topology_report(mesh)
    handles = 1 - report.euler_characteristic // 2
    reason = ""
    if report.boundary_edges:
        reason = f"is open: it has {_count(report.boundary_edges, 'boundary edge')}. Fill its holes first, or use"
    elif report.non_manifold_edges:
        reason = f"has {_count(report.non_manifold_edges, 'edge')} where more than two faces meet. Use"
    elif report.components != 1:
        reason = f"has {_count(report.components, 'separate piece')}. Use"
    elif pinched := _n_fans(proper_faces(mesh.faces)) - (report.vertices - report.unreferenced_vertices):
        reason = f"touches itself: at {_count(pinched, 'vertex', 'vertices')} it has no definite inside. Use"
    elif _is_twisted(proper_faces(mesh.faces)):
        reason = "has faces that disagree about which side is outside. Use"
    elif handles:
        reason = f"has {_count(handles, 'handle')}, as a ring has one. Use"
    if reason:
        raise NoSphereError(
            f"The smoothing 'spherical' needs one closed surface without handles, and this mesh {reason} the smoothing "
            "'laplacian'."
        )


def _half_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Return start and end of all half-edges, (3 F,) each, three after each other for each face."""
    return faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)


def _n_fans(faces: IntArray) -> int:
    """Return the number of fans that the faces form around their vertices, where each edge has two faces."""
    start, end = _half_edges(faces)
    corner = np.arange(len(start))
    following = np.roll(corner.reshape(-1, 3), -1, axis=1).reshape(-1)
    forwards = start < end
    at_low, at_high = np.where(forwards, corner, following), np.where(forwards, following, corner)
    order = np.lexsort((np.maximum(start, end), np.minimum(start, end))).reshape(-1, 2)
    links = np.concatenate([at_low[order], at_high[order]])
    graph = sparse.coo_array((np.ones(len(links), dtype=bool), links.T), shape=(len(start),) * 2)
    return int(csgraph.connected_components(graph, directed=False)[0])


def _is_twisted(faces: IntArray) -> bool:
    """Tell whether two faces run through an edge in the same direction."""
    start, end = _half_edges(faces)
    return len(np.unique(start * (int(faces.max()) + 1) + end)) < len(start)


def _count(number: int, what: str, many: str = "") -> str:
    return f"{number} {what if number == 1 else many or what + 's'}"
