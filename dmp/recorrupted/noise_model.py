"""What can be said about the noise of one mesh from that mesh alone: its level and its direction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from scipy import sparse
from torch import Tensor

from dmp.geometry import vertex_normals
from dmp.mesh import FloatArray, IntArray
from dmp.topology import adjacency

# Median length of a two-dimensional standard normal vector, sqrt(2 ln 2).
_MEDIAN_RAYLEIGH = 1.1774100225154747
_MAD_TO_SIGMA = 1.4826
# Up to this level, in mean edge lengths, an estimate cannot be told from the irregularity of a clean mesh.
NO_NOISE = 0.01
# Squares are averaged over the neighbourhood so many times; this share of the neighbourhoods is called quiet.
_QUIET_STEPS, _QUIET_SHARE = 4, 0.05
# Even noise on the meshes tried made the quiet neighbourhoods 0.94 to 1.08 times as loud as the whole.
_EVEN = 0.8
# How the shape of a distribution is read off its quantiles, and how many draws show what chance does to them.
_MIDDLE, _TAIL, _TRIALS, _CLEARLY = 0.5, 0.9, 12, 2.0
_EVENNESSES = np.linspace(0.0, 1.0, 6)
_LEAST_VALUES = 100
# Trials of the estimate on a restored mesh, and what it can sensibly find of the noise that was put on.
_GAIN_TRIALS, _GAINS = 8, (0.85, 1.05)


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Independent noise at each vertex: ``level`` along the normal, ``level * tangential`` across it.

    Attributes:
        level: standard deviation along the normal, in the units of the positions that it was estimated from.
        tangential: standard deviation in each tangential direction over that along the normal, 0 to 1.
        normals: unit normals of a lightly smoothed mesh, (V, 3).
        evenness: part of its variance that is uniform between two bounds, 0 to 1; the rest is normally distributed.
    """

    level: float
    tangential: float
    normals: FloatArray
    evenness: float = 0.0

    def words(self) -> str:
        """Return the model as a person would put it, such as ``noise about 0.21 edge lengths, mostly along the normal``."""
        if self.level < NO_NOISE:
            return "no noise that could be told from the shape"
        direction = "mostly along the normal" if self.tangential < 0.5 else "in all directions"
        return f"noise about {self.level:.2f} edge lengths, {direction}"


def lightly_smoothed(positions: FloatArray, faces: IntArray, steps: int = 3) -> FloatArray:
    """Return the positions after ``steps`` averages over the neighbours, (V, 3); a vertex without any stays."""
    average = averaging(faces, len(positions))
    for _ in range(steps):
        positions = average @ positions
    return positions


def averaging(faces: IntArray, n_vertices: int) -> sparse.csr_array:
    """Return D^-1 A, (V, V), each row the mean over the neighbours; a vertex without any is its own mean."""
    neighbours = adjacency(faces, n_vertices)
    valence = neighbours.sum(axis=1)
    lonely = sparse.diags_array((valence == 0).astype(np.float64))
    return sparse.csr_array(sparse.diags_array(1.0 / np.maximum(valence, 1.0)) @ neighbours + lonely)


def estimate_noise(positions: FloatArray, faces: IntArray) -> NoiseModel:
    """Estimate level and direction of independent noise.

    The level is the spread of L^3 y along the normal, with L = I - D^-1 A, each row divided by its length, which makes
    it 1 for white noise of level 1; a smooth shape adds almost nothing to it, and sharp edges are trimmed off at three
    robust standard deviations. Where the quietest neighbourhoods are clearly quieter than that, it is shape and not noise, and
    their level is returned instead. The tangential share compares the median tangential and normal parts of L y. It is an
    upper bound: an irregular triangulation looks like tangential noise.

    Args:
        positions: (V, 3).
        faces: (F, 3).
    """
    n_vertices = len(positions)
    normals = _noisy_normals(positions, faces)
    laplacian = sparse.csr_array(sparse.eye_array(n_vertices) - averaging(faces, n_vertices))
    level = level_along(positions, faces, normals)

    umbrella = (laplacian @ positions) / _row_lengths(laplacian)[:, None]
    normal_part = _normal_part(umbrella, normals)
    across = np.linalg.norm(umbrella - normal_part[:, None] * normals, axis=1)
    spread = _MAD_TO_SIGMA * np.median(np.abs(normal_part))
    tangential = float(np.median(across)) / _MEDIAN_RAYLEIGH / spread if spread > 0 else 1.0
    return NoiseModel(level, min(1.0, tangential), normals)


def gain_of_estimate(positions: FloatArray, faces: IntArray, noise: NoiseModel) -> float:
    """Return which part of the level of such noise :func:`estimate_noise` would find on a mesh without noise.

    Less than 1, as the largest values are trimmed off, and where the noise is along the normals because those of a noisy mesh
    are not the true ones. Found by trying.

    Args:
        positions: restored positions, (V, 3), whose own contribution is taken off.
        faces: (F, 3).
        noise: what is put on; its normals are not used.
    """
    normals = vertex_normals(positions, faces)
    shape = level_along(positions, faces, normals)
    generator = torch.Generator().manual_seed(0)
    square = 0.0
    for _ in range(_GAIN_TRIALS):
        draws = standard_draws(len(positions), noise.evenness, generator).numpy().astype(np.float64)
        along = _normal_part(draws, normals)[:, None] * normals
        noisy = positions + noise.level * (along + noise.tangential * (draws - along))
        square += (level_along(noisy, faces, _noisy_normals(noisy, faces)) ** 2 - shape**2) / _GAIN_TRIALS
    return float(np.clip(math.sqrt(max(square, 0.0)) / noise.level, *_GAINS))


def _noisy_normals(positions: FloatArray, faces: IntArray) -> FloatArray:
    return vertex_normals(lightly_smoothed(positions, faces), faces)


def standard_draws(n_values: int, evenness: float, generator: torch.Generator) -> Tensor:
    """Return independent values of mean 0 and variance 1, (N, 3): normal ones, mixed with uniform ones by ``evenness``."""
    # Drawn on the processor, so that a run does not depend on the device.
    draws = torch.randn((n_values, 3), generator=generator)
    if evenness > 0:
        uniform = math.sqrt(3.0) * (2.0 * torch.rand((n_values, 3), generator=generator) - 1.0)
        draws = math.sqrt(1.0 - evenness) * draws + math.sqrt(evenness) * uniform
    return draws


def estimate_evenness(along: FloatArray, normals: FloatArray) -> float:
    """Return how much of the noise is uniform rather than normal, 0 to 1, see :class:`NoiseModel`.

    Judged by the median of its length against the quantile of nine tenths, which a few large errors of the restoration do not
    move, and compared with draws of known evenness on the same normals. What chance could do counts as 0.

    Args:
        along: estimated noise along the normals, (V,).
        normals: unit normals, (V, 3).
    """
    if len(along) < _LEAST_VALUES or not np.quantile(np.abs(along), _TAIL) > 0:
        return 0.0
    generator = torch.Generator().manual_seed(0)

    def drawn(evenness: float) -> float:
        return _peakedness(_normal_part(standard_draws(len(along), evenness, generator).numpy(), normals))

    normal = [drawn(0.0) for _ in range(_TRIALS)]
    seen = _peakedness(along)
    if seen <= np.mean(normal) + _CLEARLY * np.std(normal):
        return 0.0
    known = np.maximum.accumulate([np.mean(normal), *(np.mean([drawn(e) for _ in range(3)]) for e in _EVENNESSES[1:])])
    return float(np.interp(seen, known, _EVENNESSES))


def _peakedness(values: FloatArray) -> float:
    middle, tail = np.quantile(np.abs(values), [_MIDDLE, _TAIL])
    return float(middle / tail)


def level_along(positions: FloatArray, faces: IntArray, normals: FloatArray) -> float:
    """Return the level of what looks like noise along the normals: the spread of L^3 x, see :func:`estimate_noise`.

    Args:
        positions: (V, 3).
        faces: (F, 3).
        normals: unit normals of the vertices of a smoother mesh, (V, 3).
    """
    average = averaging(faces, len(positions))
    laplacian = sparse.csr_array(sparse.eye_array(len(positions)) - average)
    cubed = sparse.csr_array(laplacian @ laplacian @ laplacian)
    return _level(cubed, _normal_part(cubed @ positions, normals) / _row_lengths(cubed), average)


def _level(cubed: sparse.csr_array, along: FloatArray, average: sparse.csr_array) -> float:
    """Return the level of the noise in ``along``, the normalised values of ``cubed``, (V,)."""
    cap = 3 * _MAD_TO_SIGMA * float(np.median(np.abs(along)))
    kept = along[np.abs(along) < cap]
    level = float(np.sqrt(np.mean(kept**2))) if len(kept) else 0.0
    # Noise is everywhere, the detail of a clean shape is not: where it is quietest there must be noise as well. What the
    # quietest neighbourhoods of pure noise on this mesh look like is found by trying.
    pure = (cubed @ np.random.default_rng(0).standard_normal(len(along))) / _row_lengths(cubed)
    quiet, quiet_pure = np.minimum(along**2, cap**2), np.minimum(pure**2, 9.0)
    for _ in range(_QUIET_STEPS):
        quiet, quiet_pure = 0.5 * (quiet + average @ quiet), 0.5 * (quiet_pure + average @ quiet_pure)
    floor = float(np.sqrt(np.quantile(quiet, _QUIET_SHARE) / max(np.quantile(quiet_pure, _QUIET_SHARE), 1e-300)))
    return level if floor > _EVEN * level else floor


def _normal_part(vectors: FloatArray, normals: FloatArray) -> FloatArray:
    return np.einsum("vc,vc->v", vectors, normals)


def _row_lengths(matrix: sparse.csr_array) -> FloatArray:
    return np.maximum(np.sqrt(np.asarray(matrix.multiply(matrix).sum(axis=1)).ravel()), 1e-12)
