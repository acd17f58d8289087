"""The kernels of a layer, each against numpy, scipy and torch's automatic derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
import pytest
import torch
from scipy import sparse
from torch import Tensor, nn
from torch.nn import functional

from dmp.compiled import launching, stack_passes
from dmp.compiled.blocked_matrix import LEAST_ROWS, BlockedMatrix, equal_blocks
from dmp.compiled.layer_steps import Normalised
from dmp.compiled.packed_weights import packing_for
from dmp.compiled.stack_passes import StackPasses
from dmp.compiled.stack_rows import ROWS
from dmp.layers import GraphConvolution, stack_buffers
from dmp.layers.gcn_stack import gcn_stack
from dmp.layers.stack_buffers import StackBuffers
from dmp.operators import to_torch

# A vertex count that is no multiple of a block, and channels that are none of a vector.
_VERTICES, _CHANNELS = 5 * ROWS + 13, (1, 3, 16, 17, 40, 64)


@pytest.fixture(autouse=True)
def _share_small_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Divide even what is too small to be worth it."""
    monkeypatch.setattr(stack_passes, "WORTH_SHARING", 0)


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
    """A series of layers with everything that both ways of going through it need."""

    def __init__(self, sizes: tuple[int, ...], reach: int) -> None:
        torch.manual_seed(4)
        self.widths, self._features = sizes[1:], _values(_VERTICES, sizes[0], seed=5)
        self._matrix = to_torch(_matrix(reach))
        self._convolutions = [GraphConvolution(i, o) for i, o in pairwise(sizes)]
        self._normalisations = [nn.BatchNorm1d(o) for o in self.widths]
        with torch.no_grad():
            for normalisation in self._normalisations:
                normalisation.weight.copy_(_values(normalisation.num_features, seed=1))
                normalisation.bias.copy_(_values(normalisation.num_features, seed=2))
        self._upstream = _values(_VERTICES, sizes[-1], seed=6)

    def buffers(self) -> StackBuffers:
        """Return buffers in which whatever is not overwritten shows."""
        made = StackBuffers(_VERTICES, self._features.shape[1], self.widths)
        for tensor in (*made.mixed, *made.gathered, *made._scratch):
            if tensor is not None:
                tensor.untyped_storage().fill_(0xFF)
        return made

    def run(self, buffers: StackBuffers, moments: list[tuple[Tensor, Tensor]] | None = None) -> dict[str, Tensor]:
        """Return the output, and the gradients of the features and of the parameters, by name."""
        features = self._features.clone().requires_grad_()
        parameters = dict(nn.ModuleList([*self._convolutions, *self._normalisations]).named_parameters())
        output = gcn_stack(features, self._matrix, self._convolutions, self._normalisations, buffers, moments=moments)
        gradients = torch.autograd.grad(output, [features, *parameters.values()], self._upstream)
        return {"output": output.detach(), **dict(zip(("features", *parameters), gradients, strict=True))}


_SIZES = ((16, 16, 16), (32, 16), (16, 48), (17, 5, 33), (5, 17, 64, 128, 96, 40))


@pytest.mark.parametrize("sizes", _SIZES)
@pytest.mark.parametrize("reach", [0, 40])
@pytest.mark.parametrize("own_moments", [True, False])
def test_all_layers_in_one_launch_equal_the_same_in_many_passes(
    sizes: tuple[int, ...], reach: int, own_moments: bool, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    layers = _Layers(sizes, reach)
    given = [(_values(c, seed=7), _values(c, seed=8).abs() + 0.5) for c in layers.widths]
    moments = None if own_moments else given
    in_one = layers.buffers()
    if in_one.fused is None:
        pytest.skip("torch brings no MKL along on this processor")
    monkeypatch.setattr(stack_buffers, "packing_for", lambda _: None)
    in_many = layers.buffers()
    assert in_many.fused is None
    expected = layers.run(in_many, moments)
    # The second time with tables that are there already.
    for _ in range(2):
        for name, found in layers.run(in_one, moments).items():
            if expected[name].any():
                _close(found, expected[name], 5e-5)
            else:
                assert not found.any(), name


@pytest.mark.skipif(packing_for(torch.float32) is None, reason="torch brings no MKL along on this processor")
@pytest.mark.parametrize("sizes", _SIZES)
def test_threads_change_the_order_of_the_sums_for_the_weights_alone_and_repetition_no_digit(sizes: tuple[int, ...]) -> None:
    layers, before = _Layers(sizes, 40), torch.get_num_threads()
    results = []
    for threads in (1, 2, 2, 5):
        torch.set_num_threads(threads)
        results.append(layers.run(layers.buffers()))
    torch.set_num_threads(before)
    assert all(torch.equal(results[1][name], again) for name, again in results[2].items())
    for other in results[1:]:
        for name, tensor in other.items():
            if tensor.dim() == 2 and name not in ("output", "features"):
                _close(tensor, results[0][name], 1e-5)
            else:
                assert torch.equal(tensor, results[0][name]), name


def test_the_same_buffers_follow_whatever_changes_between_two_passes() -> None:
    layers, before = _Layers((5, 17, 64, 40), 40), torch.get_num_threads()
    other = _Layers((5, 17, 64, 40), 20)
    given = [(_values(c, seed=7), _values(c, seed=8).abs() + 0.5) for c in layers.widths]
    buffers = layers.buffers()

    def more_threads() -> None:
        torch.set_num_threads(2)

    def another_matrix() -> None:
        layers._matrix = other._matrix

    def other_weights() -> None:
        for convolution in layers._convolutions:
            convolution.weight.data = 1.5 * convolution.weight.data

    torch.set_num_threads(1)
    for moments, change in (
        (None, more_threads),
        (None, another_matrix),
        (None, other_weights),
        (given, more_threads),
        (None, None),
    ):
        expected = layers.run(layers.buffers(), moments)
        found = layers.run(buffers, moments)
        assert all(torch.equal(found[name], tensor) for name, tensor in expected.items()), change
        if change is not None:
            change()
    torch.set_num_threads(before)


def test_what_a_kernel_would_misread_is_refused() -> None:
    layers = _Layers((16, 16), 40)
    buffers = layers.buffers()
    if buffers.fused is None:
        pytest.skip("torch brings no MKL along on this processor")
    layers._features = layers._features[:50]
    with pytest.raises(ValueError, match=f"made for {_VERTICES} vertices with 16 features"):
        layers.run(buffers)
    layers = _Layers((16, 16), 40)
    layers._convolutions[0].weight.data = layers._convolutions[0].weight.data.T
    with pytest.raises(ValueError, match="float32 and contiguous"):
        layers.run(buffers)
    layers = _Layers((16, 16), 40)
    layers._matrix = to_torch(sparse.eye_array(_VERTICES + 1, format="csr"))
    with pytest.raises(ValueError, match=f"the matrix has {_VERTICES + 1} rows"):
        layers.run(buffers)


@pytest.mark.parametrize("reach", [0, 20, 150])
@pytest.mark.parametrize("parts", [1, 2, 3])
def test_a_place_is_given_away_only_when_nobody_wants_its_rows_any_more(reach: int, parts: int) -> None:
    values = _matrix(reach)
    matrix = BlockedMatrix(to_torch(values))
    sweep = matrix.sweep(parts)
    places = np.full(sweep.n_slots * ROWS, -1)

    def rows_of(block: int) -> range:
        return range(block * ROWS, min(_VERTICES, block * ROWS + ROWS))

    def look_for_neighbours(block: int) -> None:
        for row in rows_of(block):
            entries = slice(values.indptr[row], values.indptr[row + 1])
            assert np.array_equal(places[sweep.columns[entries]], values.indices[entries])

    finished = []
    for part in range(sweep.n_parts):
        queue = list(sweep.queue[sweep.queue_starts[part] : sweep.queue_starts[part + 1]])
        for first in range(sweep.bounds[part], sweep.bounds[part + 1], ROWS):
            rows = rows_of(first // ROWS)
            places[sweep.slots[first // ROWS] * ROWS :][: len(rows)] = rows
            while queue and sweep.highest[queue[0]] < first + ROWS:
                look_for_neighbours(queue[0])
                finished.append(queue.pop(0))
        assert not queue
    for block in sweep.others:
        look_for_neighbours(block)
        finished.append(block)
    assert sorted(finished) == list(matrix.all_blocks)
    assert sweep.n_slots <= matrix.n_blocks
    if reach == 20:
        assert sweep.n_slots <= 3 * parts


def test_without_threads_to_share_the_results_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    layers = _Layers((32, 16, 48), 40)
    shared = layers.run(layers.buffers())
    calls: list[Callable[..., None]] = []
    monkeypatch.setattr(launching, "_in_parallel", None)
    call = launching._CALL
    monkeypatch.setattr(launching, "_CALL", lambda address: calls.append(call(address)) or calls[-1])
    alone = layers.run(layers.buffers())
    torch.set_num_threads(before)
    assert calls
    assert all(torch.equal(shared[name], tensor) for name, tensor in alone.items())


def test_blocks_are_nearly_full_and_as_many_for_each_of_two_or_four_threads() -> None:
    for n_vertices in [*range(1, 3000), *range(3000, 100_000, 37)]:
        rows = equal_blocks(n_vertices)
        assert LEAST_ROWS <= rows <= ROWS
        blocks = -(-n_vertices // rows)
        # What the memory of the layers has room for.
        assert blocks * rows < n_vertices + ROWS and blocks <= n_vertices // LEAST_ROWS + 1
    shares = [-(-n // equal_blocks(n)) for n in (5_002, 7_500, 10_443, 15_002)]
    assert shares == [40, 60, 84, 120]
