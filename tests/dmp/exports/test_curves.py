from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dmp.cli import main
from dmp.errors import DmpError, MeshFileError
from dmp.exports.curves import curve_chart, curve_csv, marks_of, write_curve
from dmp.runs import Run


def test_the_table_holds_every_digit_of_the_curve(denoised: Run) -> None:
    rows = denoised.curve()
    read = list(csv.DictReader(io.StringIO(curve_csv(rows).decode())))
    assert [int(row["step"]) for row in read] == [0, 1, 5, 10, 15, 20]
    for row, line in zip(rows, read, strict=True):
        assert {name: float(text) for name, text in line.items()} == row


def test_what_was_not_measured_at_a_step_is_empty() -> None:
    table = curve_csv([{"step": 0, "seconds": 0.0}, {"step": 5, "seconds": 1.5, "mad": 3.25, "something_new": 1e-300}])
    assert table.decode() == "step,seconds,mad,something_new\n0,0.0,,\n5,1.5,3.25,1e-300\n"


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_a_chart_is_drawn_in_each_format_and_always_the_same(denoised: Run, tmp_path: Path, suffix: str) -> None:
    starts = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
    for name in ("a", "b"):
        write_curve(tmp_path / f"{name}{suffix}", denoised.curve(), denoised.settings, marks=marks_of(denoised), title="t")
    content = (tmp_path / f"a{suffix}").read_bytes()
    assert content.startswith(starts[suffix])
    assert content == (tmp_path / f"b{suffix}").read_bytes()


def test_a_line_goes_where_its_values_are() -> None:
    falling = [{"step": step, "seconds": 0.0, "mad": 50.0 - step} for step in range(1, 50)]
    rising = [{"step": step, "seconds": 0.0, "mad": float(step)} for step in range(1, 50)]

    def middle_of_line(rows: list[dict[str, float]], share: float) -> float:
        pixels = np.asarray(Image.open(io.BytesIO(curve_chart(rows, None, measures=["mad"]))).convert("RGB")).astype(int)
        colored = (np.abs(pixels - (0x00, 0x79, 0x6B)) < 30).all(axis=2)
        # Without the legend below.
        colored[int(0.8 * len(colored)) :] = False
        columns = np.flatnonzero(colored.any(axis=0))
        column = columns[int(share * (len(columns) - 1))]
        return float(np.flatnonzero(colored[:, column]).mean())

    assert middle_of_line(falling, 0.02) < middle_of_line(falling, 0.98) - 200
    assert middle_of_line(rising, 0.02) > middle_of_line(rising, 0.98) + 200


def test_nothing_measured_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(DmpError, match="no curve yet"):
        write_curve(tmp_path / "a.csv", [], None)
    with pytest.raises(DmpError, match="nothing to draw yet"):
        write_curve(tmp_path / "a.png", [{"step": 0, "seconds": 0.0, "mad": 3.0}], None)
    with pytest.raises(MeshFileError, match=r"\.csv or \.png"):
        write_curve(tmp_path / "a.xls", [{"step": 1, "seconds": 0.0}], None)
    assert list(tmp_path.iterdir()) == []


def test_the_command(denoised: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for target in ("c.csv", "c.svg"):
        with pytest.raises(SystemExit) as ended:
            main(["curve", str(denoised.folder), "-o", str(tmp_path / target)])
        assert ended.value.code == 0
    assert (tmp_path / "c.csv").read_bytes() == curve_csv(denoised.curve())
    with pytest.raises(SystemExit) as ended:
        main(["curve", str(denoised.folder), "-o", str(tmp_path / "d.svg"), "--measure", "beauty"])
    assert ended.value.code == 2
    assert "--measure beauty: this run has measured data_loss" in capsys.readouterr().err
