"""Open surfaces with a boundary, in closed form."""

from __future__ import annotations

import numpy as np

from dmp.mesh import TriangleMesh


def wavy_sheet(n_columns: int, n_rows: int | None = None) -> TriangleMesh:
    """Return a rectangular height field z = 0.12 (sin 5x + cos 7y) over [-1, 1]^2, of almost equilateral triangles.

    Every second row is shifted by half an edge; the ends of the shifted rows are drawn to the straight boundary.

    Args:
        n_columns: vertices in a row, 2 or more.
        n_rows: vertices in a column; as many as make the triangles even if None.
    """
    edge = 2.0 / (n_columns - 1)
    rows = n_rows if n_rows is not None else round(2.0 / (edge * np.sqrt(0.75))) + 1
    column, row = np.meshgrid(np.arange(n_columns), np.arange(rows))
    x = np.clip(-1.0 + edge * (column + 0.5 * (row % 2) * (column < n_columns - 1) * (column > 0)), -1.0, 1.0)
    y = -1.0 + 2.0 * row / (rows - 1)
    z = 0.12 * (np.sin(5.0 * x) + np.cos(7.0 * y))
    index = np.arange(rows * n_columns).reshape(rows, n_columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    # The shorter diagonal runs from the lower left in shifted rows and from the lower right in the others.
    shifted = (np.arange(rows - 1) % 2 == 1)[:, None]
    first = np.stack([a, b, np.where(shifted, c, d)], axis=-1)
    second = np.stack([np.where(shifted, a, b), c, d], axis=-1)
    faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)])
    return TriangleMesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces)
