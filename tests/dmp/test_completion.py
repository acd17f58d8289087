from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmp.boundary import boundary_loops
from dmp.cli import main
from dmp.completion import completion
from dmp.errors import NoHolesError
from dmp.hole_metrics import HoleTruth
from dmp.mesh import TriangleMesh
from dmp.meshio import read_mesh, write_mesh
from dmp.methods import training_for
from dmp.rest import RestWatch
from dmp.runs import Run, record
from dmp.seam import Seam
from dmp.settings import Settings, settings_for
from dmp.topology import adjacency, topology_report
from tests.meshes import grid_mesh, sphere_mesh


def _with_hole(mesh: TriangleMesh, towards: tuple[float, float, float], cosine: float = 0.8) -> TriangleMesh:
    """Cut out the vertices of a unit sphere around a direction."""
    gone = mesh.vertices @ np.array(towards) > cosine
    faces = mesh.faces[~gone[mesh.faces].any(axis=1)]
    used = np.unique(faces)
    index = np.full(mesh.n_vertices, -1)
    index[used] = np.arange(len(used))
    return TriangleMesh(mesh.vertices[used], index[faces])


@pytest.fixture(scope="module")
def holed() -> TriangleMesh:
    return _with_hole(_with_hole(sphere_mesh(4), (0, 0, 1)), (0.6, -0.8, 0), 0.92)


def _settings(**overrides: object) -> Settings:
    return settings_for(
        "complete", **{"preset": "compact", "steps": 40, "snapshot_every": 20, "log_every": 10, "threads": 1, **overrides}
    )


def test_known_vertices_keep_index_and_position_and_the_result_is_closed(holed: TriangleMesh) -> None:
    problem = completion(holed, _settings())
    assert np.array_equal(problem.mesh.vertices[: holed.n_vertices], holed.vertices)
    assert problem.known.tolist() == [True] * holed.n_vertices + [False] * (problem.mesh.n_vertices - holed.n_vertices)
    assert topology_report(problem.mesh).is_closed
    *_, last = training_for(problem, _settings()).steps()
    assert last.snapshot is not None
    assert np.array_equal(last.snapshot.vertices[problem.known], holed.vertices)


def test_known_vertices_take_the_prediction_if_asked(holed: TriangleMesh) -> None:
    settings = _settings(known_vertices="predict")
    problem = completion(holed, settings)
    *_, last = training_for(problem, settings).steps()
    assert last.snapshot is not None
    moved = np.linalg.norm(last.snapshot.vertices - problem.target, axis=1)[problem.known]
    assert (moved > 0).all()


def test_inserted_vertices_never_enter_the_data_term(holed: TriangleMesh) -> None:
    settings = _settings(known_vertices="predict", laplacian_of="prediction")
    problem = completion(holed, settings)
    moved = problem.mesh.vertices + 9.0 * ~problem.known[:, None]
    other = replace(problem, mesh=problem.mesh.with_vertices(moved))
    results = [[r.snapshot.vertices for r in training_for(p, settings).steps() if r.snapshot][-1] for p in (problem, other)]
    assert np.array_equal(*results)


def test_the_correction_at_the_seam_is_the_mean_of_its_neighbours(holed: TriangleMesh) -> None:
    problem = completion(holed, _settings())
    predicted = problem.target + np.random.default_rng(0).standard_normal(problem.target.shape)
    correction = Seam(problem.mesh, problem.known).apply(predicted) - predicted
    neighbours = adjacency(problem.mesh.faces, problem.mesh.n_vertices)
    mean = (neighbours @ correction) / neighbours.sum(axis=1)[:, None]
    assert correction[~problem.known] == pytest.approx(mean[~problem.known], abs=1e-10)
    assert np.abs(correction[~problem.known]).max() <= np.abs(correction[problem.known]).max()


def test_a_completed_sphere_is_rounder_than_its_base(holed: TriangleMesh) -> None:
    settings = _settings(steps=200)
    problem = completion(holed, settings, ground_truth=sphere_mesh(4))
    assert isinstance(problem.ground_truth, HoleTruth)
    *_, last = training_for(problem, settings).steps()
    assert last.metrics["hole_distance"] < 0.5 * problem.ground_truth.measures(problem.base)["hole_distance"]


def test_measures_of_vertices_lifted_by_a_known_amount() -> None:
    sheet = grid_mesh(5)
    known = np.ones(25, dtype=bool)
    known[12] = False
    truth = HoleTruth.for_filled(sheet, sheet, known, edge_length=2.0)
    lifted = sheet.vertices.copy()
    lifted[12, 2] = 1.0
    values = truth.measures(lifted)
    assert values["hole_distance"] == pytest.approx(0.5)
    assert 40 < values["hole_normal_error"] < 60
    assert truth.measures(sheet.vertices) == pytest.approx({"hole_distance": 0, "hole_normal_error": 0}, abs=1e-9)


def test_rest_is_movement_below_the_bound_for_long_enough() -> None:
    watch = RestWatch(np.array([0]), edge_length=2.0, bound=0.05)
    positions = np.zeros((1, 3))
    watch.update(0, positions)
    assert watch.update(100, positions + np.array([0.2, 0, 0])) == pytest.approx({"inserted_movement": 0.1})
    for step in (200, 300, 400):
        assert not watch.is_at_rest
        watch.update(step, positions + np.array([0.2, 0, 0]))
    assert watch.is_at_rest
    other = RestWatch(np.array([0]), edge_length=2.0, bound=0.05)
    other.load_state(watch.state())
    assert other.is_at_rest
    watch.update(500, positions)
    assert not watch.is_at_rest


def test_training_ends_when_the_inserted_vertices_rest(holed: TriangleMesh, tmp_path: Path) -> None:
    settings = _settings(steps=5000, rest_movement=1000.0, snapshot_every=1000)
    run = Run.create(completion(holed, settings), settings, folder=tmp_path / "run")
    records = list(record(run.resume(), run))
    assert records[-1].step == 300
    assert records[-1].snapshot is not None
    assert Run.open(run.folder).state == "finished"


def test_stopping_a_completion_and_going_on_is_bit_exact(holed: TriangleMesh, tmp_path: Path) -> None:
    runs = []
    for name, until in (("whole", None), ("parts", 25)):
        run = Run.create(completion(holed, _settings()), _settings(), folder=tmp_path / name)
        records = record(run.resume(), run)
        for item in records:
            if item.step == until:
                break
        records.close()  # type: ignore[attr-defined]
        runs.append(Run.open(run.folder))
    list(record(runs[1].resume(), runs[1]))
    curves = [[{k: v for k, v in row.items() if k != "seconds"} for row in run.curve() if row["step"] != 25] for run in runs]
    assert curves[0] == curves[1]
    assert np.array_equal(runs[0].snapshot(40).vertices, runs[1].snapshot(40).vertices)


def test_the_rim_of_a_sheet_stays_open_and_chosen_holes_are_filled(holed: TriangleMesh) -> None:
    with pytest.raises(NoHolesError):
        completion(grid_mesh(6), _settings())
    with pytest.raises(NoHolesError):
        completion(sphere_mesh(2), _settings())
    small = min(boundary_loops(holed), key=lambda loop: loop.n_edges)
    problem = completion(holed, _settings(max_hole_edges=small.n_edges))
    assert topology_report(problem.mesh).boundary_edges == max(loop.n_edges for loop in boundary_loops(holed))


def test_the_command_completes_and_a_mesh_without_holes_gets_a_sentence(
    holed: TriangleMesh, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_mesh(tmp_path / "holed.ply", holed)
    write_mesh(tmp_path / "whole.ply", sphere_mesh(4))
    fast = ["--steps", "20", "--snapshot-every", "20", "--threads", "1"]

    def run(*arguments: object) -> object:
        with pytest.raises(SystemExit) as ended:
            main(["complete", *map(str, arguments), *fast])
        return ended.value.code

    truth = ["--ground-truth", tmp_path / "whole.ply"]
    assert run(tmp_path / "holed.ply", "-o", tmp_path / "out.ply", *truth, "--run", tmp_path / "run") == 0
    said = capsys.readouterr().err
    assert "Filled 2 holes" in said
    assert "from the true surface" in said
    result = read_mesh(tmp_path / "out.ply")
    inserted = result.vertex_attributes["inserted"]
    assert inserted.sum() == result.n_vertices - holed.n_vertices > 0
    assert Run.open(tmp_path / "run").problem().known.tolist() == (inserted == 0).tolist()
    assert run(tmp_path / "holed.ply", "-o", tmp_path / "both.ply", "--denoise") == 0
    assert run(tmp_path / "whole.ply", "-o", tmp_path / "same.ply") == 0
    assert "no holes" in capsys.readouterr().err
    assert np.array_equal(read_mesh(tmp_path / "same.ply").vertices, sphere_mesh(4).vertices)


def test_info_lists_the_holes_and_the_rim(holed: TriangleMesh, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, mesh, kinds in (("holed.ply", holed, ["hole", "hole"]), ("sheet.ply", grid_mesh(6), ["outer rim"])):
        write_mesh(tmp_path / name, mesh)
        with pytest.raises(SystemExit):
            main(["info", str(tmp_path / name), "--json"])
        boundaries = json.loads(capsys.readouterr().out)["boundaries"]
        assert [loop["kind"] for loop in boundaries] == kinds
        assert [loop["edges"] for loop in boundaries] == [loop.n_edges for loop in boundary_loops(mesh)]
    assert boundaries[0]["perimeter"] == pytest.approx(20)
    with pytest.raises(SystemExit):
        main(["info", str(tmp_path / "holed.ply")])
    assert capsys.readouterr().out.count("hole") >= 2
