"""Splitting polygons: the triangles cover the polygon exactly, look the same way, and do not overlap."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmp.formats.polygons import triangulate
from dmp.formats.source import FormatError
from dmp.mesh import FloatArray, IntArray

L_SHAPE = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
DART = [[0, 0], [2, -1], [0.5, 0], [2, 1]]
COMB = [
    [0, 0],
    [7, 0],
    *[[x, y] for left in (6, 4, 2, 0) for x, y in ((left + 1, 3), (left, 3), (left, 1), (left - 1, 1))][:-2],
]
COLLINEAR = [[0, 0], [1, 0], [2, 0], [3, 0], [3, 3], [0, 3]]
# A square with a square hole, tied to the outline by an edge that is used twice.
KEYHOLE = [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0], [1, 1], [1, 3], [3, 3], [3, 1], [1, 1]]


def split(points: FloatArray) -> IntArray:
    return triangulate(points, np.arange(len(points)), np.array([len(points)]))


def signed_areas(points: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def shoelace(points: FloatArray) -> float:
    x, y = points[:, 0], points[:, 1]
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def in_space(points: list, seed: int = 0) -> FloatArray:
    """Place flat points in a plane of any direction, far from the origin."""
    rotation, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return np.column_stack([np.array(points, dtype=float), np.zeros(len(points))]) @ rotation.T + [1e4, -2e4, 3e4]


@pytest.mark.parametrize("outline", [L_SHAPE, DART, COMB, COLLINEAR, KEYHOLE])
@pytest.mark.parametrize("shift", range(4))
@pytest.mark.parametrize("turned_round", [False, True])
def test_positive_areas_that_add_up_mean_an_exact_cover(outline: list, shift: int, turned_round: bool) -> None:
    flat = np.roll(np.array(outline, dtype=float), shift, axis=0)
    if turned_round:
        flat = flat[::-1]
    faces = split(in_space(flat.tolist()))
    areas = signed_areas(flat, faces) * (-1 if turned_round else 1)
    # Triangles inside the plane that all turn like the outline and add up to its area can neither overlap nor stick out.
    assert len(faces) == len(flat) - 2
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(abs(shoelace(flat)))


@settings(max_examples=60, deadline=None)
@given(st.integers(4, 40), st.integers(0, 2**32 - 1))
def test_star_shaped_polygons_with_random_radii(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = (np.arange(n) + 0.8 * rng.random(n)) * 2 * np.pi / n
    flat = np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(0.1, 1, (n, 1))
    areas = signed_areas(flat, split(in_space(flat.tolist(), seed)))
    assert (areas > -1e-9).all()
    assert areas.sum() == pytest.approx(shoelace(flat), abs=1e-9)


def test_convex_polygons_are_fans_in_their_order() -> None:
    angles = np.arange(6) * np.pi / 3
    faces = split(in_space(np.column_stack([np.cos(angles), np.sin(angles)]).tolist()))
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]


def test_many_polygons_keep_their_order() -> None:
    outlines = [L_SHAPE, [[0, 0], [1, 0], [0, 1]], DART, COMB, [[0, 0], [1, 0], [1, 1], [0, 1]], KEYHOLE, L_SHAPE]
    counts = np.array([len(outline) for outline in outlines])
    flat = np.concatenate([np.array(outline, dtype=float) for outline in outlines])
    points = np.column_stack([flat, np.zeros(len(flat))])
    faces = triangulate(points, np.arange(len(points)), counts)
    owners = np.repeat(np.arange(len(counts)), counts)
    assert owners[faces[:, 0]].tolist() == np.repeat(np.arange(len(counts)), counts - 2).tolist()
    assert (owners[faces] == owners[faces[:, :1]]).all()
    for index, outline in enumerate(outlines):
        own = faces[owners[faces[:, 0]] == index]
        assert signed_areas(flat, own).sum() == pytest.approx(shoelace(np.array(outline, dtype=float)))


@pytest.mark.parametrize(
    "outline",
    [
        [[0, 0], [1, 1], [1, 0], [0, 1]],  # crosses itself
        [[0, 0], [1, 0], [2, 0], [3, 0], [4, 0]],  # has no area
        [[0, 0], [0, 0], [0, 0], [0, 0]],
    ],
)
def test_impossible_polygons_still_give_triangles(outline: list) -> None:
    faces = split(in_space(outline))
    assert faces.shape == (len(outline) - 2, 3)
    assert set(faces.ravel()) <= set(range(len(outline)))


def test_polygons_that_would_take_minutes_are_refused_at_once() -> None:
    n = 20_000
    zigzag = np.column_stack([np.arange(n, dtype=float), np.where(np.arange(n) % 2, 1.0, 0.0), np.zeros(n)])
    zigzag[-1] = [n / 2, 1e6, 0]
    start = time.perf_counter()
    with pytest.raises(FormatError, match="concave"):
        split(zigzag)
    with pytest.raises(FormatError, match="200,000 corners"):
        split(np.random.default_rng(0).random((200_000, 3)))
    assert time.perf_counter() - start < 2
