from __future__ import annotations

import math
import subprocess
import sys

import pytest
import torch
from torch import nn

from dmp.adam import Adam
from dmp.compiled.parameter_passes import adam_step, are_finite


def _parameters() -> list[nn.Parameter]:
    generator = torch.Generator().manual_seed(0)
    return [nn.Parameter(torch.randn(shape, generator=generator)) for shape in ((3, 4), (5,), (70, 700), (2,))]


def _step(parameters: list[nn.Parameter], optimiser: Adam | torch.optim.Adam, number: int) -> None:
    optimiser.zero_grad()
    for parameter in parameters[:-1]:
        parameter.grad = torch.sin(number + 3 * parameter.detach())
    optimiser.step()


@pytest.mark.parametrize("has_kernels", [True, False])
def test_every_step_is_that_of_torch(has_kernels: bool) -> None:
    ours, theirs = _parameters(), _parameters()
    mine, other = Adam(ours, lr=0.01), torch.optim.Adam(theirs, lr=0.01, fused=True)
    mine.has_kernels = has_kernels
    for number in range(20):
        for optimiser in (mine, other):
            optimiser.param_groups[0]["lr"] = 0.01 / (1 + number)
        _step(ours, mine, number)
        _step(theirs, other, number)
        # Without kernels to the last digit; these may add after a product without rounding in between.
        tolerance = {"rtol": 1e-6 if has_kernels else 0.0, "atol": 1e-9 if has_kernels else 0.0}
        for left, right in zip(ours, theirs, strict=True):
            torch.testing.assert_close(left, right, **tolerance)
    # The last one has never had a gradient.
    assert torch.equal(ours[-1], _parameters()[-1])


def test_threads_change_no_digit() -> None:
    found = []
    before = torch.get_num_threads()
    for threads in (1, 2, 3):
        parameters = _parameters()
        optimiser = Adam(parameters, lr=0.01)
        torch.set_num_threads(threads)
        try:
            for number in range(3):
                _step(parameters, optimiser, number)
        finally:
            torch.set_num_threads(before)
        found.append(parameters)
    assert all(torch.equal(one, other) for others in found[1:] for one, other in zip(found[0], others, strict=True))


def test_all_parameters_with_gradients_are_counted_together() -> None:
    parameters = _parameters()[:-1]
    optimiser = Adam(parameters, lr=0.01)
    for number in range(3):
        for parameter in parameters:
            parameter.grad = torch.full_like(parameter, number + 1.0)
        optimiser.step()
    kept = optimiser.state_dict()["state"]
    assert [float(kept[number]["step"]) for number in range(len(parameters))] == [3.0] * len(parameters)
    # The state is a copy of the counts.
    optimiser.step()
    assert float(kept[0]["step"]) == 3.0


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf"), -3.4e38, 1e-45])
@pytest.mark.parametrize("place", [0, 16_383, 16_384, 39_999])
def test_the_one_value_that_is_not_finite_is_found(value: float, place: int) -> None:
    gradients = [torch.full((40_000,), 3.4e38), torch.zeros(3, 5), torch.empty(0)]
    assert are_finite(gradients)
    gradients[0][place] = value
    assert are_finite(gradients) == math.isfinite(value)
    assert are_finite([torch.zeros(3)])


def test_sizes_that_do_not_go_together_are_refused() -> None:
    three, two, count = [torch.zeros(3)], [torch.zeros(2)], [torch.zeros(())]
    for parts in ((three, two, three, three, count), (three, three, three, two, count), (three, three, three, three, [])):
        with pytest.raises(ValueError, match="Each parameter needs"):
            adam_step(*parts, rate=0.1, decays=(0.9, 0.999), epsilon=1e-8)


def test_it_goes_on_from_its_own_state_and_from_torch() -> None:
    whole, first = _parameters(), _parameters()
    of_whole, of_first = Adam(whole, lr=0.01), torch.optim.Adam(first, lr=0.01, fused=True)
    of_whole.has_kernels = False
    for number in range(6):
        _step(whole, of_whole, number)
    for number in range(3):
        _step(first, of_first, number)
    second = [nn.Parameter(parameter.detach().clone()) for parameter in first]
    of_second = Adam(second, lr=0.5)
    of_second.has_kernels = False
    of_second.load_state_dict(of_first.state_dict())
    assert of_second.param_groups[0]["lr"] == 0.01
    _step(second, of_second, 3)
    third = [nn.Parameter(parameter.detach().clone()) for parameter in second]
    of_third = Adam(third, lr=0.01)
    of_third.has_kernels = False
    of_third.load_state_dict(of_second.state_dict())
    for number in (4, 5):
        _step(third, of_third, number)
    assert all(torch.equal(left, right) for left, right in zip(whole, third, strict=True))


def test_a_training_does_not_load_the_compiler() -> None:
    code = (
        "import sys\n"
        "from dmp.methods import train\n"
        "from dmp.problem import denoising\n"
        "from dmp.settings import settings_for\n"
        "from dmp.shapes.spheres import icosphere\n"
        "settings = settings_for('denoise', 'compact', steps=2, threads=1)\n"
        "list(train(denoising(icosphere(4), settings), settings))\n"
        "sys.exit('torch._dynamo' in sys.modules)\n"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
