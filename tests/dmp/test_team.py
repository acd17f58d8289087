"""How many threads share a launch, on a made-up machine."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch

from dmp.benchmark.meshes import noisy_torus
from dmp.compiled import launching
from dmp.compiled.team import Team
from dmp.deep_mesh_prior import DeepMeshPrior
from dmp.layers import stack_buffers
from dmp.methods import training_for
from dmp.problem import denoising
from dmp.settings import settings_for


def _launch(team: Team, cores: int, busy: int) -> float:
    """Let a team launch work of one second where other programs keep some cores busy, and return what it took."""
    free = max(1, cores - busy)
    # Threads without a core of their own hold up the others by far.
    seconds = 1 / team.size if team.size <= free else 10.0
    team.took(seconds, min(team.size, free) * seconds)
    return seconds


@pytest.mark.parametrize(
    ("cores", "busy", "best"), [(2, 0, 2), (2, 1, 1), (8, 0, 8), (8, 1, 4), (8, 4, 4), (8, 5, 2), (1, 0, 1)]
)
def test_it_finds_the_size_that_suits_the_machine_and_stays_there(cores: int, busy: int, best: int) -> None:
    team = Team(cores)
    for _ in range(80):
        _launch(team, cores, busy)
    sizes = []
    for _ in range(2000):
        sizes.append(team.size)
        _launch(team, cores, busy)
    assert sizes.count(best) > 0.97 * len(sizes)


def test_on_a_free_machine_nothing_is_tried() -> None:
    team = Team(4)
    for _ in range(1000):
        _launch(team, 4, 0)
        assert team.size == 4


def test_it_follows_what_other_programs_do() -> None:
    team = Team(4)
    for _ in range(3):
        for _ in range(100):
            _launch(team, 4, 3)
        assert team.size == 1
        for _ in range(600):
            _launch(team, 4, 0)
        assert team.size == 4


def test_a_busy_machine_costs_little() -> None:
    team = Team(2)
    assert sum(_launch(team, 2, 1) for _ in range(1000)) < 1.12 * 1000


def test_what_only_looks_disturbed_is_tried_ever_more_seldom() -> None:
    # Twice as many threads are quicker, although the processor says that they wait.
    team = Team(2)
    tried = 0
    for _ in range(3000):
        tried += team.size == 1
        team.took(1 / team.size, 0.5)
    assert 0 < tried < 20


def test_fewer_threads_change_no_digit(monkeypatch: pytest.MonkeyPatch) -> None:
    if stack_buffers.packing_for(torch.float32) is None:
        pytest.skip("torch brings no MKL along here")
    used: list[int] = []
    original = launching._in_parallel
    if original is None:
        pytest.skip("torch's threads are not found here")

    def counted(*given: int) -> None:
        used.append(given[2])
        original(*given)

    monkeypatch.setattr(launching, "_in_parallel", counted)

    def run(size: Callable[[int], int]) -> list[np.ndarray]:
        settings = settings_for("denoise", "compact", threads=3, device="cpu", precision="float32", steps=12, log_every=4)
        training = training_for(denoising(noisy_torus(1350), settings), settings)
        assert isinstance(training, DeepMeshPrior)
        found = []
        for item in training.steps():
            found.append(training._prediction().numpy().copy())
            if training._whole_step is not None:
                training._whole_step._team.size = size(item.step)
                monkeypatch.setattr(Team, "took", lambda *_: None)
        return found

    alike = run(lambda _: 3)
    assert set(used) == {3}
    for other in (run(lambda _: 1), run(lambda step: 1 + step % 3)):
        assert all(np.array_equal(one, two) for one, two in zip(alike, other, strict=True))
    assert set(used) == {2, 3}


def test_a_product_in_a_kernel_on_one_thread_is_not_divided(monkeypatch: pytest.MonkeyPatch) -> None:
    # torch tells MKL of its threads, and so it must be again after a launch.
    set_threads, original, seen = launching._set_threads_of_products, launching._CALL, []
    torch.set_num_threads(2)
    if set_threads(2) != 2:
        pytest.skip("torch brings no MKL along here")

    def call(address: int) -> Callable[[int], None]:
        seen.append(set_threads(1))
        return original(address)

    monkeypatch.setattr(launching, "_CALL", call)
    settings = settings_for("denoise", "compact", threads=2, device="cpu", steps=2)
    list(training_for(denoising(noisy_torus(150), settings), settings).steps())
    assert seen and set(seen) == {1}
    assert set_threads(2) == 2
