"""How far a state of a mesh is from another one, vertex by vertex, and which range such values have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dmp.mesh import FloatArray
from dmp.vertex_fans import VertexFans

# A few vertices far off would otherwise take the whole range for themselves.
ROBUST_PERCENTILE = 98.0


def distances(positions: FloatArray, reference: FloatArray) -> FloatArray:
    """Return the distance of each vertex (V, 3) from its place in ``reference`` (V, 3), (V,), in their unit."""
    return np.asarray(np.linalg.norm(positions - reference, axis=1))


def signed_distances(positions: FloatArray, reference: FloatArray, normals: FloatArray) -> FloatArray:
    """Return the part of the way from ``reference`` to ``positions``, both (V, 3), along unit normals (V, 3): (V,)."""
    return np.einsum("vc,vc->v", positions - reference, normals)


def normal_angles(positions: FloatArray, reference_normals: FloatArray, fans: VertexFans) -> FloatArray:
    """Return how far the surface leans away from another state of it, (V,), in degrees.

    The angle between the normals of each face, as in :func:`dmp.metrics.mean_angular_difference`, averaged over the faces
    of a vertex.

    Args:
        positions: (V, 3).
        reference_normals: unit normals of the faces in the other state, (F, 3).
        fans: of the mesh.
    """
    cosines = np.einsum("fc,fc->f", fans.face_normals(positions), reference_normals)
    return fans.means(np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0))))


def extent(values: NDArray[np.floating], percentile: float = ROBUST_PERCENTILE) -> float:
    """Return the size below which ``percentile`` per cent of the values (N,) lie, whatever their sign.

    Values that are not finite don't count; without any other the extent is 0.
    """
    finite = np.abs(values[np.isfinite(values)])
    return float(np.percentile(finite, percentile)) if len(finite) else 0.0
