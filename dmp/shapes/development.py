"""A family of clean meshes of many kinds, to develop and compare methods on.

They are made by this program alone, so results on them can be shown and repeated by anyone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from dmp.errors import SettingsError
from dmp.mesh import FloatArray, TriangleMesh
from dmp.shapes import mechanical, organic
from dmp.shapes.alterations import cut_open, placed, shuffled_along_surface, together, with_slivers
from dmp.shapes.sheets import wavy_sheet
from dmp.shapes.solids import torus
from dmp.shapes.spheres import bumpy_sphere, icosphere
from dmp.shapes.surface_mesh import mesh_solid


def _graded(points: FloatArray) -> FloatArray:
    """Relative edge lengths from 0.5 at one side of the shape to 1.6 at the other."""
    return 1.05 + 0.55 * np.clip(points[:, 0], -1.0, 1.0)


DEVELOPMENT_SHAPES: Mapping[str, Callable[[], TriangleMesh]] = MappingProxyType(
    {
        # Sharp edges.
        "cube": lambda: mesh_solid(mechanical.cube(), 4000),
        "prism": lambda: mesh_solid(mechanical.prism(5), 4000),
        "stairs": lambda: mesh_solid(mechanical.stairs(), 5000),
        "pipe": lambda: mesh_solid(mechanical.pipe(), 5000),
        "gear": lambda: mesh_solid(mechanical.gear(), 8000),
        "bracket": lambda: mesh_solid(mechanical.bracket(), 6000),
        "ring-groove": lambda: mesh_solid(mechanical.ring_groove(), 5000),
        # Smooth and detailed.
        "sphere": lambda: icosphere(20),
        "torus": lambda: mesh_solid(torus((0, 0, 0), 2, 0.7, 0.3), 5000),
        "blob-a": lambda: mesh_solid(organic.blob(1), 5000),
        "blob-b": lambda: mesh_solid(organic.blob(2), 5000),
        "jug": lambda: mesh_solid(organic.jug(), 6000),
        "knot": lambda: mesh_solid(organic.knot(), 6000),
        "wrinkled-ball": lambda: mesh_solid(organic.wrinkled_ball(), 6000),
        "sparse-bumps": lambda: bumpy_sphere(24, 2, 0.15, 0.3),
        # One shape, several resolutions.
        "fan-block-2k": lambda: mesh_solid(mechanical.fan_block(), 2000),
        "fan-block-20k": lambda: mesh_solid(mechanical.fan_block(), 20_000),
        "blob-2k": lambda: mesh_solid(organic.blob(4), 2000),
        "dinosaur-4k": lambda: mesh_solid(organic.dinosaur(), 4000),
        "dinosaur-20k": lambda: mesh_solid(organic.dinosaur(), 20_000),
        # Irregular triangles.
        "random-blob": lambda: mesh_solid(organic.blob(3), 5000, relaxation_steps=0),
        "random-bracket": lambda: mesh_solid(mechanical.bracket(), 5000, relaxation_steps=0),
        "graded-jug": lambda: mesh_solid(organic.jug(), 5000, size=_graded),
        "graded-cube": lambda: mesh_solid(mechanical.cube(), 4000, size=_graded),
        "shuffled-bumps": lambda: shuffled_along_surface(bumpy_sphere(20), 0.35),
        "sliver-pipe": lambda: with_slivers(mesh_solid(mechanical.pipe(), 4000), 0.03),
        # Boundaries and components.
        "wavy-sheet": lambda: wavy_sheet(70),
        "open-jug": lambda: cut_open(mesh_solid(organic.jug(), 5000), (0, 0, 1), 0.6),
        "half-gear": lambda: cut_open(mesh_solid(mechanical.gear(), 6000), (0, 1, 0), 0.05),
        "three-parts": lambda: together(
            [
                icosphere(14),
                placed(mesh_solid(mechanical.cube(), 2000), 0.7, (2, 0, 0)),
                placed(wavy_sheet(40), 1.0, (0, 2.2, 0)),
            ]
        ),
    }
)


def development_set(names: Sequence[str] | None = None) -> Iterator[tuple[str, TriangleMesh]]:
    """Make the meshes of :data:`DEVELOPMENT_SHAPES` one after the other; each takes up to half a minute.

    Args:
        names: which ones; all if None.

    Yields:
        Name and clean mesh, always the same for the same name.

    Raises:
        SettingsError: when a name is unknown.
    """
    unknown = [name for name in names or () if name not in DEVELOPMENT_SHAPES]
    if unknown:
        raise SettingsError(f"There is no development mesh named '{unknown[0]}'. There are {', '.join(DEVELOPMENT_SHAPES)}.")
    for name in DEVELOPMENT_SHAPES if names is None else names:
        yield name, DEVELOPMENT_SHAPES[name]()
