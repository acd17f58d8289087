"""Boundaries of a mesh: find them as loops, describe them, and tell holes from the outer rim of an open scan.

A boundary edge belongs to exactly one face. Where the mesh is a manifold, the boundary edges form closed loops. Two
things break that. At a *pinch* several loops touch in one vertex; they are taken apart into simple loops, so that each
can be closed by itself. Where an edge has more than two faces, or neighbouring faces disagree about which side is
outside, no loop is well defined; such a boundary is reported with the reason and cannot be filled.

Faces that name a vertex twice have no sides and are overlooked here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from dmp.mesh import BoolArray, FloatArray, IntArray, TriangleMesh, read_only

# A component counts as a sheet when the sum of its area vectors is at least this share of its area: 1 for a flat
# disc, 0.5 for a hemisphere, (1 - cos t) / 2 for a sphere without a cap of the angular radius t. Noise of half an
# edge length takes about a third off, which still leaves every scan from one side above the limit.
SHEET_FLATNESS = 0.4

CROWDED = "An edge at this boundary belongs to more than two faces, so it has no definite sides."
TWISTED = "The faces along this boundary disagree about which side is outside."


@dataclass(frozen=True, eq=False)
class BoundaryLoop:
    """One closed boundary of a mesh, or a boundary that is no closed loop together with the reason.

    Attributes:
        edges: (n, 2) int64, the boundary edges as their faces run through them, so a face that closes the hole has
            to use each of them backwards. Row i ends where row i + 1 begins if the loop is simple.
        perimeter: sum of the lengths of the edges, file units.
        size: diagonal of the loop's bounding box, file units.
        center: mean of the vertices, (3,) float64, file units.
        problem: why it cannot be filled, one sentence; empty for a simple closed loop.
    """

    edges: IntArray
    perimeter: float
    size: float
    center: FloatArray
    problem: str = ""

    @property
    def vertices(self) -> IntArray:
        """Vertex indices (n,) in the order of the edges, from the lowest one on; ascending if it is no simple loop."""
        return self.edges[:, 0] if self.is_simple else np.unique(self.edges)

    @property
    def n_edges(self) -> int:
        """Number of boundary edges."""
        return len(self.edges)

    @property
    def is_simple(self) -> bool:
        """Whether the edges form one closed loop that visits no vertex twice."""
        return not self.problem


def boundary_loops(mesh: TriangleMesh) -> tuple[BoundaryLoop, ...]:
    """Find all boundaries of ``mesh``.

    Loops that touch in a vertex are separated: the faces around the vertex form several fans, and each loop crosses
    from one fan to the next one anticlockwise, as seen from outside. A loop that still meets a vertex twice is cut
    there, so that every loop is simple.

    Returns:
        the loops, longest perimeter first, then by the lowest vertex.
    """
    half_edges, crowded, twisted = _boundary_half_edges(mesh.faces, mesh.n_vertices)
    if not len(half_edges):
        return ()
    n_out = np.bincount(half_edges[:, 0], minlength=mesh.n_vertices)
    n_in = np.bincount(half_edges[:, 1], minlength=mesh.n_vertices)
    graph = coo_matrix(
        (np.ones(len(half_edges), dtype=bool), (half_edges[:, 0], half_edges[:, 1])), shape=(mesh.n_vertices,) * 2
    )
    component = connected_components(graph, directed=False)[1]
    broken = np.zeros(mesh.n_vertices, dtype=bool)  # by component
    broken[component[n_out != n_in]] = True
    is_broken = broken[component[half_edges[:, 0]]]

    found = [(chain, CROWDED if crowded[chain].any() else TWISTED) for chain in _groups(half_edges[is_broken], component)]
    closed = half_edges[~is_broken]
    for loop in _walk(closed, _next_half_edges(mesh, closed, n_out)):
        edges = closed[loop]
        edges = np.roll(edges, -int(np.argmin(edges[:, 0])), axis=0)
        problem = CROWDED if crowded[edges].any() else TWISTED if twisted[edges].any() else ""
        found.append((edges, problem))
    return _described(mesh.vertices, found)


def outer_rims(mesh: TriangleMesh, loops: Sequence[BoundaryLoop]) -> tuple[int, ...]:
    """Find the loops that are no holes, but the rim of an open surface such as a scan from one side.

    A connected component is plainly a sheet if the area vectors of its faces add up to at least
    :data:`SHEET_FLATNESS` of its area; around a closed body they cancel, and near a small hole nearly so. Unlike the
    perimeter this does not depend on how ragged the rim is. The sum of the area vectors equals, by Stokes' theorem,
    the sum over the loops' own area vectors, to which the outer rim contributes with, and holes against, its
    direction: the rim is the loop with the largest contribution, which for all but very ragged holes is the longest.

    Returns:
        indices into ``loops``, ascending, at most one for each connected component; none for closed bodies with
        holes, for tubes, and for boundaries that are not simple.
    """
    if not loops:
        return ()
    faces = mesh.faces
    corners = mesh.vertices[faces]
    area_vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    links = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_matrix((np.ones(len(links), dtype=bool), (links[:, 0], links[:, 1])), shape=(mesh.n_vertices,) * 2)
    n_components, component = connected_components(graph, directed=False)
    face_component = component[faces[:, 0]]
    areas = np.bincount(face_component, np.linalg.norm(area_vectors, axis=1), n_components)
    totals = np.stack([np.bincount(face_component, area_vectors[:, axis], n_components) for axis in range(3)], axis=1)
    is_sheet = np.linalg.norm(totals, axis=1) >= SHEET_FLATNESS * areas

    best: dict[int, tuple[float, int]] = {}
    for index, loop in enumerate(loops):
        of = int(component[loop.edges[0, 0]])
        if not loop.is_simple or not is_sheet[of] or areas[of] == 0:
            continue
        positions = mesh.vertices[loop.edges] - loop.center
        share = float(np.cross(positions[:, 0], positions[:, 1]).sum(axis=0) / 2 @ totals[of])
        if share > 0 and share > best.get(of, (0.0, -1))[0]:
            best[of] = (share, index)
    return tuple(sorted(index for _, index in best.values()))


def _boundary_half_edges(faces: IntArray, n_vertices: int) -> tuple[IntArray, BoolArray, BoolArray]:
    """Return the boundary half-edges (B, 2), and masks (V,) of vertices at crowded and at twisted edges."""
    proper = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    start = proper.T.ravel()
    end = np.roll(proper, -1, axis=1).T.ravel()
    # One sort of plain integers instead of an argsort: the lowest bit carries the direction of the half-edge.
    key = (np.minimum(start, end) * n_vertices + np.maximum(start, end)) * 2 + (start > end)
    key.sort()
    first = np.flatnonzero(np.diff(key >> 1, prepend=-1))
    count = np.diff(first, append=len(key))

    single = key[first[count == 1]]
    low, high = (single >> 1) // n_vertices, (single >> 1) % n_vertices
    backwards = (single & 1).astype(bool)
    half_edges = np.stack([np.where(backwards, high, low), np.where(backwards, low, high)], axis=1)

    pairs = first[count == 2]
    same_way = key[pairs[key[pairs] == key[pairs + 1]]] >> 1
    many = key[first[count > 2]] >> 1
    return half_edges, _ends(many, n_vertices), _ends(same_way, n_vertices)


def _ends(edge_keys: IntArray, n_vertices: int) -> BoolArray:
    mask = np.zeros(n_vertices, dtype=bool)
    mask[edge_keys // n_vertices] = True
    mask[edge_keys % n_vertices] = True
    return mask


def _groups(half_edges: IntArray, component: NDArray) -> Iterator[IntArray]:
    """Split half-edges by the connected component that they belong to."""
    if not len(half_edges):
        return
    label = component[half_edges[:, 0]]
    order = np.argsort(label, kind="stable")
    yield from np.split(half_edges[order], np.flatnonzero(np.diff(label[order])) + 1)


def _next_half_edges(mesh: TriangleMesh, half_edges: IntArray, n_out: IntArray) -> IntArray:
    """Return for each half-edge the index of the one that follows it around its hole, (B,)."""
    leaving = np.full(mesh.n_vertices, -1, dtype=np.int64)
    leaving[half_edges[:, 0]] = np.arange(len(half_edges))
    following = leaving[half_edges[:, 1]]
    pinched = np.flatnonzero(n_out > 1)
    pinched = pinched[leaving[pinched] >= 0]
    if not len(pinched):
        return following
    is_pinched = np.zeros(mesh.n_vertices, dtype=bool)
    is_pinched[pinched] = True
    around = mesh.faces[is_pinched[mesh.faces].any(axis=1)]
    for vertex in pinched:
        faces = mesh.vertices[around[(around == vertex).any(axis=1)]]
        normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]).sum(axis=0)
        arriving = np.flatnonzero(half_edges[:, 1] == vertex)
        departing = np.flatnonzero(half_edges[:, 0] == vertex)
        from_angle = _angles(mesh.vertices[half_edges[arriving, 0]] - mesh.vertices[vertex], normal)
        to_angle = _angles(mesh.vertices[half_edges[departing, 1]] - mesh.vertices[vertex], normal)
        gap = np.mod(to_angle[None] - from_angle[:, None], 2 * np.pi)
        rows, columns = linear_sum_assignment(gap)
        following[arriving[rows]] = departing[columns]
    return following


def _angles(directions: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the angle of each direction (n, 3) in the plane across ``normal``, in radians."""
    length = float(np.linalg.norm(normal))
    axis = normal / length if length else np.array([0.0, 0.0, 1.0])
    first = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    return np.arctan2(directions @ np.cross(axis, first), directions @ first)


def _walk(half_edges: IntArray, following: IntArray) -> Iterator[list[int]]:
    """Yield simple loops as lists of half-edge indices."""
    starts = half_edges[:, 0].tolist()
    after = following.tolist()
    visited = bytearray(len(after))
    for begin in range(len(after)):
        if visited[begin]:
            continue
        path: list[int] = []
        position_of: dict[int, int] = {}
        current = begin
        while not visited[current]:
            visited[current] = 1
            vertex = starts[current]
            if vertex in position_of:
                cut = position_of[vertex]
                for index in path[cut:]:
                    del position_of[starts[index]]
                yield path[cut:]
                del path[cut:]
            position_of[vertex] = len(path)
            path.append(current)
            current = after[current]
        yield path


def _described(vertices: FloatArray, found: list[tuple[IntArray, str]]) -> tuple[BoundaryLoop, ...]:
    """Measure all loops at once; a scan can have thousands."""
    edges = np.concatenate([loop for loop, _ in found])
    counts = np.array([len(loop) for loop, _ in found])
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    positions = vertices[edges[:, 0]]
    lengths = np.linalg.norm(vertices[edges[:, 1]] - positions, axis=1)
    perimeters = np.add.reduceat(lengths, first)
    ends = vertices[edges]
    extents = np.maximum.reduceat(ends.max(axis=1), first) - np.minimum.reduceat(ends.min(axis=1), first)
    sizes = np.linalg.norm(extents, axis=1)
    centers = np.add.reduceat(positions, first) / counts[:, None]
    lowest = np.array([int(loop.min()) for loop, _ in found])
    return tuple(
        BoundaryLoop(
            edges=read_only(found[index][0], np.int64),
            perimeter=float(perimeters[index]),
            size=float(sizes[index]),
            center=read_only(centers[index], np.float64),
            problem=found[index][1],
        )
        for index in np.lexsort((lowest, -perimeters))
    )
