"""Where the time of one training step goes, part by part, measured in the steps themselves."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn

from dmp.benchmark.settings import for_timing
from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.mesh import TriangleMesh
from dmp.methods import training_for
from dmp.problem import denoising
from dmp.recorrupted.filter_bank import diffusions, invariants
from dmp.recorrupted.network import RestorationNetwork
from dmp.training import Training

BEFORE, LOSSES, CHECKS, OPTIMISER = "draws of noise, copies", "losses", "checks", "optimiser, running average"
NETWORK, BANK, BILATERAL, ANCHOR, FLATTENING = "network", "filter bank", "bilateral layers", "anchor", "flattening layer"
BACKWARD = ", backward"
# What a part of the bank takes on its own, outside the steps; it is contained in that part.
DIFFUSIONS, FEATURES = "of it diffusions", "of it features"


class _Marks:
    """Gives the processor time since the last mark to the part that has just ended."""

    def __init__(self) -> None:
        self.parts: dict[str, float] = {}
        self._last = time.process_time()

    def restart(self) -> None:
        """Forget all, and begin now."""
        self.parts, self._last = {}, time.process_time()

    def mark(self, part: str) -> None:
        """Say that ``part`` has just ended."""
        now = time.process_time()
        self.parts[part] = self.parts.get(part, 0.0) + now - self._last
        self._last = now


def profile_step(
    mesh: TriangleMesh, preset: str, *, rounds: int = 5, threads: int = 0, **overrides: Any
) -> dict[str, dict[str, float]]:
    """Measure what each part of a training step takes, forward and backward.

    Args:
        mesh: noisy.
        preset: of denoising.
        rounds: steps that count, after one that warms up.
        threads: processor threads; 0 for all.
        overrides: of single settings.

    Returns:
        ``parts``: median processor seconds by part, in the order in which a step goes through them. ``alone``: of preset
        *best*, what two parts of the filter bank take on their own; they are contained in its time.
    """
    settings = for_timing(preset, threads, **overrides)
    training = training_for(denoising(mesh, settings), settings)
    if isinstance(training, DeepMeshPrior):
        # In one launch there is nothing to look at.
        training.makes_whole_steps = False
    marks = _Marks()
    _mark_parts(training, marks)
    steps = training.steps()
    next(steps)
    found: list[dict[str, float]] = []
    for number in range(rounds + 1):
        marks.restart()
        next(steps)
        marks.mark(OPTIMISER)
        if number:
            found.append(marks.parts)
    parts = {part: statistics.median(here.get(part, 0.0) for here in found) for part in found[0]}
    network = training._network
    alone = _bank_alone(training, rounds) if isinstance(network, RestorationNetwork) else {}
    return {"parts": parts, "alone": alone}


def profile_text(values: dict[str, dict[str, float]]) -> str:
    """Return the profile as lines for people."""
    parts = values["parts"]
    whole = sum(parts.values())
    lines = [f"  where {whole:.3f} s of processor time a step go, its parts one by one (forward, backward):"]
    for part in parts:
        if part.endswith(BACKWARD):
            continue
        both = (parts[part], parts.get(part + BACKWARD, 0.0))
        lines.append(f"    {part:34} {both[0]:7.3f} s {both[1]:7.3f} s {100 * sum(both) / whole:5.0f} %")
        if part == BANK:
            lines += [f"      {name:32} {seconds:7.3f} s" for name, seconds in values["alone"].items()]
    return "\n".join(lines)


def _mark_parts(training: Training, marks: _Marks) -> None:
    """Have the network and the training mark the ends of their parts."""
    network: nn.Module = training._network
    network.register_forward_pre_hook(lambda *_: marks.mark(BEFORE))
    if isinstance(network, RestorationNetwork):
        _mark_restoration(network, marks)
    else:
        network.register_forward_hook(lambda *_: marks.mark(NETWORK))
    network.register_forward_hook(lambda _, __, output: _when_known(output, marks, LOSSES + BACKWARD))
    last_known = BANK if isinstance(network, RestorationNetwork) else NETWORK
    _after(training, "_forward", lambda: marks.mark(LOSSES))
    _after(training, "_compute_gradients", lambda: marks.mark(last_known + BACKWARD))
    _after(training, "_check_finite", lambda: marks.mark(CHECKS))


def _mark_restoration(network: RestorationNetwork, marks: _Marks) -> None:
    def before_layers(positions: Tensor) -> None:
        marks.mark(BANK)
        _when_known(positions, marks, BILATERAL + BACKWARD)

    def after_layers(positions: Tensor) -> None:
        marks.mark(BILATERAL)
        _when_known(positions, marks, ANCHOR + BACKWARD)

    def before_flattening(positions: Tensor) -> None:
        marks.mark(ANCHOR)
        _when_known(positions, marks, FLATTENING + BACKWARD)

    network.bank.register_forward_hook(lambda _, __, output: before_layers(output))
    if network.layers:
        network.layers[-1].register_forward_hook(lambda _, __, outputs: after_layers(outputs[0]))
    network.flattening.register_forward_pre_hook(lambda _, inputs: before_flattening(inputs[0]))
    network.flattening.register_forward_hook(lambda *_: marks.mark(FLATTENING))


def _when_known(values: Tensor, marks: _Marks, part: str) -> None:
    """Have ``part`` end when the gradient of ``values`` is known."""
    if values.requires_grad:
        values.register_hook(lambda _: marks.mark(part))  # type: ignore[no-untyped-call]


def _after(training: Training, method: str, then: Callable[[], None]) -> None:
    """Call ``then`` after each call of a method of this training."""
    original = getattr(training, method)

    def followed(*arguments: Any, **named: Any) -> Any:
        result = original(*arguments, **named)
        then()
        return result

    setattr(training, method, followed)


def _bank_alone(training: Any, rounds: int) -> dict[str, float]:
    piece, level = training._pieces[0], training._level
    taken: dict[str, list[float]] = {DIFFUSIONS: [], FEATURES: []}
    with torch.no_grad():
        for _ in range(rounds + 1):
            marks = _Marks()
            differences, normals = diffusions(piece.positions, piece.operators.half_lazy, piece.operators.incidence)
            marks.mark(DIFFUSIONS)
            invariants(differences, normals, level)
            marks.mark(FEATURES)
            for name, seconds in marks.parts.items():
                taken[name].append(seconds)
    return {name: statistics.median(seconds[1:]) for name, seconds in taken.items()}
