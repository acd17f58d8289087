"""Differentiable gathers and sums over a mesh, each with a backward pass that is a plain sum in a fixed order."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from scipy import sparse
from torch import Tensor, nn
from torch.nn import functional

from dmp.mesh import IntArray
from dmp.operators import to_torch
from dmp.recorrupted.face_graph import FaceGraph
from dmp.recorrupted.layout import Layout


@dataclass(frozen=True, eq=False)
class Incidence:
    """Faces and vertices of one mesh as tensors.

    Attributes:
        corners: vertex of each corner, (3 F,), all first corners, then all second, then all third ones.
        corner_sum: (V, 3 F) CSR of ones: sums the corners at each vertex.
        corner_counts: number of corners at each vertex, at least 1, (V, 1).
        neighbours: face in each slot, (3 F,), slot by slot; see :class:`dmp.recorrupted.face_graph.FaceGraph`.
        back: slot that leads back, (3 F,).
        signs: (3, F, 1).
        complete: whether no slot is empty, and no neighbour is turned the other way.
        face_rows: row starts of a CSR matrix with four entries a face: itself and its slots, (F + 1,) int32.
        face_columns: their columns, (4 F,) int32.
    """

    corners: Tensor
    corner_sum: Tensor
    corner_counts: Tensor
    neighbours: Tensor
    back: Tensor
    signs: Tensor
    complete: bool
    face_rows: Tensor
    face_columns: Tensor

    @property
    def n_faces(self) -> int:
        """Number of faces, F."""
        return self.signs.shape[1]

    @cached_property
    def layout(self) -> Layout:
        """The same for compiled kernels; on the processor only."""
        return Layout.of(
            self.corners,
            self.neighbours,
            self.back,
            self.signs,
            corner_sum=self.corner_sum,
            corner_counts=self.corner_counts,
            complete=self.complete,
        )

    @classmethod
    def of(cls, faces: IntArray, n_vertices: int, graph: FaceGraph, device: torch.device) -> Incidence:
        """Build the tensors for ``faces`` (F, 3) and their neighbours."""
        corners = np.ascontiguousarray(faces.T).reshape(-1)
        ones = sparse.csr_array((np.ones(len(corners)), (corners, np.arange(len(corners)))), shape=(n_vertices, len(corners)))
        counts = np.maximum(np.bincount(corners, minlength=n_vertices), 1)[:, None]
        columns = np.vstack([np.arange(len(faces)), graph.neighbours]).T.reshape(-1)
        return cls(
            corners=torch.from_numpy(corners).to(device),
            corner_sum=to_torch(ones, device),
            corner_counts=torch.from_numpy(counts).float().to(device),
            neighbours=torch.from_numpy(graph.neighbours.reshape(-1)).to(device),
            back=torch.from_numpy(graph.back.reshape(-1)).to(device),
            signs=torch.from_numpy(graph.signs[:, :, None]).float().to(device),
            complete=bool((graph.signs > 0).all()),
            face_rows=torch.arange(0, 4 * len(faces) + 1, 4, dtype=torch.int32, device=device),
            face_columns=torch.from_numpy(columns.astype(np.int32)).to(device),
        )


class _GatherCorners(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, incidence: Incidence) -> Tensor:
        ctx.incidence = incidence
        return values.index_select(0, incidence.corners)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        return ctx.incidence.corner_sum @ gradients[0].contiguous(), None


class _SumCorners(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, incidence: Incidence) -> Tensor:
        ctx.incidence = incidence
        return incidence.corner_sum @ values

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        return gradients[0].index_select(0, ctx.incidence.corners), None


class _GatherNeighbours(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, incidence: Incidence) -> Tensor:
        ctx.incidence = incidence
        return values.index_select(0, incidence.neighbours).view(3, *values.shape)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        # What face f gave to its neighbours comes back through the slots that lead to f.
        gradient = gradients[0]
        returned = gradient.reshape(-1, gradient.shape[-1]).index_select(0, ctx.incidence.back).view(gradient.shape)
        return returned.sum(dim=0), None


class _GatherNeighbourRows(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, values: Tensor, incidence: Incidence) -> Tensor:
        ctx.incidence = incidence
        return values.index_select(1, incidence.neighbours).view(len(values), 3, -1)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        gradient = gradients[0]
        returned = gradient.reshape(len(gradient), -1).index_select(1, ctx.incidence.back).view(gradient.shape)
        return returned.sum(dim=1), None


def gather_corners(values: Tensor, incidence: Incidence) -> Tensor:
    """Return the ``values`` (V, C) of the vertices at the corners, (3, F, C)."""
    gathered: Tensor = _GatherCorners.apply(values, incidence)  # type: ignore[no-untyped-call]
    return gathered.view(3, -1, values.shape[1])


def sum_corners(values: Tensor, incidence: Incidence) -> Tensor:
    """Return the sums of ``values`` (3, F, C) over the corners at each vertex, (V, C)."""
    return _SumCorners.apply(values.reshape(-1, values.shape[-1]), incidence)  # type: ignore[no-untyped-call]


def gather_neighbours(values: Tensor, incidence: Incidence) -> Tensor:
    """Return the ``values`` (F, C) of the face in each slot, (3, F, C); an empty slot holds the face's own."""
    return _GatherNeighbours.apply(values, incidence)  # type: ignore[no-untyped-call]


def gather_neighbour_rows(values: Tensor, incidence: Incidence) -> Tensor:
    """Return the same for values whose coordinates come first: (C, 3, F) for (C, F)."""
    return _GatherNeighbourRows.apply(values, incidence)  # type: ignore[no-untyped-call]


def linear_of_both(layer: nn.Linear, one: Tensor, other: Tensor) -> Tensor:
    """Return what the layer makes of the rows of both side by side, (N, out), without putting them there."""
    weight, width = layer.weight, one.shape[1]
    return torch.addmm(functional.linear(one, weight[:, :width], layer.bias), other, weight[:, width:].t())


def area_vectors(corners: Tensor) -> Tensor:
    """Return the cross products of two edges of each face, (F, 3), for corners (3, F, 3)."""
    return torch.linalg.cross(corners[1] - corners[0], corners[2] - corners[0])


def vertex_normals(positions: Tensor, incidence: Incidence) -> Tensor:
    """Return unit vertex normals, (V, 3): the normals of the faces around each vertex, weighted by area.

    They have the dtype of the ``positions`` (V, 3), and are 0 at a vertex without faces and where the faces cancel out.
    """
    areas = area_vectors(gather_corners(positions, incidence))
    return functional.normalize(sum_corners(areas.expand(3, -1, -1), incidence), dim=1)
