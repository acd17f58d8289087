"""What is odd about a mesh, where, and what that means for its restoration."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from dmp.boundary import BoundaryLoop, boundary_loops, outer_rims
from dmp.corner_groups import corner_groups, groups_at_vertices, pairs_over_edges
from dmp.geometry import face_area_vectors, mean_edge_length
from dmp.joining import duplicate_rows, join_copies
from dmp.mesh import BoolArray, FloatArray, IntArray, TriangleMesh
from dmp.orientation import orientation
from dmp.topology import adjacency, connected_vertices, edge_face_counts

Severity = Literal["note", "warning"]
# Whether repair mends it: by itself, only when asked for (see dmp.repair.RepairOptions), or not at all.
Remedy = Literal["repair", "on request", "none"]

# A face whose height is this small a share of its longest side has no area for all practical purposes ...
FLAT = 1e-7
# ... and from here on it is thin.
_THIN = 0.02
# Unconnected vertices nearer than this, in mean edge lengths and in shortest ones, were probably meant to be one.
_CLOSE, _CLOSE_SHARE = 0.01, 0.1
# Rounding to single precision that moves vertices by more than this, in mean edge lengths, is told.
_ROUNDING = 1e-3
_SMALL_PIECE = 0.01


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that is odd about a mesh.

    Attributes:
        kind: its name in code and JSON.
        count: how many there are.
        text: what was found, one sentence.
        meaning: what it means for the result, one or two sentences.
        severity: ``warning`` for what harms the result or the tools behind it, ``note`` for what is good to know.
        remedy: ``repair``, ``on request`` (repair does it when asked to), or ``none``.
        vertices: affected vertices, (n,), ascending.
        edges: affected edges, (n, 2), where edges are what is affected.
    """

    kind: str
    count: int
    text: str
    meaning: str
    severity: Severity
    remedy: Remedy = "none"
    vertices: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    edges: IntArray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))

    def values(self) -> dict[str, Any]:
        """Return the finding as plain values for JSON, with the first hundred of its vertices."""
        return {
            "kind": self.kind,
            "count": self.count,
            "severity": self.severity,
            "text": self.text,
            "meaning": self.meaning,
            "remedy": self.remedy,
            "vertices": self.vertices[:100].tolist(),
        }


def mesh_report(mesh: TriangleMesh) -> tuple[Finding, ...]:
    """Return what is odd about ``mesh``, warnings first; nothing for a clean closed one in one piece."""
    if not mesh.n_faces:
        return ()
    looked_at = _Look(mesh)
    checks: tuple[Callable[[_Look], Iterator[Finding]], ...] = (
        _duplicate_vertices, _close_vertices, _non_manifold_edges, _non_manifold_vertices, _duplicate_faces, _degenerate_faces,
        _flipped_faces, _isolated_vertices, _boundaries, _pieces, _thin_faces, _far_away,
    )  # fmt: skip
    found = [finding for check in checks for finding in check(looked_at)]
    return tuple(sorted(found, key=lambda finding: finding.severity == "note"))


def flat_faces(vertices: FloatArray, faces: IntArray, share: float = FLAT) -> BoolArray:
    """Tell which faces (F, 3) are no higher than ``share`` of their longest side, (F,)."""
    corners = vertices[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    return np.linalg.norm(face_area_vectors(vertices, faces), axis=1) <= share * longest**2


class _Look:
    """What several checks need to know of a mesh."""

    def __init__(self, mesh: TriangleMesh) -> None:
        self.mesh = mesh
        faces = mesh.faces
        self.collapsed = (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
        self.proper = np.flatnonzero(~self.collapsed)
        self.repeated = self.proper[duplicate_rows(np.sort(faces[self.proper], axis=1))[1]]
        # Each proper face once.
        self.faces = faces[np.setdiff1d(self.proper, self.repeated, assume_unique=True)]
        self.connected = connected_vertices(faces, mesh.n_vertices)
        self.edges, self.edge_counts = edge_face_counts(self.faces)
        self.edge_length = mean_edge_length(mesh.vertices, self.edges) if len(self.edges) else 0.0


def _counted(number: int, one: str, many: str) -> str:
    return f"1 {one}" if number == 1 else f"{number:,} {many}"


def _duplicate_vertices(look: _Look) -> Iterator[Finding]:
    target, repeated = duplicate_rows(look.mesh.vertices)
    repeated = repeated[look.connected[repeated] & look.connected[target[repeated]]]
    if not len(repeated):
        return
    joined = np.arange(look.mesh.n_vertices)
    joined[repeated] = target[repeated]
    joined = join_copies(look.mesh.vertices, look.faces, np.where(look.connected, target, np.arange(len(target))))
    torn = np.flatnonzero(joined != np.arange(len(joined)))
    if len(torn):
        yield Finding(
            "duplicate vertices",
            len(torn),
            _counted(len(torn), "vertex lies", "vertices lie") + " exactly where another one lies.",
            "The surface is not joined there: each copy moves by itself, and a crack opens between them.",
            "warning",
            "repair",
            np.union1d(torn, joined[torn]),
        )
    # What is still at one place after that only touches.
    kept = np.setdiff1d(np.union1d(repeated, target[repeated]), torn)
    copies = np.bincount(target[kept], minlength=len(target))
    places = np.flatnonzero(copies > 1)
    if len(places):
        yield Finding(
            "touching surfaces",
            len(places),
            "Surfaces touch at " + _counted(len(places), "vertex", "vertices") + " without being joined.",
            "They are restored one by one, and may come apart a little there or run into each other.",
            "note",
            "none",
            kept[copies[target[kept]] > 1],
        )


def _close_vertices(look: _Look) -> Iterator[Finding]:
    rim = np.unique(look.edges[look.edge_counts == 1])
    if len(rim) < 2 or not look.edge_length:
        return
    # Exact duplicates are another finding.
    rim = np.delete(rim, duplicate_rows(look.mesh.vertices[rim])[1])
    n_vertices = look.mesh.n_vertices
    pairs = rim[cKDTree(look.mesh.vertices[rim]).query_pairs(_CLOSE * look.edge_length, output_type="ndarray")]
    joined = np.isin(pairs.min(axis=1) * n_vertices + pairs.max(axis=1), look.edges[:, 0] * n_vertices + look.edges[:, 1])
    # Where all edges are short, near is not near.
    lengths = np.linalg.norm(look.mesh.vertices[look.edges[:, 0]] - look.mesh.vertices[look.edges[:, 1]], axis=1)
    shortest = np.full(n_vertices, np.inf)
    np.minimum.at(shortest, look.edges.ravel(), np.repeat(lengths, 2))
    gaps = np.linalg.norm(look.mesh.vertices[pairs[:, 0]] - look.mesh.vertices[pairs[:, 1]], axis=1)
    close = np.unique(pairs[~joined & (gaps < _CLOSE_SHARE * shortest[pairs].min(axis=1))])
    if len(close):
        yield Finding(
            "close vertices",
            len(close),
            _counted(len(close), "vertex", "vertices")
            + f" at open edges lie nearer than {_CLOSE:g} of an edge length to another one without being joined to it.",
            "They were probably meant to be one. A crack opens between them.",
            "warning",
            "on request",
            close,
        )


def _non_manifold_edges(look: _Look) -> Iterator[Finding]:
    edges = look.edges[look.edge_counts > 2]
    if len(edges):
        yield Finding(
            "non-manifold edges",
            len(edges),
            _counted(len(edges), "edge belongs", "edges belong") + " to more than two faces.",
            "The surface branches there. Training works, but the sheets that meet pull at each other, and a hole at such "
            "an edge cannot be filled.",
            "warning",
            "on request",
            np.unique(edges),
            edges,
        )


def _non_manifold_vertices(look: _Look) -> Iterator[Finding]:
    groups = corner_groups(look.faces, pairs_over_edges(look.faces))
    touching = np.flatnonzero(groups_at_vertices(look.faces, groups, look.mesh.n_vertices) > 1)
    if len(touching):
        yield Finding(
            "non-manifold vertices",
            len(touching),
            _counted(len(touching), "vertex joins", "vertices join") + " parts of the surface that touch nowhere else.",
            "Training works, but such a vertex is drawn to all of these parts and may end up between them.",
            "warning",
            "on request",
            touching,
        )


def _duplicate_faces(look: _Look) -> Iterator[Finding]:
    if len(look.repeated):
        yield Finding(
            "duplicate faces",
            len(look.repeated),
            _counted(len(look.repeated), "face is", "faces are") + " there a second time.",
            "They count double in everything that is measured, and a hole beside them cannot be filled.",
            "warning",
            "repair",
            np.unique(look.mesh.faces[look.repeated]),
        )


def _degenerate_faces(look: _Look) -> Iterator[Finding]:
    degenerate = look.collapsed.copy()
    degenerate[look.proper] = flat_faces(look.mesh.vertices, look.mesh.faces[look.proper])
    count = int(np.count_nonzero(degenerate))
    if count:
        yield Finding(
            "degenerate faces",
            count,
            _counted(count, "face has", "faces have") + " no area.",
            "They have no direction that they face: normals are wrong around them, and the noise is estimated wrongly there.",
            "warning",
            "repair",
            np.unique(look.mesh.faces[degenerate]),
        )


def _flipped_faces(look: _Look) -> Iterator[Finding]:
    turned = orientation(look.mesh.vertices, look.faces)
    flipped = turned.flips & ~turned.inside_out
    count = int(np.count_nonzero(flipped))
    if count:
        yield Finding(
            "flipped faces",
            count,
            _counted(count, "face looks", "faces look") + " the other way than those around.",
            "Normals cancel out there, so the noise is estimated wrongly, the signed displacement changes its sign, and holes "
            "at such faces cannot be filled.",
            "warning",
            "repair",
            np.unique(look.faces[flipped]),
        )
    if turned.n_inside_out:
        yield Finding(
            "inside out",
            turned.n_inside_out,
            _counted(turned.n_inside_out, "closed piece is", "closed pieces are") + " inside out.",
            "The restored shape is the same, but inwards and outwards are exchanged in the signed displacement and in other "
            "programs.",
            "warning",
            "repair",
            np.unique(look.faces[turned.inside_out]),
        )
    if turned.one_sided.any():
        yield Finding(
            "one-sided surface",
            int(np.count_nonzero(turned.one_sided)),
            "The surface has one side only, like a Moebius strip.",
            "There is no inside: the signed displacement means nothing there, and normals jump somewhere.",
            "note",
        )


def _isolated_vertices(look: _Look) -> Iterator[Finding]:
    isolated = np.flatnonzero(~look.connected)
    if len(isolated):
        yield Finding(
            "isolated vertices",
            len(isolated),
            _counted(len(isolated), "vertex belongs", "vertices belong") + " to no face.",
            "Nothing can be learnt for them: they stay where they are.",
            "note",
            "repair",
            isolated,
        )


def _boundaries(look: _Look) -> Iterator[Finding]:
    loops = boundary_loops(TriangleMesh(look.mesh.vertices, look.faces))
    if not loops:
        return
    rims = set(outer_rims(look.mesh, loops))
    kinds = [
        (sum(loop.is_simple and index not in rims for index, loop in enumerate(loops)), "hole", "holes"),
        (len(rims), "outer rim", "outer rims"),
        (sum(not loop.is_simple for loop in loops), "boundary that cannot be filled", "boundaries that cannot be filled"),
    ]
    parts = [_counted(number, one, many) for number, one, many in kinds if number]
    open_edges = np.concatenate([loop.edges for loop in loops])
    meaning = "They stay open when noise is removed. Vertices there have fewer neighbours to learn from."
    if kinds[0][0]:
        meaning += " Filling holes is a task of its own."
    yield Finding(
        "boundaries", len(loops), f"The surface is open: {_listed(parts)}.", meaning, "note", "none", _ends(loops), open_edges
    )


def _ends(loops: tuple[BoundaryLoop, ...]) -> IntArray:
    return np.unique(np.concatenate([loop.edges for loop in loops]))


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _pieces(look: _Look) -> Iterator[Finding]:
    labels = connected_components(adjacency(look.faces, look.mesh.n_vertices), directed=False)[1]
    sizes = np.bincount(labels[look.faces[:, 0]])
    sizes = np.where(sizes > 0, sizes, look.mesh.n_faces + 1)
    count = int(np.count_nonzero(sizes <= look.mesh.n_faces))
    if count < 2:
        return
    small = np.flatnonzero(sizes < _SMALL_PIECE * len(look.faces))
    text = f"The mesh has {count:,} separate pieces, the smallest with {_counted(int(sizes.min()), 'face', 'faces')}."
    if len(small) > 1:
        text = f"{text[:-1]}; {len(small):,} have less than a hundredth of all faces."
    yield Finding(
        "separate pieces",
        count,
        text,
        "Each is restored by itself. In a tiny one there is little to learn, so it mostly gets smoother; if it is a crumb of "
        "the scan, it is better left out.",
        "note",
        "on request",
        np.flatnonzero(np.isin(labels, small) & look.connected),
    )


def _thin_faces(look: _Look) -> Iterator[Finding]:
    vertices = look.mesh.vertices
    thin = flat_faces(vertices, look.faces, _THIN) & ~flat_faces(vertices, look.faces)
    count = int(np.count_nonzero(thin))
    if count:
        yield Finding(
            "thin faces",
            count,
            _counted(count, "face is", "faces are") + f" more than {1 / _THIN:.0f} times as long as high.",
            "Every edge counts alike, whatever its length, so places with such faces are smoothed unevenly. Remeshing evens "
            "them out, for example 'Isotropic Explicit Remeshing' in MeshLab.",
            "note",
            "none",
            np.unique(look.faces[thin]),
        )


def _far_away(look: _Look) -> Iterator[Finding]:
    if not look.edge_length:
        return
    places = look.mesh.vertices[look.connected]
    reach = float(np.abs(places).max())
    rounding = reach * float(np.finfo(np.float32).eps) / 2 / look.edge_length
    size = float(np.linalg.norm(np.ptp(places, axis=0)))
    step = float(np.spacing(reach)) / look.edge_length
    if step > _ROUNDING:
        yield Finding(
            "far from the origin",
            1,
            f"The mesh lies {reach / size:,.0f} times its size away from the origin.",
            f"So far away even double precision only has places that are {step:.2g} edge lengths apart: the shape has "
            "already been rounded to them. Move the mesh to the origin in the program it came from.",
            "warning",
        )
    elif rounding > _ROUNDING:
        yield Finding(
            "far from the origin",
            1,
            f"The mesh lies {reach / size:,.0f} times its size away from the origin.",
            f"In single precision its vertices would move by up to {rounding:.2g} edge lengths. Here nothing is lost: all is "
            "computed around the middle of the mesh. Save it as PLY, OBJ or OFF; STL and many programs round.",
            "note",
        )
