from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy import sparse
from scipy.spatial.transform import Rotation

from dmp.geometry import face_normals
from dmp.recorrupted import detail
from dmp.recorrupted.detail import given_back
from dmp.recorrupted.network import Operators
from tests.meshes import grid_mesh

_SHEET = grid_mesh(60)
_OPERATORS = Operators.of(_SHEET.faces, _SHEET.n_vertices, face_normals(_SHEET.vertices, _SHEET.faces), torch.device("cpu"))


def _diffusion() -> sparse.csr_array:
    matrix = _OPERATORS.half_lazy
    return sparse.csr_array((matrix.values().numpy(), matrix.col_indices().numpy(), matrix.crow_indices().numpy()))


def _band(values: np.ndarray) -> np.ndarray:
    """What two diffusions leave and six more take away, which is all that these tests put on the sheet."""
    diffusion = _diffusion()
    for _ in range(2):
        values = diffusion @ values
    coarser = values
    for _ in range(6):
        coarser = diffusion @ coarser
    return values - coarser


def _heights(seed: int, deviation: float) -> np.ndarray:
    heights = _band(np.random.default_rng(seed).standard_normal(_SHEET.n_vertices))
    return np.asarray(deviation * heights / heights.std())


def _positions(heights: np.ndarray) -> np.ndarray:
    return np.asarray(_SHEET.vertices + np.column_stack([0 * heights, 0 * heights, heights]))


def _given_back(before: np.ndarray, after: np.ndarray, *, across: bool = False) -> np.ndarray:
    before_, after_ = (torch.tensor(values, dtype=torch.float32) for values in (before, after))
    return np.asarray(given_back(before_, after_, _OPERATORS, 1.0, across=across).double().numpy())


def test_what_a_wiener_filter_for_twice_the_noise_takes_too_much_of_comes_back() -> None:
    detail_variance, noise_variance = 0.02**2, 0.01**2
    truth, noise = _heights(1, 0.02), _heights(2, 0.01)
    noisy = truth + noise
    filtered = detail_variance / (detail_variance + 2 * noise_variance) * noisy
    best = detail_variance / (detail_variance + noise_variance) * noisy
    result = _given_back(_positions(noisy), _positions(filtered))[:, 2]

    def error(heights: np.ndarray) -> float:
        return float(np.sqrt(np.mean((heights - truth) ** 2)))

    # Only what its bands let through a second time is given back, so not all of the way.
    assert error(result) < 0.5 * error(filtered) + 0.5 * error(best)


def test_noise_alone_stays_away() -> None:
    noisy = _positions(_heights(3, 0.02))
    assert np.abs(_given_back(noisy, _SHEET.vertices, across=True) - _SHEET.vertices).max() < 1e-6


def test_noise_stays_away_from_large_curvature() -> None:
    waves = _positions(0.3 * np.sin(_SHEET.vertices[:, 0] / 8.0))
    noisy = waves + np.column_stack([np.zeros((_SHEET.n_vertices, 2)), _heights(4, 0.05)])
    assert np.abs(_given_back(noisy, waves) - waves).max() < 1e-6


def test_movements_across_the_normals_come_back_when_asked_for_alone() -> None:
    shift = _heights(5, 0.02)
    along_x = np.column_stack([shift, 0 * shift, 0 * shift])
    before, after = _SHEET.vertices + along_x, _SHEET.vertices + 0.6 * along_x
    assert np.abs(_given_back(before, after) - after).max() < 1e-5
    moved = (_given_back(before, after, across=True) - after)[:, 0]
    assert moved @ along_x[:, 0] > 0.1 * 0.4 * (along_x[:, 0] @ along_x[:, 0])


def test_it_turns_with_the_mesh() -> None:
    noisy = _positions(_heights(1, 0.02) + _heights(2, 0.01))
    filtered = _positions(0.6 * (noisy[:, 2]))
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    plain = _given_back(noisy, filtered, across=True)
    turned = _given_back(noisy @ turn.T, filtered @ turn.T, across=True)
    assert np.abs(turned - plain @ turn.T).max() < 1e-4
    assert np.abs(plain - filtered).max() > 1e-3


@pytest.mark.parametrize("likeness", [0.4, 0.7, 1.5])
@pytest.mark.parametrize("recorruption", [0.7, 1.0])
def test_kept_part_is_that_of_the_wiener_filters(likeness: float, recorruption: float) -> None:
    kappa = detail._GAIN * (likeness - detail._CLEARLY)
    added = 1 + recorruption**2
    # Of detail of this variance under noise of variance 1 the filter for the added noise has this kappa.
    variance = kappa * added
    wanted = (1 - variance / (variance + 1)) / (1 - variance / (variance + added))
    assert detail._kept(torch.tensor(likeness), recorruption).item() == pytest.approx(wanted, rel=1e-5)
