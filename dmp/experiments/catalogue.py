"""The experiments by name, with a sentence each; the modules are loaded when they are used."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType, ModuleType


@dataclass(frozen=True)
class Experiment:
    """One experiment.

    Attributes:
        name: as the command line knows it.
        sentence: what it shows.
        parts: the experiments that it consists of; empty for a single one.
    """

    name: str
    sentence: str
    parts: tuple[str, ...] = ()

    @property
    def module(self) -> ModuleType:
        """Its module, with ``jobs(plan)`` and ``report(plan, results, folder)``."""
        return importlib.import_module(f"dmp.experiments.{self.name.replace('-', '_')}")


_OF_THE_PAPER = (
    Experiment("denoising", "Figure 4, table 1: convolutions, positions against displacements, and classical filters."),
    Experiment("laplacian", "Figure 5: how the MAD goes on with and without the Laplacian term."),
    Experiment("completion", "Figures 6, 7: filled holes, and what the network makes of the filling."),
    Experiment("learning-curves", "Figure 8: how fast clean, weakly and strongly noisy meshes are learnt."),
    Experiment("smoothing", "Table 2: displacements from the input itself, its smoothed copy, or a sphere."),
)

EXPERIMENTS: Mapping[str, Experiment] = MappingProxyType(
    {
        item.name: item
        for item in (
            *_OF_THE_PAPER,
            Experiment("all", "All of the above.", tuple(item.name for item in _OF_THE_PAPER)),
            Experiment("development", "Not in the paper: preset best against tuned filters on thirty generated meshes."),
            Experiment("suggested-step", "Not in the paper: what the suggested step loses against the best one."),
        )
    }
)
