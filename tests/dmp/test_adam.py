from __future__ import annotations

import subprocess
import sys

import pytest
import torch
from torch import nn

from dmp.adam import Adam


def _parameters() -> list[nn.Parameter]:
    generator = torch.Generator().manual_seed(0)
    return [nn.Parameter(torch.randn(shape, generator=generator)) for shape in ((3, 4), (5,), (2,))]


def _step(parameters: list[nn.Parameter], optimiser: Adam | torch.optim.Adam, number: int) -> None:
    optimiser.zero_grad()
    for parameter in parameters[:2]:
        parameter.grad = torch.sin(number + 3 * parameter.detach())
    optimiser.step()


def test_every_digit_is_that_of_torch() -> None:
    ours, theirs = _parameters(), _parameters()
    mine, other = Adam(ours, lr=0.01), torch.optim.Adam(theirs, lr=0.01, fused=True)
    for number in range(20):
        for optimiser in (mine, other):
            optimiser.param_groups[0]["lr"] = 0.01 / (1 + number)
        _step(ours, mine, number)
        _step(theirs, other, number)
    assert all(torch.equal(left, right) for left, right in zip(ours, theirs, strict=True))
    # The third has never had a gradient.
    assert torch.equal(ours[2], _parameters()[2])


def test_it_goes_on_from_its_own_state_and_from_torch() -> None:
    whole, first = _parameters(), _parameters()
    of_whole, of_first = Adam(whole, lr=0.01), torch.optim.Adam(first, lr=0.01, fused=True)
    for number in range(6):
        _step(whole, of_whole, number)
    for number in range(3):
        _step(first, of_first, number)
    second = [nn.Parameter(parameter.detach().clone()) for parameter in first]
    of_second = Adam(second, lr=0.5)
    of_second.load_state_dict(of_first.state_dict())
    assert of_second.param_groups[0]["lr"] == 0.01
    _step(second, of_second, 3)
    third = [nn.Parameter(parameter.detach().clone()) for parameter in second]
    of_third = Adam(third, lr=0.01)
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


def test_steps_are_counted_whoever_does_them() -> None:
    parameters = _parameters()
    optimiser = Adam(parameters, lr=0.01)
    for number in range(3):
        _step(parameters, optimiser, number)
    counts = [kept["step"] for kept in optimiser.state_dict()["state"].values()]
    assert counts == [3.0, 3.0]
    # Somebody else's step counts for all.
    moments = optimiser.moments_of(parameters[::-1])
    optimiser.count(1)
    assert [float(kept["step"]) for kept in moments] == [1.0, 4.0, 4.0]
    # What was returned before is a copy.
    assert counts == [3.0, 3.0]
    state = optimiser.state_dict()
    del state["state"][0]
    optimiser.load_state_dict(state)
    assert [float(kept["step"]) for kept in optimiser.moments_of(parameters)] == [0.0, 4.0, 1.0]
    with pytest.raises(KeyError):
        optimiser.moments_of([nn.Parameter(torch.zeros(2))])
