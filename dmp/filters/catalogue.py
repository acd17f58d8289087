"""Every filter with its name, its parameters and the values that a search tries; no mathematics, so that it loads at once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from dmp.errors import SettingsError

Value = int | float | str


@dataclass(frozen=True)
class FilterParameter:
    """One parameter of a filter.

    Attributes:
        name: as :func:`dmp.filters.filtered` takes it.
        default: its value where none is given; its type is that of the parameter.
        help: one phrase for people.
        grid: ascending values that a search tries; the default is among them.
        minimum: least value of a number.
        maximum: largest value of a number.
        choices: the words allowed for a parameter that is a word.
    """

    name: str
    default: Value
    help: str
    grid: tuple[Value, ...]
    minimum: float = 0.0
    maximum: float = math.inf
    choices: tuple[str, ...] = ()

    @property
    def range_text(self) -> str:
        """The allowed values in words."""
        if self.choices:
            return " or ".join(self.choices)
        unit = "a whole number" if isinstance(self.default, int) else "a number"
        limits = f"from {self.minimum:g}" + ("" if math.isinf(self.maximum) else f" to {self.maximum:g}")
        return f"{unit} {limits}"

    def checked(self, value: Any, filter_name: str) -> Value:
        """Return ``value`` as this parameter's type.

        Raises:
            SettingsError: when it is of another kind or outside the range.
        """
        is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        if self.choices:
            fits = value in self.choices
        elif isinstance(self.default, int):
            fits = is_number and value == int(value) and self.minimum <= value <= self.maximum
        else:
            fits = is_number and self.minimum <= value <= self.maximum
        if not fits:
            raise SettingsError(
                f"The parameter {self.name.replace('_', ' ')} of the filter {filter_name} must be {self.range_text}, "
                f"not {value}."
            )
        return type(self.default)(value)


@dataclass(frozen=True)
class Filter:
    """A classical filter; :func:`dmp.filters.filtered` runs it.

    Attributes:
        name: as commands and :data:`FILTERS` know it.
        title: for people.
        description: one sentence with its source.
        parameters: the first is the one that counts: steps, passes or iterations. The results for all counts come from
            one run, and a count of 0 gives the input.
        needs_meshlab: whether MeshLab does the work.
    """

    name: str
    title: str
    description: str
    parameters: tuple[FilterParameter, ...]
    needs_meshlab: bool = False

    @property
    def count(self) -> FilterParameter:
        """The parameter that counts."""
        return self.parameters[0]

    def checked(self, given: Mapping[str, Any]) -> dict[str, Value]:
        """Return all parameters, those not in ``given`` at their defaults.

        Raises:
            SettingsError: when ``given`` has a parameter that this filter doesn't know or a value outside its range.
        """
        known = [parameter.name for parameter in self.parameters]
        for name in given:
            if name not in known:
                raise SettingsError(
                    f"The filter {self.name} has no parameter {name.replace('_', ' ')}; it has "
                    f"{', '.join(other.replace('_', ' ') for other in known)}."
                )
        return {item.name: item.checked(given.get(item.name, item.default), self.name) for item in self.parameters}


def filter_named(name: str) -> Filter:
    """Return the filter of that name.

    Raises:
        SettingsError: when there is none.
    """
    if name not in FILTERS:
        raise SettingsError(f"There is no filter '{name}'. Choose one of {', '.join(FILTERS)}.")
    return FILTERS[name]


def _count(name: str, default: int, help_text: str, grid: Sequence[int], maximum: int = 10_000) -> FilterParameter:
    return FilterParameter(name, default, help_text, (0, *grid), 0, maximum)


def _vertex_steps(default: int, grid: tuple[int, ...]) -> FilterParameter:
    return FilterParameter("vertex_steps", default, "steps in which vertices follow the normals", grid, 1, 1000)


_ITERATIONS = (1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 40)


_ALL = (
    Filter(
        "laplacian",
        "Uniform Laplacian",
        "Each step moves every vertex to the mean of its neighbours: removes noise quickly, and shrinks and rounds the shape "
        "(Field 1988).",
        (
            _count("steps", 2, "number of steps", (*range(1, 11), 12, 15, 20, 30, 40, 60)),
            FilterParameter(
                "share", 1.0, "share of the way to the mean of the neighbours", (0.25, 0.5, 0.75, 0.9, 1.0), 0.0, 1.0
            ),
        ),
    ),
    Filter(
        "taubin",
        "Taubin",
        "Each pass smooths and then inflates, so that the shape doesn't shrink (Taubin 1995).",
        (
            _count("passes", 10, "number of passes", range(1, 61)),
            FilterParameter("shrink", 0.5, "share of the way to the mean of the neighbours, lambda", (0.5,), 0.0, 1.0),
            FilterParameter("inflate", 0.53, "share of the way back, -mu; a little more than lambda", (0.51, 0.53), 0.0, 1.1),
        ),
    ),
    Filter(
        "bilateral_normal",
        "Bilateral normal filtering",
        "Averages the normals of neighbouring faces, the more the nearer and the more alike they are, and lets the vertices "
        "follow: keeps sharp edges (Zheng et al. 2011).",
        (
            _count("iterations", 20, "number of normal iterations", _ITERATIONS),
            FilterParameter(
                "sigma",
                0.35,
                "difference of unit normals that counts as alike",
                (0.25, 0.35, 0.45, 0.6, 0.8, 1.0, 1.5),
                0.01,
                10.0,
            ),
            FilterParameter(
                "neighbourhood",
                "vertex",
                "whether faces that share a vertex or only those that share an edge are neighbours",
                ("vertex", "edge"),
                choices=("vertex", "edge"),
            ),
            _vertex_steps(20, (10, 20, 40, 80)),
        ),
    ),
    Filter(
        "guided_normal",
        "Guided normal filtering",
        "Like bilateral normal filtering, with likeness taken from the most consistent patch around each face: keeps sharp "
        "edges under stronger noise (Zhang et al. 2015).",
        (
            _count("iterations", 20, "number of iterations", _ITERATIONS),
            FilterParameter(
                "sigma",
                0.35,
                "difference of unit normals that counts as alike",
                (0.2, 0.35, 0.45, 0.6, 0.8),
                0.01,
                10.0,
            ),
            FilterParameter("radius", 2.0, "reach in mean distances of neighbouring face centres", (2.0, 3.0), 0.0, 10.0),
            _vertex_steps(10, (5, 10, 20)),
        ),
    ),
    Filter(
        "hc_laplacian",
        "HC Laplacian (MeshLab)",
        "Each step averages the neighbours and pushes back towards the old places, against shrinking (Vollmer et al. 1999).",
        (_count("steps", 3, "number of steps", range(1, 6), 100),),
        needs_meshlab=True,
    ),
    Filter(
        "two_step",
        "Two-step smoothing (MeshLab)",
        "Averages normals that differ by less than a threshold and fits the vertices to them (Belyaev and Ohtake 2003).",
        (
            _count("steps", 3, "number of steps", (2, 3, 5, 10), 100),
            FilterParameter(
                "threshold", 60.0, "largest angle of normals that are averaged, degrees", (30.0, 60.0, 90.0), 0, 180
            ),
            FilterParameter("normal_steps", 20, "averagings of the normals in each step", (10, 20), 1, 1000),
            _vertex_steps(20, (20,)),
        ),
        needs_meshlab=True,
    ),
)

FILTERS: Mapping[str, Filter] = MappingProxyType({item.name: item for item in _ALL})
