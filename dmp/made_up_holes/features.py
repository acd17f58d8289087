"""What the network sees of a mesh with filled holes: numbers that turning or moving the mesh does not change."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from dmp.geometry import vertex_normals
from dmp.made_up_holes.making import ring_distances
from dmp.mesh import BoolArray, FloatArray, IntArray

# Numbers of smoothing steps whose differences from the mesh describe its shape at several scales.
_SCALES = (1, 2, 3, 5, 8, 13, 21)
_NORMAL_SCALE = 5
_FARTHEST = 10
N_FEATURES = 2 * len(_SCALES) + 3


def shape_features(
    positions: FloatArray,
    filled: BoolArray,
    *,
    depth: int,
    smoothing: sparse.csr_array,
    adjacency: sparse.csr_array,
    faces: IntArray,
) -> tuple[FloatArray, FloatArray]:
    """Describe each vertex of a mesh whose ``filled`` vertices lie on the thin plate.

    Args:
        positions: (V, 3), in mean edge lengths.
        filled: (V,) bool, vertices of real and made-up holes.
        depth: rings from rim to middle of the deepest real hole; the unit of the two distances.
        smoothing: half-lazy averaging over neighbours, (V, V), rows adding up to 1.
        adjacency: (V, V).
        faces: (F, 3).

    Returns:
        features: (V, N_FEATURES): for each scale k the difference u_k of the mesh after k smoothing steps from the mesh,
            along the normal and in length; whether the vertex is filled; rings to the nearest true and filled vertex.
        normals: (V, 3), of the mesh after 5 smoothing steps; the direction in which the network moves vertices.
    """
    along, lengths = [], []
    smooth = positions
    differences = []
    for step in range(1, _SCALES[-1] + 1):
        smooth = np.asarray(smoothing @ smooth)
        if step in _SCALES:
            differences.append(smooth - positions)
        if step == _NORMAL_SCALE:
            normals = vertex_normals(smooth, faces)
    for difference in differences:
        along.append(np.einsum("vc,vc->v", difference, normals))
        lengths.append(np.linalg.norm(difference, axis=1))
    to_true = ring_distances(adjacency, ~filled) / depth
    rings = ring_distances(adjacency, filled, _FARTHEST)
    to_filled = np.where(rings < 0, _FARTHEST, rings) / depth
    return np.column_stack([*along, *lengths, filled, to_true, to_filled]), normals
