from __future__ import annotations

import numpy as np
import pytest

from dmp.exports.viewpoints import UP, Place, Viewpoint, front
from dmp.mesh import TriangleMesh


def projected(viewpoint: Viewpoint, points: np.ndarray, aspect: float) -> np.ndarray:
    """Return where points are in the picture, (N, 2), -1 to 1 on both axes: the pinhole camera by hand."""
    backward = np.subtract(viewpoint.position, viewpoint.focal_point)
    backward = backward / np.linalg.norm(backward)
    right = np.cross(viewpoint.up, backward)
    right /= np.linalg.norm(right)
    up = np.cross(backward, right)
    seen = points - np.array(viewpoint.position)
    depth = -(seen @ backward)
    height = depth * np.tan(np.radians(viewpoint.angle / 2))
    return np.column_stack([seen @ right / (height * aspect), seen @ up / height])


@pytest.mark.parametrize("aspect", [0.6, 1.0, 2.4])
def test_a_fitted_mesh_fills_the_picture_and_stays_inside(cube: TriangleMesh, aspect: float) -> None:
    points = Place.of(cube.vertices).seen(cube.vertices)
    places = projected(front("y").fitted(points, aspect), points, aspect)
    assert np.abs(places).max() < 1.0
    assert np.abs(places).max() > 0.9
    # In the middle, in both directions.
    assert np.allclose(places.min(axis=0), -places.max(axis=0), atol=0.02)


def test_a_place_brings_any_mesh_to_the_same_size(sphere: TriangleMesh) -> None:
    moved = sphere.vertices * 1e6 + 3e7
    seen, other = Place.of(sphere.vertices).seen(sphere.vertices), Place.of(moved).seen(moved)
    assert np.allclose(seen, other, atol=1e-5)
    assert np.linalg.norm(np.ptp(seen, axis=0)) == pytest.approx(2.0, rel=1e-5)


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("aspect", [0.7, 1.6])
def test_a_turning_mesh_never_leaves_the_picture(aspect: float, up: str) -> None:
    # A long thin bar is the hardest.
    bar = np.random.default_rng(1).uniform(-1, 1, (400, 3)) * (1.0, 0.2, 0.05)
    start = front(up).fitted_all_around(bar, aspect, UP[up])  # type: ignore[arg-type,index]
    extents = [np.abs(projected(start.turned(angle, UP[up]), bar, aspect)).max() for angle in range(0, 360, 15)]  # type: ignore[index]
    assert max(extents) < 1.0
    assert max(extents) > 0.5


def test_a_full_turn_ends_where_it_began_and_half_a_turn_is_opposite() -> None:
    start = front("z")
    assert np.allclose(start.turned(360.0, UP["z"]).position, start.position)
    x, y, z = start.position
    assert np.allclose(start.turned(180.0, UP["z"]).position, (-x, -y, z))


def test_a_narrower_picture_shows_at_least_what_was_seen(cube: TriangleMesh) -> None:
    points = Place.of(cube.vertices).seen(cube.vertices)
    seen = front("y").fitted(points, 2.0)
    assert seen.for_picture(2.0, 3.0) == seen
    narrow = seen.for_picture(2.0, 0.5)
    assert np.allclose(projected(narrow, points, 0.5)[:, 0], projected(seen, points, 2.0)[:, 0])
    assert np.abs(projected(narrow, points, 0.5)).max() < 1.0


def test_an_eye_straight_above_still_has_an_up() -> None:
    above = front("y", (0.0, 1.0, 0.0))
    assert abs(np.dot(above.up, above.position)) < 0.1
