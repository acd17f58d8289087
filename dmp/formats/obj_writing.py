"""Writing Wavefront OBJ with exact positions, and colours where the vertices have some."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dmp.mesh import TriangleMesh

_ROWS = 20_000


def write_obj(mesh: TriangleMesh) -> Iterator[bytes]:
    """Yield a mesh as OBJ, positions with all digits that make them unique, and colours after them.

    Colours of whole numbers (0 to 255, or to the largest of their type) are written as 0 to 1, as OBJ wants them.
    """
    yield f"# Written by dmp-viewer\n# Vertices: {mesh.n_vertices}\n# Faces: {mesh.n_faces}\n".encode()
    values = mesh.vertices
    colours = mesh.vertex_attributes.get("color")
    if has_colours(mesh) and colours is not None:
        if colours.dtype.kind in "ui":
            colours = colours / np.iinfo(colours.dtype).max
        values = np.concatenate([values, colours[:, :3].astype(np.float64)], axis=1)
    row = "v" + " %r" * values.shape[1] + "\n"
    for begin in range(0, len(values), _ROWS):
        rows = values[begin : begin + _ROWS]
        yield (row * len(rows) % tuple(rows.ravel().tolist())).encode()
    for begin in range(0, mesh.n_faces, _ROWS):
        corners = mesh.faces[begin : begin + _ROWS] + 1
        yield ("f %d %d %d\n" * len(corners) % tuple(corners.ravel().tolist())).encode()


def has_colours(mesh: TriangleMesh) -> bool:
    """Tell whether the attribute ``color`` of a mesh can be written as OBJ colours."""
    colours = mesh.vertex_attributes.get("color")
    return (
        colours is not None
        and colours.ndim == 2
        and colours.shape[1] in (3, 4)
        and colours.dtype.kind in "uif"
        and bool(np.isfinite(colours).all())
    )
