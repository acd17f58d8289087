"""Another order of the vertices and faces of a piece, in which neighbours lie close together in memory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmp.mesh import IntArray
from dmp.renumbering import inverse_of, locality_order
from dmp.topology import adjacency


@dataclass(frozen=True, eq=False)
class Numbering:
    """New numbers of vertices and faces.

    Attributes:
        vertices: old number of each vertex by its new one, (V,).
        faces: the same of the faces, (F,).
        vertex_places: new number of each vertex by its old one, (V,).
        face_places: the same of the faces, (F,).
        renumbered: the faces in their new order, in new numbers of their vertices, (F, 3).
    """

    vertices: IntArray
    faces: IntArray
    vertex_places: IntArray
    face_places: IntArray
    renumbered: IntArray

    @classmethod
    def of(cls, faces: IntArray, n_vertices: int) -> Numbering:
        """Find an order for ``faces`` (F, 3); faces follow the vertices, and keep the order of their corners."""
        vertices = locality_order(adjacency(faces, n_vertices))
        places = inverse_of(vertices)
        renumbered = places[faces]
        order = np.argsort(renumbered.min(axis=1, initial=n_vertices), kind="stable")
        return cls(vertices, order, places, inverse_of(order), renumbered[order])
