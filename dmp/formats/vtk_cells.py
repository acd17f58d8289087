"""The cells of VTK PolyData: polygons and triangle strips become faces; points and lines are left out."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dmp.formats.assemble import PolygonMesh, counted
from dmp.formats.ply_writing import property_columns
from dmp.formats.source import FormatError
from dmp.formats.strips import unroll_strips
from dmp.formats.text import show
from dmp.mesh import FloatArray, IntArray

_RESAVE = "Save or copy the file again from where it came from."
_COLOUR_NAMES = {"rgb", "rgba", "color", "colors", "colour", "colours"}


@dataclass
class Piece:
    """A part of a PolyData file.

    Attributes:
        where: what to call it in messages, such as "piece 0".
        points: positions (V, 3).
        polygons: vertex indices of all polygons one after the other, and how many each has.
        strips: the same for triangle strips.
        n_points_cells: cells that are single points.
        n_lines: cells that are lines.
        values: numbers of the vertices by name, each with V rows.
    """

    where: str
    points: FloatArray
    polygons: tuple[IntArray, IntArray]
    strips: tuple[IntArray, IntArray]
    n_points_cells: int = 0
    n_lines: int = 0
    values: dict[str, NDArray] = field(default_factory=dict)


def counts_of(offsets: IntArray, n_corners: int, where: str) -> IntArray:
    """Return the corners of each cell from the places where the cells end.

    Raises:
        FormatError: when the places do not rise, or the last one is not the end of all corners.
    """
    # Comparing is safe where subtracting would overflow.
    if len(offsets) and (offsets[0] < 0 or (offsets[1:] < offsets[:-1]).any() or offsets[-1] != n_corners):
        raise FormatError(f"{where}: the places where cells begin and end do not fit to their {n_corners:,} corners", _RESAVE)
    return np.diff(offsets, prepend=0)


def join_pieces(pieces: list[Piece], notes: list[str]) -> PolygonMesh:
    """Return all pieces as one mesh: their vertices one piece after the other, and of each the polygons, then the strips.

    Raises:
        FormatError: with the cell, when a corner refers to a vertex that its piece does not have.
    """
    corners, counts, labels = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)], [""]
    first = n_triangles = 0
    for piece in pieces:
        indices, sizes = piece.polygons
        _check(indices, sizes, len(piece.points), f"{piece.where}, polygon")
        corners.append(indices + first)
        counts.append(sizes)
        labels.append(f"{piece.where}, polygon")
        if len(piece.strips[1]):
            _check(*piece.strips, len(piece.points), f"{piece.where}, strip")
            triangles, _ = unroll_strips(*piece.strips)
            corners.append(triangles.ravel() + first)
            counts.append(np.full(len(triangles), 3, dtype=np.int64))
            labels.append(f"{piece.where}, triangle of a strip")
            n_triangles += len(triangles)
        first += len(piece.points)
    if n_triangles:
        notes.append(f"Split triangle strips into {counted(n_triangles, 'triangle')}.")
    n_faces = sum(len(sizes) for sizes in counts)
    for name, n in (("point", sum(p.n_points_cells for p in pieces)), ("line", sum(p.n_lines for p in pieces))):
        if n and not n_faces:
            raise FormatError(
                f"the file holds {counted(n, name)} but no faces",
                "Turn it into a triangle mesh first, for example in ParaView or MeshLab.",
            )
        if n:
            notes.append(f"Left out {counted(n, name)}.")
    attributes = plain_attributes(_common_values(pieces, notes), notes)
    ends = np.cumsum([len(sizes) for sizes in counts])

    def place(face: int) -> str:
        block = int(np.searchsorted(ends, face, side="right"))
        return f"{labels[block]} {face - int(ends[block - 1]):,}"

    return PolygonMesh(
        vertices=np.concatenate([np.zeros((0, 3)), *(piece.points for piece in pieces)]),
        corners=np.concatenate(corners),
        counts=np.concatenate(counts),
        place=place,
        attributes=attributes,
        notes=notes,
    )


def _check(indices: IntArray, counts: IntArray, n_points: int, what: str) -> None:
    bad = np.flatnonzero((indices < 0) | (indices >= n_points))
    if len(bad):
        cell = int(np.searchsorted(np.cumsum(counts), bad[0], side="right"))
        raise FormatError(
            f"{what} {cell:,} refers to vertex {int(indices[bad[0]]):,}, but there are vertices 0 to {n_points - 1:,}", _RESAVE
        )


def _common_values(pieces: list[Piece], notes: list[str]) -> dict[str, NDArray]:
    """Return the values that all pieces have in the same form, one piece after the other."""
    filled = [piece for piece in pieces if len(piece.points)]
    if not filled:
        return {}
    forms = [{name: (values.dtype, values.shape[1:]) for name, values in piece.values.items()} for piece in filled]
    names = [name for name in forms[0] if all(form.get(name) == forms[0][name] for form in forms)]
    partial = {name for form in forms for name in form} - set(names)
    if partial:
        notes.append(f"Left out values that only some pieces have: {_listed(sorted(partial))}.")
    return {name: np.concatenate([piece.values[name] for piece in filled]) for name in names}


def plain_attributes(values: Mapping[str, NDArray], notes: list[str]) -> dict[str, NDArray]:
    """Return numbers of the vertices as attributes of a mesh, under names that every writer of this program can keep.

    Blanks in names become underscores; colours get the name ``color``; what still cannot be kept is left out with a note.

    Args:
        values: (V,) or (V, k) numbers by name.
        notes: receives a sentence on what is left out.
    """
    kept: dict[str, NDArray] = {}
    taken: set[str] = {"x", "y", "z", "nx", "ny", "nz"}
    left_out: list[str] = []
    for name, array in values.items():
        column = array[:, 0] if array.ndim == 2 and array.shape[1] == 1 else array
        plain = re.sub(r"[\s\x00-\x1f\x7f]+", "_", name.strip())
        if plain.lower() in _COLOUR_NAMES and column.ndim == 2 and column.shape[1] in (3, 4):
            plain = "color"
        try:
            columns = property_columns(plain, column)
        except FormatError:
            left_out.append(name)
            continue
        # "name_0" beside "name" with several columns would not come back as it was written.
        stems = {plain, *columns}
        if not plain.isprintable() or stems & taken or re.search(r"_\d+$", plain):
            left_out.append(name)
            continue
        taken |= stems
        kept[plain] = column
    if left_out:
        notes.append(f"Left out values of the vertices whose names or types cannot be kept: {_listed(left_out)}.")
    return kept


def _listed(names: list[str]) -> str:
    shown = ", ".join(f"'{show(name.encode(errors='replace'))}'" for name in names[:5])
    return f"{shown} and {len(names) - 5} more" if len(names) > 5 else shown
