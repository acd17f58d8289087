"""Checkpoints from others: nothing in them is run, or allocated on its word, and all of it has to fit."""

from __future__ import annotations

import hashlib
import io
import pickle
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dmp.errors import RunError, TrainingError
from dmp.run_files import checkpoint_bytes, parse_checkpoint
from dmp.runs import Run, record
from dmp.training_state import tensor_bytes
from tests.dmp.hostile_runs.damages import Malice, zipped


def _signed(body: bytes) -> bytes:
    return b"dmp-checkpoint 1 sha256 " + hashlib.sha256(body).hexdigest().encode() + b"\n" + body


def _state(folder: Path) -> dict[str, Any]:
    return parse_checkpoint((folder / "checkpoint.pt").read_bytes(), "")


def test_a_checkpoint_comes_back_as_it_was(folder: Path) -> None:
    state = _state(folder)
    assert state["step"] == 4
    assert state["run_id"] == Run.open(folder).run_id
    assert Run.open(folder).resume().step == 4


def test_damage_of_a_checkpoint_is_found(folder: Path) -> None:
    content = bytearray((folder / "checkpoint.pt").read_bytes())
    for position in np.random.default_rng(0).integers(0, len(content), 60):
        flipped = bytearray(content)
        flipped[position] ^= 1
        with pytest.raises(RunError):
            parse_checkpoint(bytes(flipped), "")
    for length in (0, 10, len(content) // 2, len(content) - 1):
        with pytest.raises(RunError):
            parse_checkpoint(bytes(content[:length]), "")


@pytest.mark.parametrize("wrap", [lambda body: body, zipped])
@pytest.mark.parametrize("protocol", [0, 2, 5])
def test_code_in_a_checkpoint_is_not_run(
    wrap: Callable[[bytes], bytes], protocol: int, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MALICE", str(tmp_path / "harm"))
    body = pickle.dumps({"version": 1, "network": Malice()}, protocol=protocol)
    (folder / "checkpoint.pt").write_bytes(_signed(wrap(body)))
    with pytest.raises(RunError):
        Run.open(folder).resume()
    assert not (tmp_path / "harm").exists()


def test_a_compressed_checkpoint_is_not_unpacked() -> None:
    bomb = zipped(b"\0" * 200_000_000, zipfile.ZIP_DEFLATED)
    assert len(bomb) < 1_000_000
    begin = time.monotonic()
    with pytest.raises(RunError, match="cannot be used"):
        parse_checkpoint(_signed(bomb), "")
    assert time.monotonic() - begin < 2


def test_a_checkpoint_that_claims_more_than_it_holds_is_refused(folder: Path) -> None:
    state = _state(folder)
    state["average"] = torch.zeros(1).expand(10**12)
    with pytest.raises(RunError, match="cannot be used"):
        parse_checkpoint(checkpoint_bytes(state), "")
    laughs: Any = torch.zeros(4)
    for _ in range(7):
        laughs = [laughs] * 100
    with pytest.raises(ValueError, match="too many"):
        tensor_bytes({"average": laughs})
    deep: Any = 0
    for _ in range(100):
        deep = [deep]
    with pytest.raises(ValueError, match="deeply"):
        tensor_bytes({"average": deep})


def test_a_checkpoint_larger_than_any_is_not_read(folder: Path) -> None:
    with (folder / "checkpoint.pt").open("r+b") as file:
        file.truncate(10**10)
    begin = time.monotonic()
    with pytest.raises(RunError, match="more than this program ever writes"):
        Run.open(folder).resume()
    assert time.monotonic() - begin < 2


def _spoilt(change: str, state: dict[str, Any]) -> Any:
    first = next(iter(state["network"]))
    moments = state["optimiser"]["state"]
    match change:
        case "list":
            return None
        case "version":
            state["version"] = 2
        case "weights that are no numbers":
            state["network"][first] = state["network"][first] * float("nan")
        case "average that is none":
            state["average"] = torch.full_like(state["average"], float("inf"))
        case "shape":
            state["network"][first] = state["network"][first][:-1]
        case "name":
            state["network"]["further"] = torch.zeros(3)
        case "text":
            state["network"] = "none"
        case "step":
            state["step"] = 10**30
        case "negative step":
            state["step"] = -1
        case "step as a text":
            state["step"] = "4"
        case "seconds":
            state["seconds"] = float("nan")
        case "shape of a moment":
            moments[0]["exp_avg"] = torch.zeros(1)
        case "fewer moments":
            del moments[0]
        case "negative moment":
            moments[0]["exp_avg_sq"] = -torch.ones_like(moments[0]["exp_avg_sq"])
        case "moment of whole numbers":
            moments[0]["exp_avg"] = moments[0]["exp_avg"].to(torch.int64)
        case "another mesh":
            state["average"] = state["average"][:-1]
        case "missing":
            del state["optimiser"]
        case "rest":
            state["rest"] = {"before": (1, torch.zeros(5, 3, dtype=torch.float64)), "resting_since": None}
        case "another run":
            state["run_id"] = "0" * 32
        case _:
            raise AssertionError(change)
    return state


@pytest.mark.parametrize(
    "change",
    ["list", "version", "weights that are no numbers", "average that is none", "shape", "name", "text", "step", "negative step",
     "step as a text", "seconds", "shape of a moment", "fewer moments", "negative moment", "moment of whole numbers",
     "another mesh", "missing", "rest", "another run"],
)  # fmt: skip
def test_a_state_that_does_not_fit_is_refused(change: str, folder: Path) -> None:
    spoilt = _spoilt(change, _state(folder))
    content = _signed_list() if spoilt is None else checkpoint_bytes(spoilt)
    (folder / "checkpoint.pt").write_bytes(content)
    with pytest.raises((RunError, TrainingError)) as caught:
        Run.open(folder).resume()
    assert "\n" not in str(caught.value)


def _signed_list() -> bytes:
    buffer = io.BytesIO()
    torch.save([1, 2, 3], buffer)
    return _signed(buffer.getvalue())


def test_the_settings_of_the_optimiser_are_those_of_the_run(folder: Path) -> None:
    state = _state(folder)
    for group in state["optimiser"]["param_groups"]:
        group.update(lr=float("nan"), betas="none", fused=None, params=[10**6])
    (folder / "checkpoint.pt").write_bytes(checkpoint_bytes(state))
    run = Run.open(folder)
    *_, last = record(run.resume(), run)
    assert last.step == 8
    assert np.isfinite(list(last.metrics.values())).all()
