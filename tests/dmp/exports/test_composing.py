"""What stands in pictures, pixel by pixel; drawn in this process, skipped where the machine cannot draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageColor

from dmp.errors import DmpError
from dmp.exports.color_tables import color_table
from dmp.exports.composing import Composer
from dmp.exports.layout import Layout
from dmp.exports.of_runs import Photographer, Wish, mesh_picture, seam_edges
from dmp.exports.scenes import Cut, Frame, Paper, Scale, Sheet, Shown
from dmp.exports.viewpoints import Place, front
from dmp.mesh import TriangleMesh
from dmp.quantities import Quantity
from dmp.runs import Run

pytestmark = pytest.mark.usefixtures("can_draw")


def drawn(sheet: Sheet, frame: Frame) -> np.ndarray:
    composer = Composer(sheet)
    try:
        return np.asarray(composer.compose(frame))
    finally:
        composer.close()


def ball(mesh: TriangleMesh, value: float | None = None) -> Shown:
    seen = Place.of(mesh.vertices).seen(mesh.vertices)
    values = None if value is None else np.full(len(seen), value, dtype=np.float32)
    return Shown(seen, 0, front("y").fitted(seen, 1.0), "Ball", "a fact", values)


@pytest.fixture
def bare(sphere: TriangleMesh) -> Sheet:
    return Sheet(120, 120, (sphere.faces,), has_titles=False, has_scale=False)


def test_the_ground_is_really_transparent_and_the_mesh_is_not(sphere: TriangleMesh, bare: Sheet) -> None:
    picture = drawn(replace(bare, is_transparent=True), Frame((ball(sphere),)))
    assert picture.shape == (120, 120, 4)
    opacity = picture[..., 3]
    assert opacity[0, 0] == opacity[-1, -1] == 0
    assert opacity[60, 60] == 255
    # The disc of a sphere that fills the picture, with a little margin.
    assert (opacity > 128).mean() == pytest.approx(np.pi / 4 / 1.06**2, abs=0.03)
    edge = (opacity > 30) & (opacity < 220)
    if edge.any():
        # Half covered pixels keep the colour of the mesh, without a dark fringe.
        assert picture[edge][:, :3].min() > 40


def test_on_paper_the_ground_is_the_paper(sphere: TriangleMesh, bare: Sheet) -> None:
    paper = Paper(top="#102030", bottom="#102030")
    opaque = drawn(replace(bare, paper=paper), Frame((ball(sphere),)))
    assert opaque.shape == (120, 120, 3)
    assert tuple(opaque[0, 0]) == ImageColor.getrgb("#102030")
    clear = drawn(replace(bare, paper=paper, is_transparent=True), Frame((ball(sphere),)))
    over = Image.new("RGBA", (120, 120), "#102030")
    over.alpha_composite(Image.fromarray(clear))
    assert np.abs(np.asarray(over)[..., :3].astype(int) - opaque).max() <= 3


def test_values_get_the_colours_of_the_table_between_its_ends(sphere: TriangleMesh, bare: Sheet) -> None:
    scale = Scale("Height", "", color_table("magnitude"), 0.0, 10.0)
    low, high = (drawn(replace(bare, scale=scale), Frame((ball(sphere, value),)))[60, 60].astype(int) for value in (0.0, 10.0))
    assert low[2] > low[1]
    assert min(high[0], high[1]) > high[2] + 50
    nothing = drawn(replace(bare, scale=scale), Frame((ball(sphere, np.nan),)))[60, 60].astype(int)
    assert np.ptp(nothing) < 20


def test_panes_stand_side_by_side_with_writing_above_and_colours_below(sphere: TriangleMesh) -> None:
    scale = Scale("Height", "miles", color_table("magnitude"), 0.0, 1.0)
    sheet = Sheet(600, 300, (sphere.faces,), scale, Paper(bottom="#ffffff"))
    layout = Layout(sheet, 2)
    shown = ball(sphere, 0.5)
    picture = drawn(sheet, Frame((shown, shown)))
    assert picture.shape == (300, 600, 3)
    (left, top, width, height), (right, *_) = layout.panes
    assert np.array_equal(
        picture[top : top + height, left + 2 : left + width - 2], picture[top : top + height, right + 2 : right + width - 2]
    )
    above, below = picture[: layout.title_height], picture[300 - layout.bar_height :]
    assert (above < 100).any()
    yellow = (below[..., 0] > 230) & (below[..., 1] > 200) & (below[..., 2] < 90)
    assert yellow.any()
    without = drawn(replace(sheet, has_titles=False, has_scale=False), Frame((shown, shown)))
    assert (without[:3, :290] == 255).all()


def test_a_swipe_shows_the_other_mesh_left_of_the_line(sphere: TriangleMesh, bare: Sheet) -> None:
    scale = Scale("", "", color_table("magnitude"), 0.0, 1.0)
    sheet = replace(bare, scale=scale)
    yellow, violet = ball(sphere, 1.0), ball(sphere, 0.0)
    picture = drawn(sheet, Frame((yellow,), Cut(violet, "swipe", 0.5))).astype(int)
    assert picture[60, 30, 2] > picture[60, 30, 1]
    assert picture[60, 90, 1] > picture[60, 90, 2]
    lens = drawn(sheet, Frame((yellow,), Cut(violet, "lens", 0.5, 0.5, 0.2))).astype(int)
    assert lens[60, 60, 2] > lens[60, 60, 1]
    assert lens[60, 95, 1] > lens[60, 95, 2]


def test_a_pane_that_is_left_out_stays_as_it_was(sphere: TriangleMesh, bare: Sheet) -> None:
    composer = Composer(replace(bare, width=240))
    first = np.asarray(composer.compose(Frame((ball(sphere), ball(sphere)))))
    small = replace(ball(sphere), positions=ball(sphere).positions / 2)
    second = np.asarray(composer.compose(Frame((None, small))))
    composer.close()
    assert np.array_equal(first[:, :119], second[:, :119])
    assert not np.array_equal(first[:, 121:], second[:, 121:])


def test_an_empty_pane_and_a_mesh_with_edges_and_rims(sphere: TriangleMesh, bare: Sheet) -> None:
    empty = replace(ball(sphere), positions=np.zeros((0, 3), dtype=np.float32))
    assert (drawn(bare, Frame((empty,)))[0] == drawn(bare, Frame((empty,)))[0, 0]).all()
    plain = drawn(bare, Frame((ball(sphere),))).astype(int)
    with_edges = drawn(replace(bare, has_edges=True), Frame((ball(sphere),))).astype(int)
    assert with_edges.mean() < plain.mean() - 3
    seen = ball(sphere).positions
    rims = drawn(bare, Frame((replace(ball(sphere), rims=seen[sphere.faces[:, :2]]),))).astype(int)
    pink = (rims[..., 0] > 180) & (rims[..., 1] < 90) & (rims[..., 2] > 80)
    assert pink.sum() > 100


@pytest.mark.parametrize("quantity", ["magnitude", "error", "normals", "plain"])
def test_a_run_is_shown_with_its_names_and_measures(denoised: Run, quantity: Quantity) -> None:
    denoised.keep(15)
    wish = Wish(300, 120, ("input", "smoothed", "predicted", "truth"), quantity)
    sheet, frame = Photographer(denoised, wish).picture(15)
    titles = [pane.title for pane in frame.panes if pane is not None]
    assert titles == ["Input", "Smoothed", "Predicted @ step 15", "Ground truth"]
    truth = denoised.problem().ground_truth
    assert truth is not None
    predicted = frame.panes[2]
    assert predicted is not None
    assert predicted.facts == f"MAD {truth.measures(denoised.snapshot(15).vertices)['mad']:.2f}°  ·  kept"
    assert (sheet.scale is None) == (quantity in ("normals", "plain"))
    picture = drawn(sheet, frame)
    assert picture.shape == (120, 300, 3)
    for index in range(4):
        part = picture[20:90, index * 75 + 4 : index * 75 + 71]
        assert part.reshape(-1, 3).std(axis=0).max() > 8


def test_a_completion_shows_the_open_hole_and_its_rim(completed: Run) -> None:
    problem = completed.problem()
    seam = seam_edges(problem)
    # The rim of the hole: each of its vertices is on two edges and was there before.
    assert (np.unique(seam, return_counts=True)[1] == 2).all()
    assert problem.known[seam].all()
    sheet, frame = Photographer(completed, Wish(300, 100, ("input", "filled", "predicted"), "plain", eye=(0, 0, 1))).picture(4)
    assert len(sheet.faces[0]) < len(sheet.faces[1])
    picture = drawn(sheet, frame).astype(int)
    ground = np.abs(picture[50, :, :] - picture[50, 0, :]).sum(axis=1) < 12
    # In the middle of the first pane the ground is seen through the hole, in the third it is not.
    assert ground[50]
    assert not ground[150]
    assert not ground[250]


def test_what_a_run_cannot_show_is_one_sentence(completed: Run, denoised: Run) -> None:
    with pytest.raises(DmpError, match="needs a ground truth"):
        Photographer(completed, Wish(quantity="error"))
    with pytest.raises(DmpError, match="has no ground truth to show"):
        Photographer(completed, Wish(panes=("truth",)))
    with pytest.raises(DmpError, match="filled no holes"):
        Photographer(denoised, Wish(panes=("filled",)))


def test_one_mesh_alone(sphere: TriangleMesh) -> None:
    sheet, frame = mesh_picture(sphere, "ball.ply", Wish(200, 200, quantity="curvature"))
    assert sheet.scale is not None
    picture = drawn(sheet, frame)
    # A sphere bulges everywhere alike: red.
    red, green, blue = picture[90, 100].astype(int)
    assert red > max(green, blue) + 40
