"""The kernels of a layer, each against numpy, scipy and torch's automatic derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
import torch
from scipy import sparse
from torch import Tensor
from torch.nn import functional

from dmp.compiled import launching, stack_passes
from dmp.compiled.blocked_matrix import BlockedMatrix
from dmp.compiled.fused_passes import FusedPasses
from dmp.compiled.layer_steps import Backward, Derivative, Forward, Normalised
from dmp.compiled.packed_weights import can_pack
from dmp.compiled.stack_passes import StackPasses
from dmp.compiled.stack_rows import ROWS
from dmp.operators import to_torch

# A vertex count that is no multiple of a block, and channels that are none of a vector.
_VERTICES, _CHANNELS = 5 * ROWS + 13, (1, 3, 16, 17, 40, 64)


@pytest.fixture(autouse=True)
def _share_small_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Divide even what is too small to be worth it."""
    monkeypatch.setattr(stack_passes, "_WORTH_SHARING", 0)


@pytest.fixture(params=[1, 2, 3])
def threads(request: pytest.FixtureRequest) -> Iterator[int]:
    """So many threads for torch and for the kernels."""
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


def _values(*shape: int, seed: int = 0, offset: float = 0.0) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed)) + offset


def _matrix(reach: int = 0, seed: int = 0) -> sparse.csr_array:
    """A symmetric matrix whose rows have 1 to about 20 entries, within ``reach`` of the diagonal or (0) anywhere."""
    generator = np.random.default_rng(seed)
    rows = generator.integers(0, _VERTICES, 4 * _VERTICES)
    columns = (
        generator.integers(0, _VERTICES, len(rows)) if reach == 0 else rows + generator.integers(-reach, reach + 1, len(rows))
    )
    columns = np.clip(columns, 0, _VERTICES - 1)
    entries = generator.standard_normal(len(rows))
    half = sparse.csr_array((entries, (rows, columns)), shape=(_VERTICES, _VERTICES))
    return sparse.csr_array(half + half.T + sparse.eye_array(_VERTICES))


def _close(found: Tensor, expected: Tensor, tolerance: float = 1e-5) -> None:
    assert float((found.double() - expected.double()).abs().max()) <= tolerance * float(expected.abs().max())


def _padded(*shape: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """A place with room for whole blocks behind its last row, as the fused kernels need it; all must be overwritten."""
    return torch.full((-(-shape[0] // ROWS) * ROWS, *shape[1:]), torch.nan, dtype=dtype)[: shape[0]]


@pytest.mark.parametrize("channels", _CHANNELS)
@pytest.mark.parametrize("reach", [0, 40])
def test_a_sparse_product_equals_that_of_scipy(channels: int, reach: int, threads: int) -> None:
    matrix, features = _matrix(reach), _values(_VERTICES, channels)
    out = torch.empty_like(features)
    StackPasses(_VERTICES, channels).gather(BlockedMatrix(to_torch(matrix)), features, out)
    _close(out, torch.from_numpy(matrix @ features.double().numpy()))


def test_rows_without_entries_become_zero() -> None:
    entries = np.zeros(_VERTICES)
    entries[7] = 2.0
    features, out = _values(_VERTICES, 20), torch.full((_VERTICES, 20), torch.nan)
    matrix = BlockedMatrix(to_torch(sparse.csr_array(sparse.diags_array(entries))))
    StackPasses(_VERTICES, 20).gather(matrix, features, out)
    assert torch.equal(out[7], 2 * features[7])
    assert not out[torch.arange(_VERTICES) != 7].any()


@pytest.mark.parametrize("channels", _CHANNELS)
@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_moments_equal_those_in_double_precision_also_far_from_zero(channels: int, offset: float, threads: int) -> None:
    mixed = _values(_VERTICES, channels, offset=offset)
    mean, over_deviation = StackPasses(_VERTICES, channels).moments(mixed)
    expected = mixed.double()
    _close(mean, expected.mean(dim=0), 1e-6)
    # A mean of 1000 in float32 is itself only good to 6e-5.
    _close(over_deviation, (expected.var(dim=0, correction=0) + 1e-5).rsqrt(), 1e-4 if offset else 1e-5)


def _weights(channels: int) -> tuple[Tensor, Tensor]:
    return _values(channels, seed=1), _values(channels, seed=2)


@pytest.mark.parametrize("channels", _CHANNELS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.bfloat16])
def test_normalisation_and_its_derivative_equal_those_of_torch(channels: int, dtype: torch.dtype, threads: int) -> None:
    passes = StackPasses(_VERTICES, channels)
    mixed = _values(_VERTICES, channels).to(dtype)
    gamma, beta = _weights(channels)
    upstream = _values(_VERTICES, channels, seed=3).to(dtype)
    expected = [tensor.double().clone().requires_grad_() for tensor in (mixed, gamma, beta)]
    normalised = functional.batch_norm(expected[0], None, None, expected[1], expected[2], training=True, eps=1e-5)
    output = functional.leaky_relu(normalised, 0.01)
    output.backward(upstream.double())

    by = Normalised.by(*passes.moments(mixed), gamma, beta)
    found, gradient = torch.empty_like(mixed), upstream.clone()
    passes.activate(mixed, by, found)
    derivative = passes.sums(gradient, mixed, by)
    passes.derive(gradient, mixed, by, derivative)
    tolerance = 1e-5 if dtype == torch.float32 else 1e-2
    _close(found, output.detach(), tolerance)
    gradients = [tensor.grad for tensor in expected]
    assert all(one is not None for one in gradients)
    for got, wanted in zip((gradient, derivative.of_gamma, derivative.of_beta), gradients, strict=True):
        _close(got, wanted, tolerance)


def test_bfloat16_is_rounded_as_torch_rounds() -> None:
    half = torch.tensor([1.00390625, 1.01171875, -1.00390625, 3.3895e38, torch.inf, -torch.inf, torch.nan, 0.0, 1e-40])
    mixed = torch.cat([half, _values(1000)]).bfloat16().float()
    # Ties, what is rounded up to infinity, and numbers that are none come through a normalisation that changes nothing.
    mixed[: len(half)] = half
    one, zero = torch.ones(1), torch.zeros(1)
    found = torch.empty((len(mixed), 1), dtype=torch.bfloat16)
    # The kernel reads bfloat16; a factor that no bfloat16 has makes numbers that must be rounded.
    factor = torch.tensor([1.0 + 2**-9 + 2**-12])
    by = Normalised(zero, one, factor, zero)
    given = mixed.abs().bfloat16()[:, None].contiguous()
    StackPasses(len(mixed), 1).activate(given, by, found)
    expected = (given.float() * factor).bfloat16()
    assert torch.equal(found.isnan(), expected.isnan())
    assert torch.equal(found[~found.isnan()], expected[~expected.isnan()])


class _Layers:
    """One layer after another with everything that both ways of going through it need."""

    def __init__(self, n_in: int, n_out: int, reach: int) -> None:
        self.sizes = n_in, n_out
        self.matrix = BlockedMatrix(to_torch(_matrix(reach)))
        self.weight = _values(n_in, n_out, seed=4)
        self.before = _padded(_VERTICES, n_in)
        self.before.copy_(_values(_VERTICES, n_in, seed=5))
        self.upstream = _values(_VERTICES, n_out, seed=6)

    def run(self, passes: StackPasses) -> list[Tensor]:
        n_in, n_out = self.sizes
        multiplies = n_out <= n_in
        before = self.before, Normalised.by(*passes.moments(self.before), *_weights(n_in))
        between, mixed = _padded(_VERTICES, n_out if multiplies else n_in), _padded(_VERTICES, n_out)
        activated = _padded(_VERTICES, n_in)
        activated.untyped_storage().fill_(0)
        forward = Forward(self.matrix, before, self.weight, activated, between, mixed)
        moments = passes.forward_multiplying(forward) if multiplies else passes.forward_gathering(forward)
        layer = mixed, Normalised.by(*moments, *_weights(n_out))

        gradient, of_before = _padded(_VERTICES, n_out), _padded(_VERTICES, n_in)
        gradient.copy_(self.upstream)
        derivative = passes.sums(gradient, *layer)
        between = _padded(_VERTICES, n_out if multiplies else n_in)
        backward = Backward(self.matrix, gradient, layer, derivative, self.weight, between, of_before, before)
        found: Derivative = passes.backward_multiplying(backward) if multiplies else passes.backward_gathering(backward)
        parts = (found.of_gamma, found.of_beta, found.slope, found.constant)
        return [mixed.clone(), *moments, between.clone(), of_before.clone(), *parts]


@pytest.mark.skipif(not can_pack(), reason="torch brings no MKL along on this processor")
@pytest.mark.parametrize(("n_in", "n_out"), [(16, 16), (32, 16), (16, 48), (17, 5), (5, 17), (64, 128)])
@pytest.mark.parametrize("reach", [0, 40])
def test_a_layer_in_one_sweep_equals_the_same_in_many_passes(n_in: int, n_out: int, reach: int, threads: int) -> None:
    layers = _Layers(n_in, n_out, reach)
    widest = max(n_in, n_out)
    found = layers.run(FusedPasses(_VERTICES, widest))
    for one, other in zip(found, layers.run(StackPasses(_VERTICES, widest)), strict=True):
        _close(one, other, 2e-5)


@pytest.mark.skipif(not can_pack(), reason="torch brings no MKL along on this processor")
@pytest.mark.parametrize(("n_in", "n_out"), [(48, 16), (16, 48)])
def test_no_digit_depends_on_the_number_of_threads(n_in: int, n_out: int) -> None:
    layers, before, results = _Layers(n_in, n_out, 40), torch.get_num_threads(), []
    for threads in (1, 2, 5):
        torch.set_num_threads(threads)
        results.append(layers.run(FusedPasses(_VERTICES, 48)))
    torch.set_num_threads(before)
    for other in results[1:]:
        assert all(torch.equal(one, two) for one, two in zip(results[0], other, strict=True))


def test_without_threads_to_share_the_results_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    layers = _Layers(32, 16, 40)
    shared = layers.run(StackPasses(_VERTICES, 32))
    calls: list[Callable[..., None]] = []
    monkeypatch.setattr(launching, "_in_parallel", None)
    call = launching._CALL
    monkeypatch.setattr(launching, "_CALL", lambda address: calls.append(call(address)) or calls[-1])
    alone = layers.run(StackPasses(_VERTICES, 32))
    torch.set_num_threads(before)
    assert calls
    assert all(torch.equal(one, two) for one, two in zip(shared, alone, strict=True))
