"""Training on recorrupted copies of one noisy mesh: the network never sees the noise that it is judged by."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from dmp.adam import Adam
from dmp.errors import SettingsError, TrainingError
from dmp.geometry import face_area_vectors, normalised
from dmp.mesh import BoolArray, FloatArray
from dmp.problem import Problem
from dmp.recorrupted.detail import given_back
from dmp.recorrupted.filter_bank import diffusions, invariants
from dmp.recorrupted.held_out import hold_out_rings, standard_errors_above
from dmp.recorrupted.losses import normal_errors, position_errors, weighted
from dmp.recorrupted.network import Operators, RestorationNetwork
from dmp.recorrupted.noise_model import (
    NO_NOISE,
    NoiseModel,
    estimate_evenness,
    estimate_noise,
    gain_of_estimate,
    level_along,
    lightly_smoothed,
    standard_draws,
)
from dmp.recorrupted.numbering import Numbering
from dmp.recorrupted.outliers import find_outliers, replaced
from dmp.recorrupted.patches import Patch, patches, whole
from dmp.recorrupted.products import Incidence, area_vectors, vertex_normals
from dmp.settings import Settings
from dmp.training import Training

# Below this level, in mean edge lengths, features are not divided by the noise any more.
_LEAST_LEVEL = 0.01
# Up to NO_NOISE the mesh stays as it is; from this level on the network has its way.
_SURE_NOISE = 0.03
# At these shares of the steps what the restored mesh itself adds to the estimate is taken off it, that many times, because a
# restored mesh has lost most of its finest detail; but no more than to this part of the estimate.
_CORRECTIONS, _DETAIL_LOST, _LEAST_PART = (0.15, 0.3, 0.45, 0.6), 6.0, 0.93
# Some shape is left in an estimate. Taken too low by a part, about as large a part of the noise stays in the result; taken too
# high by as much, detail is lost, which costs more where there is any. So the level is multiplied by this where the restored
# mesh has so much detail that at least the second part was taken off, and by less where it has less.
_CAUTION, _CLEAR_DETAIL = 0.98, 0.006
# What trimming at three deviations leaves of the deviation of normally distributed values; a first guess of what an estimate
# misses, before that can be tried on the restored mesh.
_TRIMMED = 0.9866
# The noise that is added is at least this share as strong across the normal as along it; weak noise more so, until it is as
# strong or has this level across the normal, in mean edge lengths.
_LEAST_TANGENTIAL, _LEAST_ACROSS = 0.5, 0.12
# With less noise across the normal than this, what is taken away along it does not tell how it is distributed.
_ALL_DIRECTIONS = 0.5
# Where the noise is mostly along the normal, movements across it are kept by the tangential share of the noise times this: the
# network makes more of them, because its draws do.
_TANGENTIAL_KEPT = 1.5
_LARGEST_GRADIENT = 2.0
# Of noise, in edge lengths; what a checkpoint says must be possible.
_LARGEST_LEVEL = 1e3
# Area vectors of a lightly smoothed mesh scale the normal term; a sliver's would let its noise count without bound.
_LEAST_AREA_VECTOR = 0.15
# The learning rate falls along a cosine to this share of its first value.
_LAST_RATE = 0.05
# and grows from nothing over so many steps: Adam's first steps are as long as the rate, however small the gradient.
_WARM_UP = 20
# Starts of the bilateral weights among which the risk of the untrained network chooses: from smooth to sharp shapes.
_SHARPNESSES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
# and how far its vertices follow the flattening layer at first, as gates before the logistic function: all the way, or hardly.
_FLATTENINGS = (1.0, -1.0, -4.0)
_RISK_DRAWS = 4
# Draws by which the held-out rings are judged; the noise of the input itself counts for more, and no draw changes that.
_HELD_OUT_DRAWS = 1
# When the risk there is so many standard errors above its lowest value, that is no chance and no slow learning of noise: under
# heavy noise the training has left its course. It goes back to where the risk was lowest, and on at this part of the rate.
_LOST, _SLOWER = 4.0, 0.5


@dataclass(frozen=True, eq=False)
class _Piece:
    """A patch as tensors: positions, operators, and what the losses look at; all of it in a numbering of its own.

    ``order`` has the patch's number of each vertex, ``places`` the own number of each vertex of the patch.
    """

    patch: Patch
    numbering: Numbering
    order: Tensor
    places: Tensor
    operators: Operators
    positions: Tensor
    normals: Tensor
    area_scale: Tensor
    judged_vertices: Tensor | None = None
    judged_faces: Tensor | None = None


@dataclass(frozen=True, eq=False)
class _Lowest:
    """Where the risk on the held-out rings was lowest so far."""

    step: int
    network: RestorationNetwork
    risk: FloatArray


class RecorruptedTraining(Training):
    """Trains a network to restore the mesh from copies with more noise, judged by copies with independent noise.

    Each step draws z, feeds y + a sigma z and asks for y - sigma z / a: for Gaussian noise of level sigma the errors of the two
    are independent (Pang et al., "Recorrupted-to-Recorrupted", CVPR 2021). The prediction is the output for y itself of a
    network whose weights are the running average (``settings.average``) of the trained ones: single weights swing, mostly
    along the surface, and their average does not.

    Beside the losses it measures, at logged steps, ``held_out_risk``: the loss on rings of vertices that the training never
    sees; ``held_out_excess``: by how many standard errors that is above the lowest so far; and ``held_out_lowest_step``. When
    the excess says that the training has left its course, it goes back to the lowest and on more slowly.
    """

    def __init__(self, problem: Problem, settings: Settings, *, run_id: str | None = None) -> None:
        if not problem.known.all():
            raise SettingsError("--method recorrupted removes noise from a whole mesh. Use --method prior to fill holes.")
        super().__init__(problem, settings, np.zeros(0, dtype=np.int64), run_id)
        faces = problem.mesh.faces
        positions = (problem.target - problem.origin) / problem.edge_length
        self.outliers = find_outliers(positions, faces)
        positions = replaced(positions, faces, self.outliers)
        self._estimate = estimate_noise(positions, faces)
        self.noise = _with_settings(self._estimate, settings)
        self._level = max(self.noise.level, _LEAST_LEVEL)
        self._trust = float(np.clip((self.noise.level - NO_NOISE) / (_SURE_NOISE - NO_NOISE), 0, 1))
        self._scale = problem.edge_length / problem.unit

        smoothed = lightly_smoothed(positions, faces)
        areas = face_area_vectors(smoothed, faces)
        everything = whole(faces, len(positions))
        self._whole = self._piece(everything, positions, areas)
        parts = patches(smoothed, faces, settings.patch_size)
        hidden, self._rings = hold_out_rings(parts, len(positions), settings.hold_out, settings.seed)
        pieces = [self._whole] if len(parts) == 1 else [self._piece(part, positions, areas) for part in parts]
        self._pieces = [self._without(piece, hidden) for piece in pieces]
        self._lowest: _Lowest | None = None
        self._slowness = 1.0

        self._generator = torch.Generator().manual_seed(settings.seed)
        # Forked, so that the caller's own random numbers stay as they were.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(settings.seed)
            network = RestorationNetwork(settings.bilateral_layers, settings.normal_passes, settings.vertex_passes)
        self._network = network.to(self.device)
        first = self._pieces[0]
        differences, normals = diffusions(
            first.positions + settings.recorruption * self._noise(first, self._generator)[0],
            first.operators.half_lazy,
            first.operators.incidence,
        )
        network.bank.standardise(invariants(differences, normals, self._level)[0])
        network.set_sharpness(min(_SHARPNESSES, key=lambda sharpness: self._risk_with(network.set_sharpness, sharpness)))
        network.set_flattening(min(_FLATTENINGS, key=lambda gate: self._risk_with(network.set_flattening, gate, flatten=True)))
        self._average = copy.deepcopy(network)
        self._optimiser = Adam(self._network.parameters(), lr=settings.learning_rate)

    @property
    def n_parameters(self) -> int:
        """Number of trained values in the network."""
        return sum(parameter.numel() for parameter in self._network.parameters())

    def _risk_with(self, choose: Callable[[float], None], value: float, *, flatten: bool = False) -> float:
        """Return the mean loss of the untrained network with a choice made for it; the draws are the same for each."""
        choose(value)
        before = self._generator.get_state()
        with torch.no_grad():
            risk = sum(self._forward(flatten=flatten)["total_loss"].item() for _ in range(_RISK_DRAWS)) / _RISK_DRAWS
        self._generator.set_state(before)
        return risk

    def _piece(self, patch: Patch, positions: FloatArray, areas: FloatArray) -> _Piece:
        numbering = Numbering.of(patch.faces, len(patch.vertices))
        own, vertices = areas[patch.face_indices[numbering.faces]], patch.vertices[numbering.vertices]
        return _Piece(
            patch=patch,
            numbering=numbering,
            order=torch.from_numpy(numbering.vertices).to(self.device),
            places=torch.from_numpy(numbering.vertex_places).to(self.device),
            operators=Operators.of(numbering.renumbered, len(vertices), normalised(own), self.device),
            positions=self._tensor(positions[vertices]),
            normals=self._tensor(self.noise.normals[vertices]),
            area_scale=self._tensor(np.maximum(np.linalg.norm(own, axis=1, keepdims=True), _LEAST_AREA_VECTOR)),
        )

    def _without(self, piece: _Piece, hidden: BoolArray) -> _Piece:
        """Return the piece with losses that look neither at its margin nor at the ``hidden`` vertices of the mesh, (V,)."""
        patch, apart = piece.patch, hidden[piece.patch.vertices]
        vertices = patch.judged_vertices[~apart[patch.judged_vertices]]
        faces = patch.judged_faces[~apart[patch.faces[patch.judged_faces]].any(axis=1)]
        if len(vertices) == len(patch.vertices):
            return piece
        return replace(
            piece,
            judged_vertices=torch.from_numpy(np.sort(piece.numbering.vertex_places[vertices])).to(self.device),
            judged_faces=torch.from_numpy(np.sort(piece.numbering.face_places[faces])).to(self.device),
        )

    def _noise(self, piece: _Piece, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Return what is added to the input and what is taken off the target, before the factor a, (v, 3) both.

        With A and B that map z to the two, A B^T must be the covariance of the noise. Where the noise is along the normal, A
        still moves vertices across it: otherwise every draw would leave them in the very same tangential places, by which the
        network knows them again and learns their noise. B shrinks as A grows, so that their product stays the same.
        """
        draws = standard_draws(len(piece.positions), self.noise.evenness, generator).to(self.device)
        draws = draws.index_select(0, piece.order)
        share = self.noise.tangential
        if share >= 1:
            return self.noise.level * draws, self.noise.level * draws
        along = (draws * piece.normals).sum(dim=1, keepdim=True) * piece.normals
        across = draws - along
        added = max(share, _LEAST_TANGENTIAL, min(1.0, _LEAST_ACROSS / self._level))
        return self.noise.level * (along + added * across), self.noise.level * (along + share**2 / added * across)

    def _restored(
        self, network: RestorationNetwork, piece: _Piece, generator: torch.Generator, *, flatten: bool = True
    ) -> tuple[Tensor, Tensor]:
        """Return what the network makes of a recorrupted copy of a piece, and the target that belongs to it, (v, 3) both."""
        added, taken = self._noise(piece, generator)
        output = network(piece.positions + self.settings.recorruption * added, piece.operators, self._level, flatten)
        return output, piece.positions - taken / self.settings.recorruption

    def _forward(self, *, flatten: bool = True) -> dict[str, Tensor]:
        chosen = torch.randint(len(self._pieces), (), generator=self._generator) if len(self._pieces) > 1 else 0
        piece = self._pieces[int(chosen)]
        output, target = self._restored(self._network, piece, self._generator, flatten=flatten)
        position = position_errors(_rows(output, piece.judged_vertices), _rows(target, piece.judged_vertices)).mean()
        normal = _normal_errors(output, target, piece, piece.judged_faces).mean()
        total = weighted(position, normal, self.settings.normal_weight)
        return {"total_loss": total, "position_loss": position, "normal_loss": normal}

    # -- the held-out rings -----------------------------------------------------------------------------------------

    @torch.no_grad()
    def _held_out_risk(self, network: RestorationNetwork) -> FloatArray:
        """Return each held-out ring's part of the loss that the network makes on all of them, the same draws every time."""
        generator = torch.Generator().manual_seed(self.settings.seed)
        n_rings = 1 + max(int(rings.vertex_rings.max(initial=-1)) for rings in self._rings)
        position, normal = np.zeros(n_rings), np.zeros(n_rings)
        for rings in self._rings:
            piece = self._pieces[rings.patch]
            numbering = piece.numbering
            chosen = numbering.vertex_places[rings.vertices], numbering.face_places[rings.faces]
            vertices, faces = (torch.from_numpy(own).to(self.device) for own in chosen)
            for _ in range(_HELD_OUT_DRAWS):
                output, target = self._restored(network, piece, generator)
                of_vertices = position_errors(output.index_select(0, vertices), target.index_select(0, vertices))
                of_faces = _normal_errors(output, target, piece, faces)
                position += np.bincount(rings.vertex_rings, of_vertices.cpu().numpy(), n_rings)
                normal += np.bincount(rings.face_rings, of_faces.cpu().numpy(), n_rings)
        n_vertices = _HELD_OUT_DRAWS * sum(len(rings.vertices) for rings in self._rings)
        n_faces = _HELD_OUT_DRAWS * max(1, sum(len(rings.faces) for rings in self._rings))
        return position / n_vertices + self.settings.normal_weight * normal / n_faces

    def _look_at_held_out(self) -> dict[str, Tensor]:
        # Between two logged steps nobody is told, and a look out of turn must not change what is found later.
        if not self._rings or self.step == 0 or self.step % self.settings.log_every:
            return {}
        risk = self._held_out_risk(self._average)
        lowest = self._lowest
        if lowest is None or risk.sum() < lowest.risk.sum():
            lowest = self._lowest = _Lowest(self.step, copy.deepcopy(self._average), risk)
        excess = standard_errors_above(risk, lowest.risk)
        if excess >= _LOST:
            self._go_back_to(lowest)
        values = {"held_out_risk": risk.sum(), "held_out_excess": excess, "held_out_lowest_step": lowest.step}
        return {name: torch.tensor(float(value), dtype=torch.float64) for name, value in values.items()}

    def _go_back_to(self, lowest: _Lowest) -> None:
        for network in (self._network, self._average):
            network.load_state_dict(lowest.network.state_dict())
        self._optimiser = Adam(self._network.parameters(), lr=self.settings.learning_rate)
        self._slowness *= _SLOWER

    def _losses_before(self) -> Mapping[str, Tensor]:
        # With the random numbers put back, so that a training that is asked for its first record is no other training.
        before = self._generator.get_state()
        with torch.no_grad():
            losses = self._forward()
        self._generator.set_state(before)
        return losses

    def _compute_gradients(self) -> Mapping[str, Tensor]:
        losses = self._forward()
        self._optimiser.zero_grad(set_to_none=True)
        losses["total_loss"].backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self._network.parameters(), _LARGEST_GRADIENT)
        return {name: value.detach() for name, value in losses.items()}

    def _apply_gradients(self) -> None:
        progress = min(self.step / self.settings.steps, 1.0)
        rate = _LAST_RATE + (1 - _LAST_RATE) * 0.5 * (1 + np.cos(np.pi * progress))
        rate *= min(1.0, (self.step + 1) / _WARM_UP)
        for group in self._optimiser.param_groups:
            group["lr"] = self.settings.learning_rate * self._slowness * float(rate)
        self._optimiser.step()
        # The average begins short, so that the first, poor weights are soon forgotten.
        decay = min(self.settings.average, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            for mean, weight in zip(self._average.parameters(), self._network.parameters(), strict=True):
                mean.lerp_(weight, 1 - decay)

        if self.step + 1 in {round(share * self.settings.steps) for share in _CORRECTIONS}:
            self._look_at_noise_again()

    @torch.no_grad()
    def _look_at_noise_again(self) -> None:
        """Learn about the noise from what the restoration takes away.

        What the restored shape itself adds to the estimate of the level is taken off it, and what the estimate misses of noise
        that is put on that shape is given back, unless a person gave the level. And the draws get the distribution of the
        noise: if it is the same, noise and draw can change places, so that a network that knows their sum expects their
        difference to be 0, whatever that distribution is.
        """
        if self.noise.level < _SURE_NOISE:
            return
        whole, normals = self._whole, self.noise.normals
        output = self._average(whole.positions, whole.operators, self._level)
        before, restored = (part.index_select(0, whole.places).cpu().numpy() for part in (whole.positions, output))
        restored = restored.astype(np.float64)
        removed = np.einsum("vc,vc->v", before - restored, normals)
        evenness = estimate_evenness(removed, normals) if self.noise.tangential >= _ALL_DIRECTIONS else 0.0
        level = self.noise.level
        if not self.settings.noise_level:
            estimate, shape = self._estimate.level, level_along(restored, whole.patch.faces, normals)
            left = float(np.sqrt(max(estimate**2 - _DETAIL_LOST * shape**2, (_LEAST_PART * estimate) ** 2)))
            caution = 1 - (1 - _CAUTION) * min(1.0, (1 - left / estimate) / _CLEAR_DETAIL)
            assumed = replace(self.noise, level=estimate, evenness=evenness)
            level = caution * left / gain_of_estimate(restored, whole.patch.faces, assumed)
        self.noise = replace(self.noise, level=level, evenness=evenness)
        if self._lowest is not None:
            # Risks under different noise can't be compared.
            self._lowest = replace(self._lowest, risk=self._held_out_risk(self._lowest.network))

    @torch.no_grad()
    def _prediction(self) -> Tensor:
        self._losses = {**self._losses, **self._look_at_held_out()}
        before = self._whole.positions
        after = self._average(before, self._whole.operators, self._level)
        share = min(1.0, _TANGENTIAL_KEPT * self.noise.tangential)
        after = given_back(before, after, self._whole.operators, self.settings.recorruption, across=share >= 1)
        if share < 1:
            after = _mostly_along_normals(before, after, self._whole.operators.incidence, share)
        return torch.lerp(before, after, self._trust).index_select(0, self._whole.places) * self._scale

    def _weights(self) -> dict[str, Any]:
        return {
            "network": self._network.state_dict(),
            "average": self._average.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "generator": self._generator.get_state(),
            "noise": {"level": self.noise.level, "evenness": self.noise.evenness},
            "lowest": None if self._lowest is None else self._lowest_state(self._lowest),
            "slowness": self._slowness,
        }

    def _lowest_state(self, lowest: _Lowest) -> dict[str, Any]:
        return {"step": lowest.step, "network": lowest.network.state_dict(), "risk": torch.from_numpy(lowest.risk)}

    def _load_weights(self, state: Mapping[str, Any]) -> None:
        if len(state["optimiser"]["param_groups"][0]["params"]) != len(list(self._network.parameters())):
            raise TrainingError("The checkpoint belongs to a network of another depth.")
        self._network.load_state_dict(state["network"])
        self._average.load_state_dict(state["average"])
        self._optimiser.load_state_dict(state["optimiser"])
        self._generator.set_state(state["generator"].cpu())
        noise, lowest = state["noise"], state["lowest"]
        self.noise = replace(self.noise, level=float(noise["level"]), evenness=float(noise["evenness"]))
        if not (0 <= self.noise.level < _LARGEST_LEVEL and 0 <= self.noise.evenness <= 1):
            raise TrainingError("The checkpoint is damaged: it tells of impossible noise.")
        self._slowness = float(state.get("slowness", 1.0))
        if not 0 < self._slowness <= 1:
            raise TrainingError("The checkpoint is damaged: it tells of an impossible learning rate.")
        self._lowest = None
        if lowest is not None:
            network = copy.deepcopy(self._average)
            network.load_state_dict(lowest["network"])
            risk = lowest["risk"].numpy().astype(np.float64)
            if not self._rings or risk.shape != self._held_out_risk(network).shape:
                raise TrainingError("The checkpoint belongs to another mesh: other parts of it were held out.")
            self._lowest = _Lowest(int(lowest["step"]), network, risk)

    def _tensor(self, values: FloatArray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32)).to(self.device)


def _rows(values: Tensor, indices: Tensor | None) -> Tensor:
    return values if indices is None else values.index_select(0, indices)


def _corners(positions: Tensor, faces: Tensor) -> Tensor:
    return positions.index_select(0, faces.reshape(-1)).view(3, -1, 3)


def _with_settings(noise: NoiseModel, settings: Settings) -> NoiseModel:
    return NoiseModel(
        settings.noise_level or _CAUTION / _TRIMMED * noise.level,
        noise.tangential if settings.noise_tangential < 0 else settings.noise_tangential,
        noise.normals,
    )


def _mostly_along_normals(before: Tensor, after: Tensor, incidence: Incidence, share: float) -> Tensor:
    """Return ``after`` with the part of the movement that is across its own vertex normals multiplied by ``share``."""
    normals = vertex_normals(after, incidence)
    movement = after - before
    along = (movement * normals).sum(dim=1, keepdim=True) * normals
    return before + along + share * (movement - along)


def _normal_errors(output: Tensor, target: Tensor, piece: _Piece, chosen: Tensor | None) -> Tensor:
    """Return the error of the normals of all faces of a piece, or of the ``chosen`` ones, (N,)."""
    faces = piece.operators.incidence.corners.view(3, -1)
    if chosen is not None:
        faces = faces.index_select(1, chosen)
    predicted, wanted = area_vectors(_corners(output, faces)), area_vectors(_corners(target, faces))
    return normal_errors(predicted, wanted, _rows(piece.area_scale, chosen))
