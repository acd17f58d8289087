"""Monte Carlo against closed forms: why the loss may look at noisy positions only."""

from __future__ import annotations

import numpy as np
import torch

from dmp.geometry import face_area_vectors
from dmp.mesh import TriangleMesh
from dmp.recorrupted.losses import normal_errors, position_errors

_DRAWS = 4000


def _recorrupted(clean: np.ndarray, level: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs y + z and targets y - z for fresh noise in y and z alike, (draws, V, 3) both."""
    generator = np.random.default_rng(seed)
    noise, more = level * generator.standard_normal((2, _DRAWS, *clean.shape))
    return clean + noise + more, clean + noise - more


def test_position_term_is_the_true_error_plus_a_constant(tetrahedron: TriangleMesh) -> None:
    level, clean = 0.3, tetrahedron.vertices
    inputs, targets = _recorrupted(clean, level, seed=1)
    outputs = 0.6 * inputs + 0.1 * inputs**2  # any function of the inputs
    losses = [
        float(position_errors(torch.from_numpy(q), torch.from_numpy(t)).mean()) for q, t in zip(outputs, targets, strict=True)
    ]
    true_error = float(((outputs - clean) ** 2).sum(axis=2).mean())
    # The target's own error, y - z - x, has the variance of two noises in each of three coordinates.
    constant = 3 * 2 * level**2
    assert abs(np.mean(losses) - true_error - constant) < 4 * np.std(losses) / np.sqrt(_DRAWS)


def test_target_noise_that_is_not_independent_would_be_seen(tetrahedron: TriangleMesh) -> None:
    """The same with the noisy input itself as target: the term is then far below the true error plus its constant."""
    level, clean = 0.3, tetrahedron.vertices
    noisy = clean + level * np.random.default_rng(2).standard_normal((_DRAWS, *clean.shape))
    outputs = 0.6 * noisy + 0.1 * noisy**2
    losses = [
        float(position_errors(torch.from_numpy(q), torch.from_numpy(t)).mean()) for q, t in zip(outputs, noisy, strict=True)
    ]
    true_error = float(((outputs - clean) ** 2).sum(axis=2).mean())
    assert np.mean(losses) < true_error + 3 * level**2 - 20 * np.std(losses) / np.sqrt(_DRAWS)


def test_expected_area_vector_is_the_true_one(tetrahedron: TriangleMesh) -> None:
    _, targets = _recorrupted(tetrahedron.vertices, 0.3, seed=3)
    areas = np.array([face_area_vectors(target, tetrahedron.faces) for target in targets])
    error = areas.mean(axis=0) - face_area_vectors(tetrahedron.vertices, tetrahedron.faces)
    assert (np.abs(error) < 5 * areas.std(axis=0) / np.sqrt(_DRAWS)).all()


def test_normal_term_is_the_cosine_to_the_true_normals(tetrahedron: TriangleMesh) -> None:
    clean, faces = tetrahedron.vertices, tetrahedron.faces
    inputs, targets = _recorrupted(clean, 0.3, seed=4)
    true_areas = face_area_vectors(clean, faces)
    scale = torch.from_numpy(np.linalg.norm(true_areas, axis=1, keepdims=True))
    outputs = [torch.from_numpy(face_area_vectors(0.5 * q + 0.02 * q**3, faces)) for q in inputs]
    losses, cosines = [], []
    for output, target in zip(outputs, targets, strict=True):
        losses.append(float(normal_errors(output, torch.from_numpy(face_area_vectors(target, faces)), scale).mean()))
        directions = output / output.norm(dim=1, keepdim=True)
        cosines.append(float((directions * torch.from_numpy(true_areas) / scale).sum(dim=1).mean()))
    difference = np.array(losses) + np.array(cosines)
    assert abs(difference.mean()) < 4 * difference.std() / np.sqrt(_DRAWS)
    assert np.mean(cosines) < 0.99  # and this is not the trivial case of perfect normals


def test_uniform_noise_needs_uniform_draws(tetrahedron: TriangleMesh) -> None:
    """The bias of the position term for an output that is no linear function of the input, with either kind of draws."""
    level, clean = 0.3, tetrahedron.vertices
    generator = np.random.default_rng(5)
    shape = (20 * _DRAWS, *clean.shape)
    noise = level * np.sqrt(3) * generator.uniform(-1, 1, shape)

    def bias(draws: np.ndarray) -> tuple[float, float]:
        output = clean + 3.0 * (noise + draws) ** 3  # keeps a part of the noise that depends on how large it is
        term = ((output - (clean + noise - draws)) ** 2).sum(axis=2) - ((output - clean) ** 2).sum(axis=2)
        term = term - ((noise - draws) ** 2).sum(axis=2)  # what no output can change
        return float(term.mean()), float(term.std() / np.sqrt(term.size))

    alike, error = bias(level * np.sqrt(3) * generator.uniform(-1, 1, shape))
    assert abs(alike) < 4 * error
    other, error = bias(level * generator.standard_normal(shape))
    assert abs(other) > 20 * error
