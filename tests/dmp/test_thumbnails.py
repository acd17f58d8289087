"""Small pictures of meshes, and their files."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.image import imread

from dmp.mesh import TriangleMesh
from dmp.thumbnails import png_bytes, thumbnail


@pytest.mark.parametrize("channels", [3, 4])
def test_a_png_file_holds_the_pixels(channels: int) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (5, 7, channels), dtype=np.uint8)
    assert np.array_equal((imread(io.BytesIO(png_bytes(pixels))) * 255).round().astype(np.uint8), pixels)


def test_a_sphere_is_a_disc(sphere: TriangleMesh) -> None:
    drawn = thumbnail(sphere, 60, 60, (1.0, 0.5, 0.0))[..., 3] > 0
    y, x = np.nonzero(drawn)
    assert drawn[30, 30]
    assert not drawn[[0, 0, -1, -1], [0, -1, 0, -1]].any()
    # The area of a disc as wide as what is drawn.
    assert drawn.sum() == pytest.approx(np.pi * np.ptp(x) * np.ptp(y) / 4, rel=0.1)
