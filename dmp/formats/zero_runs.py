"""Telling a part of a file that was never written: it reads as zeros, so as many positions at the origin."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dmp.formats.source import FormatError

# A lost sector of a disk has 512 bytes, so 21 positions in double precision. No sensible mesh has so many vertices in a
# row at one point.
_LONGEST = 16


def longest_zero_run(rows: NDArray) -> tuple[int, int]:
    """Return where the longest run of rows of zeros begins, and its length (0 without any); ``rows`` has shape (N, …)."""
    if not len(rows):
        return 0, 0
    is_zero = ~rows.reshape(len(rows), -1).any(axis=1)
    if not is_zero.any():
        return 0, 0
    edges = np.flatnonzero(np.diff(is_zero.astype(np.int8), prepend=0, append=0))
    starts, ends = edges[::2], edges[1::2]
    longest = int((ends - starts).argmax())
    return int(starts[longest]), int(ends[longest] - starts[longest])


def refuse_zero_run(positions: NDArray, first_index: int = 0) -> None:
    """Refuse positions (V, 3), many of which in a row are exactly zero.

    Args:
        positions: positions in the order of the file.
        first_index: the number that the format gives to the first vertex, for the message.

    Raises:
        FormatError: when 16 or more in a row are zero.
    """
    if len(positions) < _LONGEST:
        return
    start, length = longest_zero_run(positions)
    if length >= _LONGEST:
        raise FormatError(
            f"the vertices {start + first_index:,} to {start + length - 1 + first_index:,} all lie at exactly 0 0 0, so a part "
            "of the file was never written",
            "Save or copy the file again from where it came from.",
        )


def refuse_unwritten_end(corners: NDArray, counts: NDArray, place: str) -> None:
    """Refuse faces of a binary file, the last of which is none: its corners are missing or all the first vertex.

    Args:
        corners: vertex indices of all faces or strips one after the other, (K,).
        counts: corners of each, (P,), with the sum K.
        place: what to call them in the message.

    Raises:
        FormatError: when the end of the file reads as zeros.
    """
    if len(counts) and (counts[-1] == 0 or not corners[-min(int(counts[-1]), 3) :].any()):
        raise FormatError(
            f"{place}: the last of them holds only zeros, so the file was never written to its end",
            "Save or copy the file again from where it came from.",
        )
