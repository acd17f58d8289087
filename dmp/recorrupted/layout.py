"""Faces and vertices of a mesh as compiled kernels want them: 32-bit numbers, in fours."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional


@dataclass(frozen=True, eq=False)
class Layout:
    """Where in memory the numbers of neighbours lie; see :mod:`dmp.compiled.normal_kernels`, ``vertex_kernels``.

    Attributes:
        n_padded: number of faces, made up to a multiple of 4.
        slots: numbers 0, 1, ..., (3 F,) int32.
        back: slot that leads back, (3 F,) int32.
        around: for a face where fours of numbers begin of itself and of its neighbours, (n_padded, 4) int32.
        corners: where those of the vertices begin, first corners of four faces, second, third, nothing; (n_padded, 4) int32.
        starts: where in ``faces`` those of a vertex begin, (V + 1,) int32.
        faces: the faces around the vertices, (3 F,) int32.
        shares: 1 / number of faces of a vertex, 1 where there is none, (V,) float32.
        signs: of the slots, (3, n_padded) float32.
        turns: by what the neighbours' normals are multiplied where they are compared, (3, n_padded) float32.
        slots_back: slot + 3 face of the slots that lead back, of each face and nothing, (n_padded, 4) int32.
        corner_places: corner + 3 face of the corners at the vertices, (3 F,) int32.
    """

    n_padded: int
    slots: Tensor
    back: Tensor
    around: Tensor
    corners: Tensor
    starts: Tensor
    faces: Tensor
    shares: Tensor
    signs: Tensor
    turns: Tensor
    slots_back: Tensor
    corner_places: Tensor

    @classmethod
    def of(
        cls,
        corners: Tensor,
        neighbours: Tensor,
        back: Tensor,
        signs: Tensor,
        *,
        corner_sum: Tensor,
        corner_counts: Tensor,
        complete: bool,
    ) -> Layout:
        """Take the arrays of an :class:`dmp.recorrupted.products.Incidence`."""
        n_faces = len(corners) // 3
        n_padded = -(-n_faces // 4) * 4
        more = n_padded - n_faces
        own = 4 * torch.arange(n_padded)
        around = functional.pad(4 * neighbours.view(3, -1), (0, more))
        of_vertices = functional.pad(4 * corners.view(3, -1), (0, more, 0, 1))
        places, faces = corner_sum.col_indices() // max(n_faces, 1), corner_sum.col_indices() % max(n_faces, 1)
        slots_back = (back // max(n_faces, 1) + 3 * (back % max(n_faces, 1))).view(3, -1)
        all_signs = functional.pad(signs.view(3, -1).float(), (0, more))
        return cls(
            n_padded=n_padded,
            slots=torch.arange(3 * n_faces, dtype=torch.int32),
            back=back.int(),
            around=torch.cat([own[None], around]).t().contiguous().int(),
            corners=of_vertices.view(4, -1, 4).transpose(0, 1).contiguous().int(),
            starts=corner_sum.crow_indices().int(),
            faces=faces.int(),
            shares=1 / corner_counts[:, 0].float(),
            signs=all_signs,
            turns=torch.ones_like(all_signs) if complete else all_signs,
            slots_back=functional.pad(slots_back, (0, more, 0, 1)).t().contiguous().int(),
            corner_places=(places + 3 * faces).int(),
        )

    @property
    def of_vertices(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Corners, starts, faces and shares."""
        return self.corners, self.starts, self.faces, self.shares
