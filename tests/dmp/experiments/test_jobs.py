"""Jobs are told apart by what decides their result, and by nothing else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmp.errors import DmpError, MeshFileError, SettingsError
from dmp.experiments.cases import Case, clean_file, meshes_of, pair
from dmp.experiments.catalogue import EXPERIMENTS
from dmp.experiments.conducting import cases_from, jobs_for, plans_for
from dmp.experiments.doing import do_job
from dmp.experiments.jobs import Job, distinct
from dmp.experiments.plan import Plan
from dmp.experiments.store import Chosen, JobRecord, Store
from dmp.mesh import TriangleMesh
from dmp.meshio import write_mesh
from dmp.settings import settings_for
from dmp.topology import edge_face_counts


@pytest.fixture
def files(tmp_path: Path, sphere: TriangleMesh, noisy_sphere: TriangleMesh) -> Path:
    write_mesh(tmp_path / "ground_truth.ply", sphere)
    write_mesh(tmp_path / "noisy.ply", noisy_sphere)
    return tmp_path


@pytest.fixture
def case(files: Path) -> Case:
    return pair("ball", files / "noisy.ply", files / "ground_truth.ply")


def test_only_what_decides_the_result_is_in_a_jobs_name(case: Case, files: Path) -> None:
    job = Job(case, settings_for("denoise", steps=5))
    assert job.settings is not None
    elsewhere = files / "moved.ply"
    elsewhere.write_bytes((files / "noisy.ply").read_bytes())
    moved = pair("ball", elsewhere, files / "ground_truth.ply")
    same = [replace(job, settings=replace(job.settings, threads=7, device="cpu")), replace(job, case=moved)]
    others = [
        replace(job, settings=replace(job.settings, seed=1)),
        replace(job, settings=replace(job.settings, steps=6)),
        replace(job, case=case.noisy("gaussian", 0.2, 1)),
        replace(job, case=case.noisy("gaussian", 0.2, 2)),
        replace(job, case=case.clean()),
        replace(job, case=case.with_cut_holes()),
        Job(case),
        Job(case, filter_name="taubin"),
        Job(case, filter_name="taubin", is_tuned=True),
    ]
    assert {other.name for other in same} == {job.name}
    assert len({job.name, *(other.name for other in others)}) == 1 + len(others)
    assert distinct([job, *others, *same]) == [job, *others]


def test_other_contents_under_the_same_file_name_are_another_job(case: Case, files: Path, sphere: TriangleMesh) -> None:
    write_mesh(files / "noisy.ply", sphere.with_vertices(1.5 * sphere.vertices))
    assert Job(pair("ball", files / "noisy.ply", files / "ground_truth.ply")).name != Job(case).name
    with pytest.raises(DmpError, match="changed while"):
        meshes_of(case, files / "shapes")


def test_all_does_shared_trainings_once(case: Case) -> None:
    def names(experiment: str) -> list[str]:
        return [job.name for job in jobs_for(plans_for(EXPERIMENTS[experiment], Plan((case,), steps=4)))]

    together = names("all")
    assert len(together) == len(set(together))
    singles = [name for part in EXPERIMENTS["all"].parts for name in names(part)]
    assert set(together) == set(singles)
    # Displacements from the smoothed input: for table 1, figure 5 and table 2.
    assert len(singles) == len(together) + 3


def test_cases_are_found_by_folder_file_sample_and_shape(files: Path, tmp_path: Path) -> None:
    cases = cases_from(
        [files, files / "noisy.ply", Path("fan-block"), Path("cube")], [files / "ground_truth.ply"], "normal", 0.4, 3
    )
    assert [case.task for case in cases] == ["denoise"] * 4
    assert [case.damaged is None for case in cases] == [False, False, False, True]
    # Both pairs lie in the same folder, and 'noisy' is no name.
    assert [case.name for case in cases] == [files.name, f"{files.name}-2", "fan-block", "cube"]
    assert (cases[3].noise, cases[3].level, cases[3].noise_seed) == ("normal", 0.4, 3)
    with pytest.raises(MeshFileError, match="no such file, folder, sample or shape"):
        cases_from([tmp_path / "nothing.ply"], [], "normal", 0.4, 3)
    with pytest.raises(SettingsError, match="2 ground truths were named for 1 mesh"):
        cases_from([files / "noisy.ply"], [files / "noisy.ply"] * 2, "normal", 0.4, 3)


def test_a_pair_with_other_faces_is_about_holes_and_refused_where_noise_is_meant(case: Case, files: Path) -> None:
    holed, _ = meshes_of(case.with_cut_holes(), files)
    write_mesh(files / "holed.ply", holed)
    plan = Plan(cases_from([files / "holed.ply"], [files / "ground_truth.ply"], "gaussian", 0.1, 1), steps=2)
    assert plan.cases[0].task == "complete"
    assert {job.case.task for job in jobs_for(plans_for(EXPERIMENTS["all"], plan))} == {"complete"}
    with pytest.raises(SettingsError, match="holed: the ground truth has other faces"):
        plans_for(EXPERIMENTS["denoising"], plan)


def test_a_clean_mesh_gets_the_noise_that_was_asked_for(files: Path, sphere: TriangleMesh) -> None:
    noisy, truth = meshes_of(clean_file("ball", files / "ground_truth.ply").noisy("gaussian", 0.5, 9), files)
    assert np.array_equal(truth.vertices, sphere.vertices)
    assert np.array_equal(noisy.faces, sphere.faces)
    again, _ = meshes_of(clean_file("ball", files / "ground_truth.ply").noisy("gaussian", 0.5, 9), files)
    assert np.array_equal(noisy.vertices, again.vertices)
    assert not np.array_equal(noisy.vertices, sphere.vertices)


def test_two_holes_are_cut_into_a_mesh_without_any(case: Case, files: Path, sphere: TriangleMesh) -> None:
    holed, truth = meshes_of(case.with_cut_holes(), files)
    assert truth.n_vertices == sphere.n_vertices
    assert holed.n_vertices == sphere.n_vertices - 12
    # V - E + F of a sphere with two holes is 0.
    _, counts = edge_face_counts(holed.faces)
    assert holed.n_vertices - len(counts) + holed.n_faces == 0
    assert set(counts) == {1, 2}


def test_a_record_that_is_damaged_or_failed_is_done_again(case: Case, tmp_path: Path) -> None:
    store, job = Store(tmp_path / "out"), Job(case)
    assert store.read(job) is None
    store.write(job, JobRecord(failure="no"))
    assert not store.is_done(job)
    done = JobRecord(
        {"last": Chosen("step 3", {"mad": 1.5}, step=3)}, {"step": [0.0, 5.0], "mad": [None, 2.0]}, 4.0, {"threads": 1}
    )
    store.write(job, done)
    assert store.read(job) == done
    for path in (tmp_path / "out" / "records").iterdir():
        path.write_bytes(path.read_bytes()[:-20])
    assert not store.is_done(job)
    assert do_job(job, store).results["without_truth"].measures["mad"] > 1
    assert store.is_done(job)


def test_what_a_mesh_does_not_allow_becomes_a_sentence_in_its_record(case: Case, files: Path, tmp_path: Path) -> None:
    open_mesh, _ = meshes_of(case.with_cut_holes(), files)
    write_mesh(files / "open.ply", open_mesh)
    open_case = clean_file("open", files / "open.ply").noisy("gaussian", 0.1, 1)
    record = do_job(Job(open_case, settings_for("denoise", steps=2, smoothing="spherical")), Store(tmp_path / "out"))
    assert record.failure.endswith(".")
    assert not record.results
