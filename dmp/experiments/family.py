"""The generated family with noise: thirty shapes with kinds and levels of noise in turn, made by this program alone."""

from __future__ import annotations

from dmp.experiments.cases import Case, clean_shape
from dmp.experiments.plan import Plan
from dmp.noise import NoiseKind

KINDS: tuple[NoiseKind, ...] = ("gaussian", "normal", "uniform")
LEVELS = (0.1, 0.2, 0.3, 0.45, 0.6)


def family() -> tuple[Case, ...]:
    """Return the noisy cases of the family; the kinds and levels take turns, the seed of the noise is 1."""
    from dmp.shapes.development import DEVELOPMENT_SHAPES

    return tuple(
        clean_shape(name).noisy(KINDS[number % len(KINDS)], LEVELS[number % len(LEVELS)], 1)
        for number, name in enumerate(DEVELOPMENT_SHAPES)
    )


def cases_of(plan: Plan) -> tuple[Case, ...]:
    """Return the cases of a plan; without any, the family."""
    return plan.denoising_cases() or family()
