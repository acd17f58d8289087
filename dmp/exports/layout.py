"""Where everything is in a picture; needed to fit the meshes into their panes before anything is drawn."""

from __future__ import annotations

from itertools import pairwise

from dmp.exports.scenes import Sheet


class Layout:
    """Where everything is in a picture.

    Args:
        sheet: size, and what there is beside the meshes.
        n_panes: how many panes.
    """

    def __init__(self, sheet: Sheet, n_panes: int) -> None:
        self.text_size = max(9, round(min(sheet.width / n_panes / 32, sheet.height / 36)))
        self.title_height = round(2.1 * self.text_size) if sheet.has_titles else 0
        has_bar = sheet.has_scale and sheet.scale is not None
        self.bar_height = round(3.6 * self.text_size) if has_bar else 0
        height = sheet.height - self.title_height - self.bar_height
        edges = [round(sheet.width * number / n_panes) for number in range(n_panes + 1)]
        self.panes = [(left, self.title_height, right - left, max(1, height)) for left, right in pairwise(edges)]

    @property
    def pane_aspect(self) -> float:
        """Width of a pane divided by its height."""
        _, _, width, height = self.panes[0]
        return width / height
