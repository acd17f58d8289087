"""The choice of holes and the lines around them, without a window."""

from __future__ import annotations

import numpy as np
import pytest

from dmp.completion import completion
from dmp.mesh import TriangleMesh
from dmp.settings import settings_for
from dmp.shapes.alterations import with_holes
from dmp_viewer.holes import HoleChoice, Seam, failures, find_holes, outward, still_open
from dmp_viewer.views.outlines import dashed, whole
from tests.meshes import grid_mesh, sphere_mesh

DIRECTIONS = [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)]


@pytest.fixture(scope="module")
def holed() -> TriangleMesh:
    """A sphere with three holes, the largest first."""
    return with_holes(sphere_mesh(3), DIRECTIONS, [21, 12, 5])


@pytest.fixture
def choice(holed: TriangleMesh) -> HoleChoice:
    choice = HoleChoice()
    choice.set_found(find_holes(holed))
    return choice


def test_the_usual_choice_is_left_to_the_library(choice: HoleChoice) -> None:
    assert choice.filled == {0, 1, 2}
    assert choice.loops_to_fill() is None
    choice.switch(1, False)
    loops = choice.loops_to_fill()
    assert loops is not None
    assert [loop.n_edges for loop in loops] == [choice.found.loops[index].n_edges for index in (0, 2)]
    choice.switch(1, True)
    assert choice.loops_to_fill() is None
    choice.choose(frozenset())
    assert choice.loops_to_fill() == ()


def test_a_rim_can_be_filled_when_somebody_wants_it() -> None:
    choice = HoleChoice()
    choice.set_found(find_holes(grid_mesh(6)))
    assert choice.state(0).text == "outer rim"
    assert choice.state(0).can_be_filled
    choice.switch(0, True)
    assert choice.state(0).is_filled
    assert choice.loops_to_fill() == choice.found.loops


def test_a_limit_takes_holes_away_and_gives_them_back(choice: HoleChoice) -> None:
    sizes = [loop.n_edges for loop in choice.found.loops]
    assert choice.set_limit(sizes[1])
    assert choice.filled == {1, 2}
    assert not choice.state(0).can_be_filled
    assert not choice.set_limit(sizes[0] - 1)  # fills the same holes
    assert choice.set_limit(0)
    assert choice.filled == {0, 1, 2}


def test_who_listens_hears_of_changes_only(choice: HoleChoice) -> None:
    heard = []
    choice.changed.connect(lambda: heard.append("choice"))
    choice.pointed_changed.connect(lambda: heard.append("pointed"))
    choice.set_found(choice.found)
    choice.choose(choice.chosen)
    choice.set_failed({})
    choice.point_at(None)
    assert heard == []
    choice.point_at(1)
    choice.set_failed({1: "Too twisted."})
    assert heard == ["pointed", "choice"]
    assert choice.state(1).text == "cannot be filled"
    assert choice.state(1).reason == "Too twisted."


def test_holes_that_were_filled_are_told_from_those_that_were_not(holed: TriangleMesh) -> None:
    holes = find_holes(holed)
    problem = completion(holed, settings_for("complete"), loops=holes.loops[1:])
    assert still_open(holes, problem.mesh) == {0}
    assert still_open(holes, holed) == {0, 1, 2}
    assert failures(holes, frozenset({1, 2}), problem) == {}
    assert list(failures(holes, frozenset({0, 1}), problem)) == [0]
    assert still_open(find_holes(sphere_mesh(2)), sphere_mesh(2)) == frozenset()


@pytest.mark.parametrize("index", range(3))
def test_outward_is_away_from_the_body(holed: TriangleMesh, index: int) -> None:
    loop = find_holes(holed).loops[index]
    direction = outward(holed.vertices, loop, is_rim=False)
    assert direction is not None
    assert direction @ loop.center / np.linalg.norm(loop.center) > 0.95
    assert np.linalg.norm(direction) == pytest.approx(1)


def test_a_rim_is_looked_at_from_the_front() -> None:
    sheet = grid_mesh(5)
    direction = outward(sheet.vertices, find_holes(sheet).loops[0], is_rim=True)
    assert direction == pytest.approx([0, 0, 1])


def test_the_seam_is_the_rim_of_what_was_filled(holed: TriangleMesh) -> None:
    loops = find_holes(holed).loops
    filled = completion(holed, settings_for("complete"), loops=loops[:2]).mesh
    edges = {tuple(sorted(edge)) for edge in Seam.between(holed, filled).edges.tolist()}
    assert edges == {tuple(sorted(edge)) for loop in loops[:2] for edge in loop.edges.tolist()}
    assert len(Seam.between(holed, holed).edges) == 0


def test_dashes_cover_half_of_a_rim_evenly(holed: TriangleMesh) -> None:
    loops = find_holes(holed).loops
    full, dashes = whole(holed.vertices, [loops[0].edges]), dashed(holed.vertices, [loops[0].edges])
    lengths = [np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum() for segments in (full, dashes)]
    assert lengths[0] == pytest.approx(loops[0].perimeter)
    assert lengths[1] == pytest.approx(loops[0].perimeter / 2, rel=0.05)
    many = dashed(holed.vertices, [loops[0].edges] * 301)  # too many for even ones
    assert len(many) == 301 * loops[0].n_edges
    assert len(whole(holed.vertices, [])) == len(dashed(holed.vertices, [])) == 0
