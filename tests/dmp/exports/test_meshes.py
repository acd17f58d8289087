from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dmp.cli import main
from dmp.exports.color_tables import color_table
from dmp.exports.meshes import annotated_mesh, possible_quantities
from dmp.meshio import read_mesh, write_mesh
from dmp.metrics import GroundTruth
from dmp.runs import Run


@pytest.mark.parametrize("suffix", [".ply", ".vtp"])
def test_what_is_known_of_each_vertex_arrives_in_the_file(denoised: Run, tmp_path: Path, suffix: str) -> None:
    problem, step = denoised.problem(), 20
    assert isinstance(problem.ground_truth, GroundTruth)
    assert write_mesh(tmp_path / f"out{suffix}", annotated_mesh(denoised, step)) == ()
    read = read_mesh(tmp_path / f"out{suffix}")
    vertices = denoised.snapshot(step).vertices
    assert np.allclose(read.vertices, vertices, atol=0)
    assert np.allclose(read.vertex_attributes["displacement"], vertices - problem.base)
    assert np.allclose(read.vertex_attributes["displacement_length"], np.sqrt(((vertices - problem.base) ** 2).sum(axis=1)))
    expected = np.sqrt(((vertices - problem.ground_truth.mesh.vertices) ** 2).sum(axis=1))
    assert np.allclose(read.vertex_attributes["error"], expected, atol=1e-6)
    assert "inserted" not in read.vertex_attributes


def test_a_completion_says_which_vertices_were_inserted(completed: Run, tmp_path: Path) -> None:
    write_mesh(tmp_path / "out.ply", annotated_mesh(completed, 4))
    inserted = read_mesh(tmp_path / "out.ply").vertex_attributes["inserted"]
    assert np.array_equal(inserted == 1, ~completed.problem().known)
    assert 0 < inserted.sum() < len(inserted)


def test_obj_holds_the_colours_and_says_what_it_cannot_hold(denoised: Run, tmp_path: Path) -> None:
    notes = write_mesh(tmp_path / "out.obj", annotated_mesh(denoised, 20, "error"))
    assert notes == ("OBJ cannot hold displacement, displacement_length, error; PLY can.",)
    mesh = annotated_mesh(denoised, 20)
    colors = read_mesh(tmp_path / "out.obj").vertex_attributes["color"]
    lowest = int(np.argmin(mesh.vertex_attributes["error"]))
    highest = int(np.argmax(mesh.vertex_attributes["error"]))
    table = color_table("error")[:, :3]
    assert np.abs(np.round(colors[highest] * 255) - table[255]).max() <= 1
    # The least error is near the beginning of the colours.
    assert np.argmin(np.abs(table.astype(int) - np.round(colors[lowest] * 255)).sum(axis=1)) < 40


def test_only_what_can_be_measured_can_be_a_colour(denoised: Run, completed: Run) -> None:
    assert {"magnitude", "error", "normal_error", "curvature"} <= set(possible_quantities(denoised.problem()))
    assert not {"error", "normal_error", "step"} & set(possible_quantities(completed.problem()))


def test_the_command_writes_the_same_and_refuses_what_the_run_has_not(
    denoised: Run, completed: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["export", str(denoised.folder), "--step", "15", "-o", str(tmp_path / "a.ply"), "--colour-by", "signed"])
    assert ended.value.code == 0
    read = read_mesh(tmp_path / "a.ply")
    assert {"displacement", "displacement_length", "error", "color"} <= set(read.vertex_attributes)
    with pytest.raises(SystemExit) as ended:
        main(["export", str(completed.folder), "-o", str(tmp_path / "b.ply"), "--colour-by", "error"])
    assert ended.value.code == 2
    assert "needs a ground truth" in capsys.readouterr().err
    assert not (tmp_path / "b.ply").exists()
