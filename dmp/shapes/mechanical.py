"""Solids with sharp edges, as machine parts have them, of about size 1 around the origin."""

from __future__ import annotations

import numpy as np

from dmp.mesh import FloatArray
from dmp.shapes.solids import (
    Solid,
    ball,
    blend,
    box,
    cone,
    cylinder,
    half_space,
    intersection,
    rounded_intersection,
    torus,
    union,
)


def fan_block() -> Solid:
    """Return a fan-shaped machine part: curved top with a round pocket, stepped rim, boss with chamfer and bore, two holes.

    The flange at its foot has rounded corners; all other edges are sharp.
    """
    hub = np.array([-0.62, 0.0, 0.0])
    opening = np.radians(44.0)
    flange = rounded_intersection([*_fan_sides(hub, opening, 0.24), cylinder(hub, 2, 1.5)], 0.25) & half_space((0, 0, 1), -0.18)
    crown = cylinder((-0.7, 0, -2.2), 1, 2.55)
    upper = intersection([*_fan_sides(hub, opening, 0.13), cylinder(hub, 2, 1.2), crown])
    boss = cylinder(hub, 2, 0.34) & cone((hub[0], hub[1], 0.93), 2, np.radians(40.0)) & half_space((0, 0, 1), 0.62)
    body = (flange | upper | boss) & half_space((0, 0, -1), 0.45)
    holes = [cylinder(hub, 2, 0.17), ball((0.16, 0.0, 0.34), 0.3)]
    holes += [cylinder(hub + 1.34 * np.array([np.cos(a), np.sin(a), 0.0]), 2, 0.09) for a in np.radians([-26.0, 26.0])]
    return body - union(holes)


def _fan_sides(hub: FloatArray, half_opening: float, distance: float) -> list[Solid]:
    """Return the two half-spaces between which a fan opens towards +x, bounded at ``distance`` from ``hub``."""
    sides = []
    for sign in (1.0, -1.0):
        normal = np.array([-np.sin(half_opening), sign * np.cos(half_opening), 0.0])
        sides.append(half_space(normal, float((normal * hub).sum()) + distance))
    return sides


def cube() -> Solid:
    """Return the cube of side 1.6."""
    return box((-0.8, -0.8, -0.8), (0.8, 0.8, 0.8))


def prism(n_sides: int) -> Solid:
    """Return a right prism of height 1.2 over a regular polygon with ``n_sides`` sides."""
    angles = 2 * np.pi * np.arange(n_sides) / n_sides
    sides = [half_space((np.cos(a), np.sin(a), 0), 0.8 * np.cos(np.pi / n_sides)) for a in angles]
    return intersection([*sides, half_space((0, 0, 1), 0.6), half_space((0, 0, -1), 0.6)])


def stairs(n_steps: int = 4) -> Solid:
    """Return a block with ``n_steps`` equal steps that go down towards +x."""
    depth, rise = 1.6 / n_steps, 1.4 / n_steps
    cuts = [half_space((-1, 0, 0), 0.8 - i * depth) & half_space((0, 0, -1), i * rise - 0.7) for i in range(1, n_steps)]
    return box((-0.8, -0.6, -0.7), (0.8, 0.6, 0.7)) - union(cuts)


def pipe() -> Solid:
    """Return a thick-walled tube with a chamfered end."""
    outside = (
        cylinder((0, 0, 0), 2, 0.7)
        & half_space((0, 0, 1), 0.7)
        & half_space((0, 0, -1), 0.7)
        & cone((0, 0, 1.2), 2, np.radians(45))
    )
    return outside - cylinder((0, 0, 0), 2, 0.4)


def gear(n_teeth: int = 10) -> Solid:
    """Return a gear with straight-sided teeth and a bore."""
    slots = []
    for angle in 2 * np.pi * np.arange(n_teeth) / n_teeth:
        outward = np.array([np.cos(angle), np.sin(angle), 0.0])
        across = np.array([-np.sin(angle), np.cos(angle), 0.0])
        half_width = 0.28 * 2 * np.pi * 0.8 / n_teeth
        slots.append(
            half_space(-outward, -0.72)
            & half_space(across - 0.25 * outward, half_width - 0.2)
            & half_space(-across - 0.25 * outward, half_width - 0.2)
        )
    disc = cylinder((0, 0, 0), 2, 0.98) & half_space((0, 0, 1), 0.28) & half_space((0, 0, -1), 0.28)
    return disc - union([*slots, cylinder((0, 0, 0), 2, 0.3)])


def bracket() -> Solid:
    """Return an L-shaped bracket with a bore in each leg and a rounded inner corner."""
    legs = blend([half_space((0, 0, 1), -0.35), half_space((1, 0, 0), -0.45)], 0.9)
    plate = box((-0.8, -0.5, -0.7), (0.8, 0.5, 0.8)) & legs
    return plate - cylinder((0.42, 0, 0), 2, 0.2) - cylinder((0, 0, 0.42), 0, 0.2)


def ring_groove() -> Solid:
    """Return a ball flattened at both ends with a round groove around its waist."""
    barrel = ball((0, 0, 0), 0.95) & half_space((0, 0, 1), 0.6) & half_space((0, 0, -1), 0.6)
    return barrel - torus((0, 0, 0), 2, 0.98, 0.22)
