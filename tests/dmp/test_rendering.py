"""Pictures drawn off screen; skipped where the machine cannot draw."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dmp import rendering
from dmp.experiments.pictures import CANNOT_DRAW, Shown, picture_row
from dmp.experiments.reports import Report
from dmp.exports.viewpoints import Viewpoint
from dmp.mesh import TriangleMesh


@pytest.fixture
def can_draw() -> None:
    if not rendering.can_render():
        pytest.skip("this machine offers no way to draw")


@pytest.mark.usefixtures("can_draw")
def test_a_sphere_is_a_disc_of_its_colours_on_white(sphere: TriangleMesh) -> None:
    drawn = rendering.picture(sphere, size=100)
    assert (drawn.shape, drawn.dtype) == ((100, 100, 3), np.uint8)
    covered = (drawn < 250).any(axis=2)
    # The sphere fills the picture: its disc covers pi / 4 of the square.
    assert covered.mean() == pytest.approx(np.pi / 4, abs=0.03)
    assert covered[50, 50]
    assert not covered[0, 0]
    half = rendering.picture(sphere.with_vertices(sphere.vertices / 2), like=sphere, size=100)
    assert (half < 250).any(axis=2).mean() == pytest.approx(np.pi / 16, abs=0.02)


@pytest.mark.usefixtures("can_draw")
def test_values_become_colours_between_the_limits(sphere: TriangleMesh) -> None:
    low = rendering.picture(sphere, np.zeros(sphere.n_faces), limits=(0, 10), size=60)[30, 30].astype(int)
    high = rendering.picture(sphere, np.full(sphere.n_faces, 10.0), limits=(0, 10), size=60)[30, 30].astype(int)
    # Viridis goes from dark violet to yellow.
    assert low[2] > low[1]
    assert min(high[0], high[1]) > high[2]


@pytest.mark.usefixtures("can_draw")
@pytest.mark.usefixtures("can_draw")
def test_every_picture_of_a_studio_has_its_lines_upon_their_halo(sphere: TriangleMesh) -> None:
    vertices = sphere.vertices.astype(np.float32)
    edges = vertices[sphere.faces[:, :2]]
    studio = rendering.Studio(120, 120)
    try:
        pictures = [
            studio.draw(vertices, sphere.faces, Viewpoint((0.0, 0.0, 4.0)), color="#808080", lines=edges, line_color="#ff0000")
            for _ in range(3)
        ]
    finally:
        studio.close()
    red = [int(((one[..., 0] > 200) & (one[..., 1] < 60)).sum()) for one in pictures]
    assert red[0] > 1000
    assert red[1:] == [red[0]] * 2


def test_a_row_of_pictures_is_a_png_file(sphere: TriangleMesh, tmp_path: Path) -> None:
    path = picture_row(tmp_path / "row.png", [Shown("a", sphere, np.zeros(sphere.n_faces)), Shown("b", sphere)], like=sphere)
    assert path is not None
    assert path.read_bytes().startswith(b"\x89PNG")


def test_without_a_way_to_draw_one_sentence_says_so(
    sphere: TriangleMesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rendering, "can_render", lambda: False)
    report = Report("T", tmp_path)
    for name in ("one", "two"):
        report.add_pictures(name, "caption", lambda: [Shown("a", sphere)], sphere)
    assert report.remarks == [CANNOT_DRAW]
    assert report.images == {}
    assert CANNOT_DRAW in report.write().read_text()


def test_a_child_that_dies_means_no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    rendering.can_render.cache_clear()
    monkeypatch.setattr(rendering.sys, "executable", "/no/such/python")
    assert rendering.can_render() is False
    rendering.can_render.cache_clear()
