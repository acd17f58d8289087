"""``dmp batch`` and ``dmp serve`` as a person types them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from dmp.batch import conducting
from dmp.cli import main


def call(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        main([str(argument) for argument in arguments])
    return int(end.value.code or 0)


def test_a_folder_is_restored_and_told_of(
    cluster: Any, scans: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # A worker that is started anew during the tests is not refused because sources were edited meanwhile.
    monkeypatch.setattr(conducting, "check_versions", lambda *_: ())
    (scans / "bad.obj").write_text("v 0 0\n")
    arguments = ["batch", scans, "--out", tmp_path / "out", "--scheduler", cluster.scheduler.address, "--ground-truth",
                 scans / "truth", "--steps", 8, "--snapshot-every", 4, "--threads", 1, "--format", "obj"]  # fmt: skip
    assert call(*arguments) == 3
    told = capsys.readouterr()
    assert told.out.strip() == str(tmp_path / "out" / "summary.html")
    assert "2 workers." in told.err
    assert "MAD" in told.err
    assert "1 of 4 jobs failed" in told.err
    assert "Traceback" not in told.err
    assert len(list((tmp_path / "out" / "results").glob("*.obj"))) == 3
    records = [json.loads(path.read_text())["outcome"] for path in (tmp_path / "out" / "records").iterdir()]
    assert sorted(bool(record["failure"]) for record in records) == [False, False, False, True]
    (scans / "bad.obj").unlink()
    assert call(*arguments) == 0
    assert "3 jobs, 3 of them done before" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["batch", "nowhere", "--out", "out"], "no such file or folder"),
        (["batch", "--out", "out"], "nothing to do"),
        (["batch", "{scans}", "--out", "out", "--keep", "best"], "needs a ground truth"),
        (["batch", "{scans}", "--out", "out", "--jobs", "-1"], "--jobs"),
        (["batch", "{scans}", "--out", "out", "--scheduler", "http://x"], "no address"),
        (["batch", "{scans}", "--out", "out", "--scheduler", "x", "--tls-cert", "a.pem"], "all three"),
        (["batch", "{scans}", "--out", "out", "--steps", "-3"], "--steps"),
        (["serve", "--port", "99999"], "--port"),
        (["serve", "--tls-ca-file", "a", "--tls-cert", "b", "--tls-key", "c"], "there is no such file"),
    ],
)
def test_wrong_use_is_told_in_a_line(
    scans: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    told: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert call(*(argument.format(scans=scans) for argument in arguments)) == 2
    error = capsys.readouterr().err.strip()
    assert told in error
    assert "Traceback" not in error
