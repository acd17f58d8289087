"""How much a small file may become in memory: the rule for all formats that compress or repeat what they hold."""

from __future__ import annotations

from dmp.formats.source import FormatError

# Four million vertices and corners take about half a gigabyte while they are joined and checked.
_REPEATED = 4_000_000
_UNPACKED = 32 << 20
_UNPACKED_PER_BYTE = 40


def check_repeated(n_vertices: int, n_corners: int, file_bytes: int) -> None:
    """Refuse a file whose parts are placed so often that the mesh would be far larger than the file.

    Args:
        n_vertices: vertices of all placed parts together.
        n_corners: corners of their faces.
        file_bytes: size of the file.

    Raises:
        FormatError: above 4 million, or two for each byte of a large file.
    """
    if n_vertices + n_corners > max(_REPEATED, 2 * file_bytes):
        raise FormatError(
            f"the parts of the file are placed so often that the mesh would have {n_vertices:,} vertices and {n_corners:,} "
            f"corners of faces, far more than the {file_bytes:,} bytes of the file hold",
            "Save only the part that you need, with each part once.",
        )


def largest_unpacked(packed_bytes: int) -> int:
    """Return to how many bytes compressed data may grow: fortyfold, and 32 MiB in any case."""
    return max(_UNPACKED, _UNPACKED_PER_BYTE * packed_bytes)
