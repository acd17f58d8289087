"""A training step that is recorded once and replayed trains as one that is done anew each time, to the last bit."""

from __future__ import annotations

import copy
import gc
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from dmp.adam import Adam
from dmp.benchmark.meshes import noisy_torus
from dmp.captured_step import WARM_UP, CapturedStep, CudaGraphRecorder
from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.errors import SettingsError, TrainingError
from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.problem import denoising
from dmp.runs import Run, record
from dmp.settings import settings_for
from dmp.snapshot import StepRecord
from tests.dmp.dispatch_recorder import DispatchRecorder, Refusing, refused

STEPS = 12


@pytest.fixture
def on_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """Numbers that change with the step come from the device, as on a GPU."""
    monkeypatch.setattr(DeepMeshPrior, "_looks_at_each_step", False)


def _training(mesh: TriangleMesh, recorder: DispatchRecorder | None = None, **overrides: object) -> DeepMeshPrior:
    few = {"steps": STEPS, "snapshot_every": 6, "log_every": 4, "threads": 1, "device": "cpu"}
    settings = settings_for("denoise", **{**few, **overrides})
    training = training_for(denoising(mesh, settings), settings)
    assert isinstance(training, DeepMeshPrior)
    # The plain layers, which a GPU takes.
    training._has_buffers, training._compiles_losses, training._patch_vertices = False, False, 0
    training._recorder = recorder
    return training


def _tensors(state: object) -> list[Tensor]:
    if isinstance(state, Tensor):
        return [state]
    values = state.values() if isinstance(state, dict) else state if isinstance(state, list | tuple) else ()
    return [tensor for value in values for tensor in _tensors(value)]


def _assert_same(one: DeepMeshPrior, other: DeepMeshPrior) -> None:
    ours, theirs = _tensors(one.state()), _tensors(other.state())
    assert len(ours) > 50
    assert all(torch.equal(left, right) for left, right in zip(ours, theirs, strict=True))
    assert one.step == other.step
    assert int(one._first_bad) == int(other._first_bad)
    assert torch.equal(one._output, other._output)


def _assert_same_records(ours: list[StepRecord], theirs: list[StepRecord]) -> None:
    assert [item.step for item in ours] == [item.step for item in theirs]
    assert [dict(item.metrics) for item in ours] == [dict(item.metrics) for item in theirs]
    for mine, other in zip(ours, theirs, strict=True):
        assert (mine.snapshot is None) == (other.snapshot is None)
        if mine.snapshot is not None and other.snapshot is not None:
            assert np.array_equal(mine.snapshot.vertices, other.snapshot.vertices)


@pytest.mark.usefixtures("on_device")
@pytest.mark.parametrize(
    "variant",
    [
        {},
        {"average": 0.0, "hold_out": 0.0},
        {"skip": True, "laplacian_form": "sum"},
        {"convolution": "chebyshev", "predict": "position"},
        {"convolution": "gmm", "gmm_kernels": 2, "architecture": "2021-04"},
        {"preset": "paper", "width_divisor": 16},
    ],
    ids=str,
)
def test_replayed_steps_are_usual_steps_to_the_last_bit(variant: dict[str, object], noisy_sphere: TriangleMesh) -> None:
    recorder = DispatchRecorder()
    usual, replayed = _training(noisy_sphere, **variant), _training(noisy_sphere, recorder, **variant)
    # Looked at when both have ended, so that a record that kept a tensor which later steps overwrite would show.
    _assert_same_records(list(replayed.steps()), list(usual.steps()))
    _assert_same(replayed, usual)
    assert (recorder.done, recorder.recorded, recorder.replayed) == (WARM_UP, 1, STEPS - WARM_UP)
    assert replayed.warnings == []


def test_counting_on_the_device_changes_no_bit(noisy_sphere: TriangleMesh, monkeypatch: pytest.MonkeyPatch) -> None:
    usual = _training(noisy_sphere, steps=30)
    records = list(usual.steps())
    monkeypatch.setattr(DeepMeshPrior, "_looks_at_each_step", False)
    counting = _training(noisy_sphere, steps=30)
    _assert_same_records(list(counting.steps()), records)
    _assert_same(counting, usual)
    assert int(counting._device_step) == 30


@pytest.mark.usefixtures("on_device")
def test_recording_itself_changes_nothing_and_the_recording_is_of_a_whole_step(noisy_sphere: TriangleMesh) -> None:
    training = _training(noisy_sphere)
    steps = training.steps()
    for _ in range(WARM_UP + 1):
        next(steps)
    before = [tensor.clone() for tensor in _tensors(training.state())]
    recorder = DispatchRecorder()
    losses = recorder.record(training._unread_update)
    assert recorder.n_operations > 300
    assert all(torch.equal(left, right) for left, right in zip(before, _tensors(training.state()), strict=True))
    # What it returns holds nothing before the first replay.
    assert all(torch.isnan(value) for value in losses.values())
    recorder.replay()
    assert all(torch.isfinite(value) for value in losses.values())
    changed = [not torch.equal(left, right) for left, right in zip(before, _tensors(training.state()), strict=True)]
    # All but the biases before a normalisation, whose gradient is 0 but for rounding, may count on having moved.
    assert sum(changed) > 0.7 * len(changed)


# -- what a recording refuses ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "read",
    [
        lambda values: values.sum().item(),
        lambda values: bool(values.sum() > 0),
        lambda values: values[values > 0],
        lambda values: values.nonzero(),
        lambda values: values * torch.tensor(2.0),
        lambda values: torch.equal(values, values + 1),
        lambda values: values.to("meta"),
    ],
)
def test_the_guard_refuses_what_waits_for_a_gpu_or_brings_numbers_to_it(read: Callable[[Tensor], object]) -> None:
    values = torch.arange(4.0)
    assert "not permitted" in refused(lambda: read(values))
    assert refused(lambda: values.mul_(2).double().clamp(max=3.0)) == ""

    def step() -> dict[str, Tensor]:
        values.add_(1)
        read(values)
        return {"total_loss": values}

    before = values.clone()
    with pytest.raises(RuntimeError, match="not permitted"):
        DispatchRecorder().record(step)
    assert torch.equal(values, before)


@pytest.mark.usefixtures("on_device")
def test_a_step_between_two_logged_ones_reads_nothing(noisy_sphere: TriangleMesh) -> None:
    training = _training(noisy_sphere, DispatchRecorder())
    steps = training.steps()
    assert [next(steps).step for _ in range(WARM_UP + 2)][-1] == 4
    with Refusing():
        assert next(steps).metrics == {}
    # Step 6 has a snapshot.
    assert "not permitted" in refused(lambda: next(steps))


@pytest.mark.usefixtures("on_device")
def test_a_step_stays_on_its_device(noisy_sphere: TriangleMesh) -> None:
    # The meta device holds no values: whoever reads one from it, or brings a tensor from the processor, is refused by torch.
    training = _training(noisy_sphere)
    for name, value in vars(training).items():
        if isinstance(value, Tensor):
            setattr(training, name, torch.empty(value.shape, dtype=value.dtype, device="meta"))
    for module in training._network.modules():
        for name, parameter in module._parameters.items():
            module._parameters[name] = None if parameter is None else nn.Parameter(torch.empty_like(parameter, device="meta"))
        for name, buffer in module._buffers.items():
            module._buffers[name] = None if buffer is None else torch.empty_like(buffer, device="meta")
    training._optimiser = Adam(training._network.parameters(), lr=0.01)
    for _ in range(2):
        losses = training._unread_update()
    assert {value.device.type for value in losses.values()} == {"meta"}
    assert training._average is not None
    assert training._average.device.type == "meta"
    with pytest.raises(RuntimeError, match="meta"):
        training._look_at_first_bad()


# -- when it cannot be recorded ----------------------------------------------------------------------------------------


@pytest.mark.usefixtures("on_device")
@pytest.mark.parametrize("fails_at", [0, 100, 330, 380])
def test_a_step_that_cannot_be_recorded_goes_on_as_usual_and_says_so_once(
    fails_at: int, noisy_sphere: TriangleMesh, tmp_path: Path
) -> None:
    usual = _training(noisy_sphere)
    records = list(usual.steps())
    recorder = DispatchRecorder(fails_at)
    refusing = _training(noisy_sphere, recorder)
    run = Run.create(refusing.problem, refusing.settings, folder=tmp_path / "run")
    _assert_same_records(list(record(refusing, run)), records)
    _assert_same(refusing, usual)
    assert (recorder.done, recorder.recorded, recorder.replayed) == (WARM_UP, 1, 0)
    assert len(refusing.warnings) == 1
    assert f"operation {fails_at} cannot be recorded" in refusing.warnings[0]
    assert run.warnings == refusing.warnings


@pytest.mark.usefixtures("on_device")
def test_a_step_that_reads_a_number_is_refused_in_the_training_too(
    noisy_sphere: TriangleMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    apply = DeepMeshPrior._apply_gradients

    def reading(training: DeepMeshPrior) -> None:
        training._output.sum().item()
        apply(training)

    monkeypatch.setattr(DeepMeshPrior, "_apply_gradients", reading)
    usual, refused_one = _training(noisy_sphere), _training(noisy_sphere, DispatchRecorder())
    _assert_same_records(list(refused_one.steps()), list(usual.steps()))
    assert "_local_scalar_dense" in refused_one.warnings[0]


def test_an_interruption_while_recording_is_no_refusal() -> None:
    value, interrupts = torch.zeros(()), True

    def step() -> dict[str, Tensor]:
        value.add_(1)
        if interrupts and captured._n_done >= WARM_UP:
            raise KeyboardInterrupt
        return {"total_loss": value * 2}

    captured = CapturedStep(step, DispatchRecorder(), lambda: None)
    for _ in range(WARM_UP):
        captured()
    with pytest.raises(KeyboardInterrupt):
        captured()
    assert value == WARM_UP
    interrupts = False
    assert captured()["total_loss"] == 2 * (WARM_UP + 1)
    assert captured.refusal is None


# -- going on, stopping, failing ---------------------------------------------------------------------------------------


@pytest.mark.usefixtures("on_device")
@pytest.mark.parametrize("average", [0.99, 0.0])
def test_after_a_state_was_loaded_the_step_is_recorded_anew(average: float, noisy_sphere: TriangleMesh) -> None:
    usual = _training(noisy_sphere, average=average)
    records = list(usual.steps())
    recorder = DispatchRecorder()
    training = _training(noisy_sphere, recorder, average=average)
    steps = training.steps()
    state = None
    for item in steps:
        if item.step == 5:
            state = copy.deepcopy(training.state())
        if item.step == 8:
            break
    assert state is not None
    assert (recorder.recorded, recorder.replayed) == (1, 8 - WARM_UP)
    # In the midst, with the same iterator going on; all tensors of average and optimiser are others now.
    training.load_state(state)
    assert recorder.n_operations == 0
    _assert_same_records(list(steps), records[6:])
    _assert_same(training, usual)
    assert recorder.recorded == 2
    fresh = _training(noisy_sphere, DispatchRecorder(), average=average)
    fresh.load_state(state)
    _assert_same_records(list(fresh.steps()), records[6:])


@pytest.mark.usefixtures("on_device")
def test_a_training_that_was_stopped_shows_its_step_and_goes_on(noisy_sphere: TriangleMesh) -> None:
    recorder = DispatchRecorder()
    usual, training = _training(noisy_sphere), _training(noisy_sphere, recorder)
    ours, theirs = training.steps(), usual.steps()
    for _ in range(8):
        next(ours)
        next(theirs)
    assert training.step == 7
    ours.close()  # type: ignore[attr-defined]
    assert recorder.n_operations == 0
    mine, other = training.current(), usual.current()
    assert mine is not None
    assert other is not None
    _assert_same_records([mine], [other])
    _assert_same_records(list(training.steps()), list(theirs))
    _assert_same(training, usual)


@pytest.mark.usefixtures("on_device")
def test_a_replay_remembers_the_first_step_that_is_not_finite(noisy_sphere: TriangleMesh) -> None:
    training = _training(noisy_sphere, DispatchRecorder(), steps=30, snapshot_every=30, log_every=10)
    state, reached = None, 0
    with pytest.raises(TrainingError, match="at step 14: the loss or its gradient"):
        for item in training.steps():
            reached = item.step
            if item.step == 11:
                state = copy.deepcopy(training.state())
            if item.step == 13:
                with torch.no_grad():
                    next(training._network.parameters()).fill_(float("nan"))
    assert reached == 19
    # From a good state it goes on, and what was bad before is forgotten.
    assert state is not None
    training.load_state(state)
    assert [item.step for item in training.steps()][-1] == 30


# -- the recorder for GPUs ---------------------------------------------------------------------------------------------


class _PretendedGpu:
    """Writes down which calls of torch.cuda are made, in place of them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.calls: list[str] = []
        note = self.calls.append

        class Context:
            def __init__(self, what: object) -> None:
                self._what = what

            def __enter__(self) -> None:
                note(f"enter {self._what}")

            def __exit__(self, *_: object) -> None:
                note(f"leave {self._what}")

        class Stream:
            def __init__(self, name: str = "own") -> None:
                self._name = name

            def __str__(self) -> str:
                return self._name

            def wait_stream(self, other: Stream) -> None:
                note(f"{self} waits for {other}")

        class Graph:
            def capture_begin(self, capture_error_mode: str) -> None:
                note(f"begin {capture_error_mode}")

            def capture_end(self) -> None:
                note("end")
                if "break" in outer.calls:
                    raise RuntimeError("capture was invalidated")

            def replay(self) -> None:
                note("replay")

            def reset(self) -> None:
                note("reset")

        outer = self
        current = Stream("current")
        for name, value in {
            "device": Context,
            "stream": Context,
            "Stream": Stream,
            "CUDAGraph": Graph,
            "current_stream": lambda: current,
            "synchronize": lambda *_: note("synchronise"),
            "empty_cache": lambda: note("empty"),
        }.items():
            monkeypatch.setattr(torch.cuda, name, value)
        monkeypatch.setattr(gc, "collect", lambda *_: pytest.fail("garbage was looked for in the training's thread"))


def test_a_gpu_records_on_the_stream_of_the_steps_before(monkeypatch: pytest.MonkeyPatch) -> None:
    gpu = _PretendedGpu(monkeypatch)
    recorder = CudaGraphRecorder(torch.device("cuda:1"))

    def step() -> dict[str, Tensor]:
        gpu.calls.append("step")
        return {}

    captured = CapturedStep(step, recorder, lambda: gpu.calls.append("no gradients"))
    captured()
    one = ["enter cuda:1", "own waits for current", "enter own", "step", "leave own", "current waits for own", "leave cuda:1"]
    assert gpu.calls == one
    for _ in range(WARM_UP - 1):
        captured()
    gpu.calls.clear()
    captured()
    recording = ["enter own", "begin thread_local", "step", "end", "leave own"]
    assert gpu.calls == ["no gradients", "enter cuda:1", "synchronise", "empty", *recording, "leave cuda:1", "replay"]
    gpu.calls.clear()
    captured()
    recorder.forget()
    recorder.forget()
    assert gpu.calls == ["replay", "synchronise", "reset"]
    with pytest.raises(RuntimeError, match="no recorded step"):
        recorder.replay()


def test_a_recording_that_breaks_off_is_ended_and_its_cause_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    gpu = _PretendedGpu(monkeypatch)
    recorder = CudaGraphRecorder(torch.device("cuda"))

    def step() -> dict[str, Tensor]:
        if "break" not in gpu.calls and "begin thread_local" in gpu.calls:
            gpu.calls.append("break")
            raise RuntimeError("operation not permitted\nwhen stream is capturing")
        gpu.calls.append("step")
        return {}

    captured = CapturedStep(step, recorder, lambda: gpu.calls.append("no gradients"))
    for _ in range(WARM_UP):
        captured()
    gpu.calls.clear()
    captured()
    assert captured.refusal == "operation not permitted when stream is capturing"
    broken = ["begin thread_local", "break", "end", "leave own", "leave cuda", "no gradients", "step"]
    assert gpu.calls[-len(broken) :] == broken


@pytest.mark.parametrize("error", [None, ValueError])
@pytest.mark.parametrize(("precision", "expected"), [("auto", "tf32"), ("float32", "ieee")])
def test_products_on_a_gpu_are_as_the_settings_say_and_afterwards_as_before(
    precision: str, expected: str, error: type[Exception] | None, noisy_sphere: TriangleMesh
) -> None:
    training = _training(noisy_sphere, precision=precision)
    products = torch.backends.cuda.matmul
    before = products.fp32_precision
    with training._arithmetic():
        assert products.fp32_precision == before
    training.device = torch.device("cuda")
    try:
        with training._arithmetic():
            assert products.fp32_precision == expected
            if error is not None:
                raise error
    except ValueError:
        pass
    assert products.fp32_precision == before


def test_bfloat16_on_a_gpu_is_refused_before_anything_is_made(
    noisy_sphere: TriangleMesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    settings = settings_for("denoise", device="cuda", precision="bfloat16")
    with pytest.raises(SettingsError, match="--precision auto"):
        training_for(denoising(noisy_sphere, settings), settings)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU here, or torch cannot use it")
@pytest.mark.parametrize("precision", ["float32", "auto"])
def test_on_a_gpu_replayed_steps_train_as_usual_ones(precision: str, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = noisy_torus(5000)
    settings = settings_for(
        "denoise", device="cuda", precision=precision, steps=200, snapshot_every=200, log_every=50, hold_out=0.1
    )
    found, seconds = [], []
    for replays in (False, True):
        training = training_for(denoising(mesh, settings), settings)
        assert isinstance(training, DeepMeshPrior)
        if not replays:
            training._recorder = None
        started = 0.0
        records = []
        for item in training.steps():
            if item.step == 50:
                torch.cuda.synchronize()
                started = time.perf_counter()
            records.append(item)
        torch.cuda.synchronize()
        seconds.append((time.perf_counter() - started) / 150)
        assert training.warnings == []
        found.append(records)
    with capsys.disabled():
        print(f"\n{mesh.n_vertices} vertices, {precision}: {seconds[0]:.5f} s a step as usual, {seconds[1]:.5f} s replayed")
    for usual, replayed in zip(*found, strict=True):
        assert dict(replayed.metrics) == pytest.approx(dict(usual.metrics), rel=1e-2, abs=1e-3)
