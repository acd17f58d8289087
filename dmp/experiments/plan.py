"""What a person asked an experiment for, and the jobs that follow from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from dmp.experiments.cases import Case
from dmp.experiments.jobs import Job
from dmp.filters import FILTERS
from dmp.noise import NoiseKind
from dmp.settings import Task, preset_value, presets_for, settings_for

# Weak and strong noise of the learning curves, in mean edge lengths: bumps show under the one and are buried by the other.
_WEAK, _STRONG = 0.2, 0.6


@dataclass(frozen=True)
class Plan:
    """What an experiment is to be done with.

    Attributes:
        cases: the meshes.
        seeds: of the trainings; each is done with all of them.
        preset: of Deep Mesh Prior.
        steps: of each training; None for as many as the preset says.
        filters: names of the rivals.
        changes: settings that differ from the preset in all trainings of Deep Mesh Prior.
        noise: kind of noise where an experiment adds some itself.
        levels: weak and strong noise of the learning curves.
        device: where to train.
    """

    cases: tuple[Case, ...]
    seeds: tuple[int, ...] = (42,)
    preset: str = "compact"
    steps: int | None = None
    filters: tuple[str, ...] = tuple(FILTERS)
    changes: Mapping[str, Any] = field(default_factory=dict)
    noise: NoiseKind = "gaussian"
    levels: tuple[float, float] = (_WEAK, _STRONG)
    device: str = "auto"

    def preset_for(self, task: Task) -> str:
        """The preset for a task: the one that was asked for, or the newer published one where that does not have it."""
        return self.preset if self.preset in presets_for(task) else "paper"

    def trainings(self, case: Case, *, preset: str | None = None, **settings: Any) -> tuple[Job, ...]:
        """Return one training of a case for each seed.

        Args:
            case: what to train on.
            preset: another preset than the plan's; it is then taken as it is, but never with more steps than the plan has.
            settings: that differ from the preset.

        Raises:
            SettingsError: for a value outside its range.
        """
        named = preset or self.preset_for(case.task)
        steps = self.steps
        if preset is not None and steps is not None:
            steps = min(steps, preset_value("steps", case.task, preset))
        elif preset is None:
            settings = {**self.changes, **settings}
        return tuple(
            Job(case, settings_for(case.task, named, seed=seed, device=self.device, **{"steps": steps, **settings}))
            for seed in self.seeds
        )

    def description(self, *, tells_weight: bool = True) -> str:
        """Return how Deep Mesh Prior was trained, in a sentence; the weight of the Laplacian term only where it was used."""
        usual = settings_for("denoise", self.preset_for("denoise"), **{"steps": self.steps, **self.changes})
        parts = [f"preset {usual.preset}", f"{usual.steps} steps"]
        parts.append(f"seed{'s' if len(self.seeds) > 1 else ''} {', '.join(map(str, self.seeds))}")
        if tells_weight:
            parts.append(f"λ = {usual.laplacian_weight:g} with the {usual.laplacian_form} form of the Laplacian term")
        told = ("laplacian_weight", "laplacian_form")
        parts += [f"{name.replace('_', ' ')} {value}" for name, value in self.changes.items() if name not in told]
        return f"Deep Mesh Prior: {', '.join(parts)}."

    def denoising_cases(self) -> tuple[Case, ...]:
        """The cases that are about noise; those with holes are left out."""
        return tuple(case for case in self.cases if case.task == "denoise")
