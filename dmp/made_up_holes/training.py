"""Learn to complete a mesh from holes made up in its known part.

Holes of about the real ones' depth are made up where the positions are known. Both kinds are filled by the same rule, the
thin plate, and a network learns from the made-up ones how far the true surface lies from that plate, along the normal.
Applied to the real holes, it carries the mesh's own structure into them. The idea of made-up holes is SeMIGCN's (Hattori
et al. 2024); features and target are chosen so that nothing depends on how the mesh lies in space.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy import sparse
from torch import Tensor, nn

from dmp.adam import Adam
from dmp.errors import MeshError, SettingsError
from dmp.made_up_holes.features import shape_features
from dmp.made_up_holes.making import HoleMaker
from dmp.made_up_holes.network import InpaintingNetwork
from dmp.made_up_holes.thin_plate import ThinPlate
from dmp.mesh import BoolArray, FloatArray
from dmp.operators import normalised_adjacency, to_torch
from dmp.problem import Problem
from dmp.settings import Settings
from dmp.topology import adjacency
from dmp.training import Training

# Sets of made-up holes that are trained on in turn; a new one is made at each step until there are so many.
_POOL = 150
# Sets that are never trained on; their error is shown and decides how far the network is trusted.
_RESERVED = 4
_LARGEST_GRADIENT = 1.0
_LAST_RATE = 0.03


class _Lesson(NamedTuple):
    features: Tensor
    offsets: Tensor
    holes: Tensor


class MadeUpHoles(Training):
    """Trains an inpainting network on made-up holes; the prediction leaves known vertices where they are.

    Losses by name: ``total_loss``, the mean squared error of the offsets in the holes of the step, in squared mean edge
    lengths; ``made_up_error``, the mean error in reserved holes, in mean edge lengths, comparable with the distance of the
    completed vertices from a true surface.

    Raises:
        SettingsError: when known vertices are to be predicted too.
        MeshError: when the known part is too small to make up holes in.
    """

    def __init__(self, problem: Problem, settings: Settings, *, run_id: str | None = None) -> None:
        if settings.known_vertices != "keep":
            raise SettingsError(
                "Completion by made-up holes leaves known vertices where they are. Use --preset compact to denoise as well."
            )
        super().__init__(problem, settings, np.zeros(0, dtype=np.int64), run_id)
        faces, n_vertices = problem.mesh.faces, problem.mesh.n_vertices
        self._adjacency = adjacency(faces, n_vertices)
        valence = np.maximum(self._adjacency.sum(axis=1), 1.0)
        averaging = sparse.diags_array(1.0 / valence) @ self._adjacency
        self._smoothing = sparse.csr_array(0.5 * (sparse.eye_array(n_vertices) + averaging))
        self._plate = ThinPlate(self._adjacency, faces)
        self._maker = HoleMaker(self._adjacency, problem.known)
        self._filled = ~problem.known
        self._true = problem.to_training_units(problem.target)
        self._propagation = to_torch(normalised_adjacency(faces, n_vertices), self.device)

        self._start = self._plate.fill(self._true, self._filled)
        features, normals = self._features(self._start, self._filled)
        self._real_features = self._tensor(features)
        self._start_tensor, self._normals = self._tensor(self._start), self._tensor(normals)
        self._holes = torch.from_numpy(np.flatnonzero(self._filled)).to(self.device)
        # Negative numbers are kept for the reserved sets, so that training never meets them.
        self._reserved = [self._lesson(-1 - index) for index in range(_RESERVED)]
        self._pool: dict[int, _Lesson] = {}

        stacked = torch.cat([lesson.features for lesson in self._reserved])
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            network = InpaintingNetwork(stacked.mean(dim=0), stacked.std(dim=0) + 1e-6)
        self._network = network.to(self.device)
        self._optimiser = Adam(self._network.parameters(), lr=settings.learning_rate)

    @property
    def n_parameters(self) -> int:
        """Number of trained values in the network."""
        return sum(parameter.numel() for parameter in self._network.parameters())

    def _losses_before(self) -> Mapping[str, Tensor]:
        with torch.no_grad():
            return {"total_loss": self._loss(self._lesson_of_step(1))}

    def _compute_gradients(self) -> Mapping[str, Tensor]:
        loss = self._loss(self._lesson_of_step(self.step + 1))
        self._optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self._network.parameters(), _LARGEST_GRADIENT)
        return {"total_loss": loss.detach()}

    def _apply_gradients(self) -> None:
        # A cosine from the learning rate down to a small share of it at the last step.
        share = 0.5 * (1 + math.cos(math.pi * min(1.0, self.step / self.settings.steps)))
        for group in self._optimiser.param_groups:
            group["lr"] = self.settings.learning_rate * (_LAST_RATE + (1 - _LAST_RATE) * share)
        self._optimiser.step()

    def _prediction(self) -> Tensor:
        with torch.no_grad():
            trust, error = self._trust()
            self._losses = {**self._losses, "made_up_error": error}
            offsets = trust * self._network(self._real_features, self._propagation)
            predicted = self._start_tensor.clone()
            predicted[self._holes] += (offsets[:, None] * self._normals)[self._holes]
            return predicted

    def _weights(self) -> dict[str, Any]:
        return {"network": self._network.state_dict(), "optimiser": self._optimiser.state_dict()}

    def _load_weights(self, state: Mapping[str, Any]) -> None:
        self._network.load_state_dict(state["network"])
        self._optimiser.load_state_dict(state["optimiser"])

    def _loss(self, lesson: _Lesson) -> Tensor:
        offsets = self._network(lesson.features, self._propagation)
        return (offsets - lesson.offsets)[lesson.holes].square().mean()

    def _trust(self) -> tuple[Tensor, Tensor]:
        """Return the factor for the offsets that is best in the reserved holes, 0 to 1, and the mean error left there.

        Where the mesh has no structure to learn, the factor falls towards 0 and the thin plate remains.
        """
        predicted, true = [], []
        for lesson in self._reserved:
            predicted.append(self._network(lesson.features, self._propagation)[lesson.holes])
            true.append(lesson.offsets[lesson.holes])
        offsets, wanted = torch.cat(predicted), torch.cat(true)
        power = offsets.square().sum()
        trust = ((offsets * wanted).sum() / power).clamp(0.0, 1.0) if power > 0 else torch.zeros_like(power)
        return trust, (trust * offsets - wanted).abs().mean()

    def _lesson_of_step(self, step: int) -> _Lesson:
        index = step % _POOL
        if index not in self._pool:
            self._pool[index] = self._lesson(index)
        return self._pool[index]

    def _lesson(self, index: int) -> _Lesson:
        # A generator for each set: a resumed training makes the same ones, whatever it meets first.
        generator = np.random.default_rng([self.settings.seed, index % 2**32])
        holes = self._maker.make(generator)
        if not holes.any():
            raise MeshError(
                "The known part of the mesh is too small to make up holes like the real ones in it. Use --preset compact."
            )
        filled = holes | self._filled
        positions = self._plate.fill(self._true, filled)
        features, normals = self._features(positions, filled)
        offsets = np.einsum("vc,vc->v", self._true - positions, normals)
        indices = torch.from_numpy(np.flatnonzero(holes)).to(self.device)
        return _Lesson(self._tensor(features), self._tensor(offsets), indices)

    def _features(self, positions: FloatArray, filled: BoolArray) -> tuple[FloatArray, FloatArray]:
        return shape_features(
            positions,
            filled,
            depth=self._maker.depth,
            smoothing=self._smoothing,
            adjacency=self._adjacency,
            faces=self.problem.mesh.faces,
        )

    def _tensor(self, values: FloatArray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32)).to(self.device)
