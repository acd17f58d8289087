"""What a batch has to do: files, folders, patterns, tables, names that are found again."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dmp.batch.jobs import job_for, jobs_from_files
from dmp.batch.memory import bytes_needed, most_vertices
from dmp.errors import DmpError, MeshFileError, SettingsError
from dmp.meshio import read_mesh
from dmp.settings import settings_for


def test_folder_pattern_and_file_name_the_same_jobs(scans: Path) -> None:
    settings = settings_for("denoise", steps=5)
    by_folder = jobs_from_files([str(scans)], settings, None)
    by_pattern = jobs_from_files([str(scans / "scan*.ply")], settings, None)
    by_name = jobs_from_files([str(scans / f"scan{number}.ply") for number in (0, 1, 2)], settings, None)
    assert [job.mesh.name for job in by_folder] == ["scan0.ply", "scan1.ply", "scan2.ply"]
    assert by_folder == by_pattern == by_name
    # Named twice, done once.
    assert jobs_from_files([str(scans), str(scans / "scan1.ply")], settings, None) == by_folder


def test_ground_truths_are_found_by_name(scans: Path) -> None:
    jobs = jobs_from_files([str(scans)], settings_for("denoise"), scans / "truth")
    assert [job.ground_truth for job in jobs] == [scans / "truth" / f"scan{number}.ply" for number in (0, 1, 2)]


def test_a_name_tells_apart_whatever_gives_another_result(scans: Path) -> None:
    mesh, plain = scans / "scan0.ply", settings_for("denoise", steps=5)
    names = {
        job_for(mesh, plain).name,
        job_for(mesh, settings_for("denoise", steps=6)).name,
        job_for(mesh, settings_for("denoise", steps=5, seed=1)).name,
        job_for(mesh, plain, scans / "truth" / "scan0.ply").name,
        job_for(scans / "scan1.ply", plain).name,
    }
    assert len(names) == 5
    # Where it is computed does not matter, and a moved folder is still the same batch.
    assert job_for(mesh, settings_for("denoise", steps=5, device="cpu", threads=2)).name == job_for(mesh, plain).name
    before = job_for(mesh, plain).name
    scans.rename(scans.with_name("moved"))
    moved = scans.with_name("moved") / "scan0.ply"
    assert job_for(moved, plain).name == before
    os.utime(moved, (1, 1))
    assert job_for(moved, plain).name != before


def test_two_files_of_one_name_are_two_jobs(scans: Path) -> None:
    other = scans / "other"
    other.mkdir()
    (other / "scan0.ply").write_bytes((scans / "scan0.ply").read_bytes())
    status = (scans / "scan0.ply").stat()
    os.utime(other / "scan0.ply", (status.st_atime, status.st_mtime))
    jobs = jobs_from_files([str(scans / "scan0.ply"), str(other / "scan0.ply")], settings_for("denoise"), None)
    assert len({job.name for job in jobs}) == 2


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_table_names_meshes_truths_and_settings(scans: Path, separator: str) -> None:
    rows = [
        ["mesh", "ground truth", "steps", "name", "Settings"],
        ["scan0.ply", "truth/scan0.ply", "7", "", "seed=3"],
        ["scan1.ply", "", "", "second", ""],
        ["", "", "", "", ""],
    ]
    if separator == ";":
        rows[1][4] = ""
    (scans / "table.csv").write_text("\ufeff" + "\r\n".join(separator.join(row) for row in rows))
    first, second = jobs_from_files([str(scans / "table.csv")], settings_for("denoise", steps=9), None, {"steps": 9})
    assert (first.settings.steps, first.ground_truth) == (7, scans / "truth" / "scan0.ply")
    assert first.settings.seed == (42 if separator == ";" else 3)
    assert second.settings.steps == 9
    assert second.name.startswith("second-")


def test_a_row_may_have_another_task(scans: Path) -> None:
    (scans / "table.csv").write_text("mesh,task,preset\nscan0.ply,complete,\nscan1.ply,denoise,best\n")
    first, second = jobs_from_files([str(scans / "table.csv")], settings_for("denoise", seed=5), None, {"seed": 5})
    assert (first.settings.task, first.settings.preset, first.settings.seed) == ("complete", "best", 5)
    assert (second.settings.method, second.settings.seed) == ("recorrupted", 5)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("file,steps\na.ply,3\n", "no column is named 'mesh'"),
        ("mesh,stepz\nscan0.ply,3\n", "no setting 'stepz'"),
        ("mesh,steps\nscan0.ply,many\n", "line 2"),
        ("mesh,steps\nscan0.ply,-1\n", "line 2"),
        ("mesh,steps\nscan0.ply\n", "line 2"),
        ("mesh,steps\nscan0.ply,3,4\n", "line 2"),
        ("mesh,steps\nscan0.ply,3\nnowhere.ply,3\n", "line 3"),
        ("mesh,steps,steps\nscan0.ply,3,3\n", "two columns"),
        ("mesh,settings\nscan0.ply,steps\n", "NAME=VALUE"),
        ("", "no column is named 'mesh'"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(scans: Path, content: str, told: str) -> None:
    (scans / "table.csv").write_text(content)
    with pytest.raises(DmpError, match=told):
        jobs_from_files([str(scans / "table.csv")], settings_for("denoise"), None)


def test_nothing_to_do_is_told(tmp_path: Path) -> None:
    with pytest.raises(MeshFileError, match="no mesh files in this folder"):
        jobs_from_files([str(tmp_path)], settings_for("denoise"), None)
    with pytest.raises(MeshFileError, match="no such file or folder"):
        jobs_from_files([str(tmp_path / "*.ply")], settings_for("denoise"), None)
    with pytest.raises(SettingsError, match="nothing to do"):
        jobs_from_files([], settings_for("denoise"), None)


def test_memory_is_foreseen_from_the_file(scans: Path) -> None:
    job = job_for(scans / "scan0.ply", settings_for("denoise"))
    true_count = read_mesh(job.mesh).n_vertices
    assert true_count <= most_vertices(job) <= 6 * true_count
    needs = [bytes_needed(count, settings_for("denoise")) for count in (0, 10_000, 1_000_000)]
    assert needs == sorted(needs)
    assert needs[2] > 4 * 2**30 > needs[1]
    assert bytes_needed(100_000, settings_for("denoise", "paper")) > bytes_needed(100_000, settings_for("denoise"))
    assert bytes_needed(1_000_000, settings_for("denoise", memory=4.2)) == 4_200_000_000
