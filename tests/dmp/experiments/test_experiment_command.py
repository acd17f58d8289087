"""`dmp experiment` from end to end, on a ball with 162 vertices and few steps."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest

from dmp.cli import main
from dmp.experiments import running
from dmp.experiments.catalogue import EXPERIMENTS
from dmp.experiments.doing import do_job
from dmp.experiments.jobs import Job
from dmp.meshio import write_mesh
from dmp.noise import add_noise
from dmp.runs import list_runs
from dmp.shapes.spheres import bumpy_sphere


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a noisy mesh and its ground truth."""
    folder = tmp_path_factory.mktemp("meshes") / "ball"
    folder.mkdir()
    truth = bumpy_sphere(4)
    write_mesh(folder / "ground_truth.ply", truth)
    write_mesh(folder / "noisy.ply", add_noise(truth, 0.2, seed=3))
    return folder


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["experiment", *map(str, arguments)])
    return int(ended.value.code or 0)


def tables(out: Path) -> dict[str, str]:
    return {str(path.relative_to(out)): path.read_text() for path in sorted(out.glob("*/*.csv"))}


def test_without_a_name_each_experiment_is_listed_with_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert run() == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(EXPERIMENTS)
    assert all(line.endswith(".") for line in lines)


def test_all_writes_tables_charts_and_pictures_of_the_whole_paper(
    ball: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[str] = []

    def picture_row(path: Path, shown: Any, **_: Any) -> Path:
        drawn.extend(item.title for item in shown)
        return path

    # Drawing has tests of its own.
    monkeypatch.setattr("dmp.experiments.reports.picture_row", picture_row)
    out = tmp_path / "out"
    rivals = ["--rivals", "laplacian", "--rivals", "taubin", "--threads", "1", "--set", "input-channels=4"]
    assert run("all", ball, "--steps", "4", "--out", out, *rivals) == 0
    said = capsys.readouterr()
    assert said.out.strip() == str(out / "report.md")
    page = (out / "report.md").read_text()
    for name in EXPERIMENTS["all"].parts:
        assert f"({name}/report.md)" in page
        assert "| ball" in (out / name / "report.md").read_text() or name == "denoising"
        charts = ("curves.png", "curves.svg")
        assert all((out / name / chart).stat().st_size > 5000 for chart in charts)
    # What the paper printed stands beside.
    assert "8.20" in (out / "denoising" / "report.md").read_text()
    assert "ground truth" in drawn
    assert any(title.startswith("DMP, positions") for title in drawn)
    convolutions = [
        line for line in tables(out)["denoising/mad.csv"].splitlines() if "displacements" in line and "with truth" in line
    ]
    assert len(convolutions) == 4
    # Each training is an ordinary run.
    assert len(list_runs(out / "runs")) >= 14
    # Once more nothing is left to do, and the tables are the same.
    before = tables(out)
    assert run("all", ball, "--steps", "4", "--out", out, *rivals) == 0
    assert "done before" in capsys.readouterr().err
    assert tables(out) == before


def test_interrupted_and_continued_gives_the_same_tables_as_in_one_go(
    ball: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["smoothing", ball, "--steps", "60", "--threads", "1", "--set", "snapshot-every=10"]
    assert run(*arguments, "--out", tmp_path / "whole") == 0
    interrupted_at: list[int] = []

    def interrupting(job: Job, *rest: Any, told: Any, **options: Any) -> Any:
        def tell(share: float) -> None:
            told(share)
            # In the middle of the second training, between two snapshots.
            if job.settings is not None and job.settings.smoothing == "laplacian" and share >= 33 / 60 and not interrupted_at:
                interrupted_at.append(round(60 * share))
                os.kill(os.getpid(), signal.SIGINT)

        return do_job(job, *rest, told=tell, **options)

    monkeypatch.setattr(running, "do_job", interrupting)
    capsys.readouterr()
    assert run(*arguments, "--out", tmp_path / "parts") == 130
    assert "The same command goes on from here" in capsys.readouterr().err
    assert interrupted_at == [33]
    assert {run.state for run in list_runs(tmp_path / "parts" / "runs")} == {"finished", "stopped"}
    assert not tables(tmp_path / "parts")
    # What there is can be looked at all the same.
    assert run(*arguments, "--out", tmp_path / "parts", "--tables-only") == 0
    assert "not done yet" in (tmp_path / "parts" / "smoothing" / "report.md").read_text()
    assert run(*arguments, "--out", tmp_path / "parts") == 0
    assert tables(tmp_path / "parts") == tables(tmp_path / "whole")


def test_two_processes_give_the_tables_of_one(ball: Path, tmp_path: Path) -> None:
    arguments = ["laplacian", ball, "--steps", "5", "--seeds", "42", "1", "--threads", "1"]
    assert run(*arguments, "--out", tmp_path / "one") == 0
    assert run(*arguments, "--out", tmp_path / "two", "--jobs", "2") == 0
    assert tables(tmp_path / "two") == tables(tmp_path / "one")
    assert "±" in (tmp_path / "two" / "laplacian" / "report.md").read_text()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["denoising", "--preset", "best"], "--preset best is in the tables anyway"),
        (["denoising", "--set", "lambda=1"], "must be NAME=VALUE"),
        (["denoising", "--set", "laplacian-weight=-1"], "--laplacian-weight is -1"),
        (["denoising", "--set", "steps=3"], "has an option of its own"),
        (["denoising", "--jobs", "0"], "--jobs must be 1 or more"),
        (["denoising", "no-such-mesh"], "there is no such file, folder, sample or shape"),
        (["sculpting"], "sculpting"),
    ],
)
def test_wrong_usage_is_told_in_a_sentence_before_any_work(
    arguments: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*arguments, "--out", tmp_path / "out") == 2
    assert sentence in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out").exists()


def test_development_and_suggested_step_work_on_meshes_that_are_named(ball: Path, tmp_path: Path) -> None:
    options = ["--steps", "4", "--threads", "1", "--rivals", "taubin", "--out", tmp_path]
    assert run("development", ball, *options) == 0
    assert "| MAD | 1 |" in (tmp_path / "development" / "report.md").read_text()
    assert run("suggested-step", ball, *options) == 0
    assert "| suggested | 1 |" in (tmp_path / "suggested-step" / "report.md").read_text()
