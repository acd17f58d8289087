"""Small pictures of meshes, computed without OpenGL so that any thread can make them."""

from __future__ import annotations

import struct
import zlib
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dmp.geometry import face_normals
from dmp.mesh import TriangleMesh

UpAxis = Literal["y", "z"]

# Direction to the eye and upwards, for each axis that can point up; the light comes from the upper right of the eye.
_VIEWS = {"y": ((0.45, 0.35, 1.0), (0.0, 1.0, 0.0)), "z": ((0.75, -0.8, 0.4), (0.0, 0.0, 1.0))}
_LIGHT = np.array([0.3, 0.55, 0.78])


def thumbnail(
    mesh: TriangleMesh, width: int, height: int, color: tuple[float, float, float], up: UpAxis = "y"
) -> NDArray[np.uint8]:
    """Draw a mesh, flat shaded, on a transparent ground.

    Args:
        mesh: the mesh; triangles larger than about a dozen pixels would show gaps, so pictures are small.
        width: pixels.
        height: pixels.
        color: of the surface, three numbers from 0 to 1.
        up: the axis that points up.

    Returns:
        (height, width, 4) RGBA.
    """
    eye, above = (np.array(direction) for direction in _VIEWS[up])
    eye /= np.linalg.norm(eye)
    right = np.cross(above, eye)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(eye, right), eye])
    turned = (mesh.vertices - (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2) @ axes.T
    low, high = turned.min(axis=0), turned.max(axis=0)
    size = max((high[0] - low[0]) / width, (high[1] - low[1]) / height, 1e-300) * 1.08
    x = (turned[:, 0] - (low[0] + high[0]) / 2) / size + width / 2
    y = height / 2 - (turned[:, 1] - (low[1] + high[1]) / 2) / size
    corners = np.column_stack([x, y, turned[:, 2]])[mesh.faces]

    sides = np.linalg.norm((corners - np.roll(corners, 1, axis=1))[..., :2], axis=-1).max(axis=1)
    side = float(np.percentile(sides, 98))
    # Of triangles that are smaller than a pixel, their middles leave no gaps.
    grid = np.full((1, 3), 1 / 3) if side < 0.7 else _barycentric_grid(int(np.clip(side * 1.5, 3, 24)))
    points = np.einsum("gk,fkc->fgc", grid, corners)
    pixel_x = np.clip(points[..., 0].astype(np.int64), 0, width - 1)
    pixel_y = np.clip(points[..., 1].astype(np.int64), 0, height - 1)
    pixels = (pixel_y * width + pixel_x).ravel()
    order = np.argsort(points[..., 2].ravel(), kind="stable")  # later writes win, so the nearest point is last

    normals = face_normals(mesh.vertices, mesh.faces) @ axes.T
    diffuse = np.clip(normals @ _LIGHT, 0, 1)
    shade = np.repeat(0.28 + 0.72 * diffuse, len(grid))
    image = np.zeros((height * width, 4))
    image[pixels[order], :3] = shade[order, None] * np.asarray(color)
    image[pixels[order], 3] = 1.0
    return (image.reshape(height, width, 4) * 255).round().clip(0, 255).astype(np.uint8)


def _barycentric_grid(parts: int) -> NDArray[np.float64]:
    """Return points spread over a triangle whose sides are cut into ``parts``, (n, 3) barycentric coordinates."""
    return np.array([(i, j, parts - i - j) for i in range(parts + 1) for j in range(parts + 1 - i)]) / parts


def png_bytes(pixels: NDArray[np.uint8]) -> bytes:
    """Return a picture, (height, width, 3 or 4) uint8, as the content of a PNG file (PNG specification, third edition)."""
    height, width, channels = pixels.shape

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    rows = np.hstack([np.zeros((height, 1), np.uint8), np.ascontiguousarray(pixels).reshape(height, width * channels)])
    header = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    parts = (chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(rows.tobytes(), 9)), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)
