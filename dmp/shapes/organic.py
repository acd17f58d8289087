"""Smooth organic shapes: limbs and blobs melted together."""

from __future__ import annotations

import numpy as np

from dmp.mesh import FloatArray
from dmp.shapes.solids import Solid, ball, blend, ellipsoid, round_cone, torus, tube, turned


def dinosaur() -> Solid:
    """Return a little dinosaur that looks towards +x: one smooth piece, with a row of rounded plates on its back."""
    spine = [
        (-1.12, 0.14, -0.20),
        (-0.88, 0.06, -0.32),
        (-0.60, 0, -0.22),
        (-0.14, 0, 0.0),
        (0.2, 0, 0.03),
        (0.42, 0, 0.30),
        (0.56, 0, 0.54),
    ]
    radii = [0.06, 0.10, 0.19, 0.34, 0.29, 0.17, 0.15]
    trunk = [round_cone(a, b, r, s) for a, b, r, s in zip(spine[:-1], spine[1:], radii[:-1], radii[1:], strict=True)]
    head = [ellipsoid((0.64, 0, 0.60), (0.25, 0.19, 0.18)), ellipsoid((0.82, 0, 0.53), (0.15, 0.13, 0.11))]
    legs = [
        round_cone((-0.24, 0.20, -0.14), (-0.26, 0.27, -0.52), 0.19, 0.115),
        round_cone((-0.26, 0.27, -0.54), (-0.17, 0.28, -0.57), 0.115, 0.105),
        round_cone((0.24, 0.17, -0.10), (0.26, 0.23, -0.52), 0.15, 0.10),
        round_cone((0.26, 0.23, -0.54), (0.34, 0.24, -0.57), 0.10, 0.095),
    ]
    body = blend([*trunk, *head, *_mirrored(legs)], 0.12)
    eyes = _mirrored([ball((0.69, 0.145, 0.70), 0.065)])
    # Middle, tilt in radians (positive leans backwards), half-width and half-height of each plate, from the tail on.
    plates = [
        _plate((-0.86, 0.05, -0.22), 0.3, 0.085, 0.10),
        _plate((-0.64, 0.0, -0.04), 0.5, 0.11, 0.14),
        _plate((-0.40, 0.0, 0.19), 0.4, 0.14, 0.18),
        _plate((-0.09, 0.0, 0.33), 0.1, 0.155, 0.20),
        _plate((0.19, 0.0, 0.36), 0.3, 0.125, 0.15),
        _plate((0.32, 0.0, 0.53), 0.9, 0.10, 0.11),
        _plate((0.46, 0.0, 0.74), 0.7, 0.085, 0.10),
    ]
    return blend([body, *plates, *eyes], 0.06)


def _plate(middle: tuple[float, float, float], tilt: float, half_width: float, half_height: float) -> Solid:
    return turned(ellipsoid(middle, (half_width, 0.055, half_height)), middle, 1, -tilt)


def _mirrored(parts: list[Solid]) -> list[Solid]:
    """Return ``parts`` and their mirror images across the plane y = 0."""
    flip = np.array([1.0, -1.0, 1.0])

    def mirrored(part: Solid) -> Solid:
        return Solid.smooth(lambda p: part.value(p * flip))

    return [*parts, *(mirrored(part) for part in parts)]


def blob(seed: int, n_balls: int = 14) -> Solid:
    """Return balls of random size and place melted into one smooth lump."""
    rng = np.random.default_rng(seed)
    balls = [ball((0.0, 0.0, 0.0), 0.45)]
    for _ in range(n_balls):
        direction = rng.standard_normal(3)
        direction = direction / np.sqrt((direction**2).sum())
        radius = rng.uniform(0.16, 0.28)
        balls.append(ball(direction * (0.4 + radius * rng.uniform(0.0, 0.8)), radius))
    return blend(balls, 0.2)


def jug() -> Solid:
    """Return a round-bellied body with a neck and a handle: one smooth piece of genus 1."""
    body = [ellipsoid((-0.2, 0, -0.3), (0.62, 0.62, 0.52)), round_cone((-0.2, 0, 0.1), (-0.2, 0, 0.65), 0.28, 0.33)]
    return blend([*body, torus((0.25, 0, 0.15), 1, 0.42, 0.11)], 0.12)


def knot() -> Solid:
    """Return a trefoil knot of round wire: one smooth piece of genus 1."""
    t = 2 * np.pi * np.arange(96) / 96
    course = 0.33 * np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -1.3 * np.sin(3 * t)], axis=1)
    return tube(course, 0.15)


def wrinkled_ball(seed: int = 0, height: float = 0.05) -> Solid:
    """Return a ball whose radius varies by about ``height`` with 12 plane waves of random direction: detail all over."""
    rng = np.random.default_rng(seed)
    waves = rng.standard_normal((12, 3))
    waves = waves / np.sqrt((waves**2).sum(axis=1, keepdims=True)) * rng.uniform(6.0, 14.0, (12, 1))
    phases = rng.uniform(0.0, 2 * np.pi, 12)

    def value(p: FloatArray) -> FloatArray:
        radius = np.sqrt((p**2).sum(axis=1))
        directions = p / np.maximum(radius, 1e-9)[:, None]
        ripple = np.zeros(len(p))
        for wave, phase in zip(waves, phases, strict=True):
            ripple += np.sin((directions * wave).sum(axis=1) + phase)
        return radius - 0.9 - height * ripple / np.sqrt(6.0)

    return Solid.smooth(value)
