"""One piece of work with one result, complete in itself: what any engine, here or elsewhere, can be given to do."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import asdict, dataclass
from typing import Any

from dmp.experiments.cases import Case
from dmp.settings import Settings, preset_value

# Settings that decide where and how fast something is computed, and not what.
_WITHOUT_EFFECT = ("device", "threads", "precision", "memory", "preset")
_SAID_OTHERWISE = (*_WITHOUT_EFFECT, "task", "steps", "seed")

# Very rough seconds for one vertex: in one training step of each kind, and in one search for the best parameters.
_SECONDS_PER_STEP = {"prior": 8e-6, "recorrupted": 2.5e-5, "made-up-holes": 2.5e-5}
_SLOWER = {"gcn": 1.0, "chebyshev": 1.3, "gmm": 5.0, "gmm-geometric": 5.0}
_SECONDS_TUNED = {"laplacian": 1e-3, "taubin": 1e-3, "hc_laplacian": 1e-3, "two_step": 5e-3}


@dataclass(frozen=True)
class Job:
    """A training, a filter, or the measuring of the input as it is.

    Attributes:
        case: what it works on.
        settings: of the training; None for the others.
        filter_name: one of :data:`dmp.filters.FILTERS`; None for the others.
        is_tuned: whether the parameters of the filter are chosen with the ground truth.
    """

    case: Case
    settings: Settings | None = None
    filter_name: str | None = None
    is_tuned: bool = False

    def description(self) -> dict[str, Any]:
        """Return all that decides the result, as plain values."""
        described: dict[str, Any] = {"case": self.case.description()}
        if self.settings is not None:
            values = asdict(self.settings)
            described["settings"] = {name: value for name, value in values.items() if name not in _WITHOUT_EFFECT}
        if self.filter_name is not None:
            described["filter"] = self.filter_name
            described["tuned"] = self.is_tuned
        return described

    @property
    def name(self) -> str:
        """A name for files: readable, and different for whatever gives another result."""
        digest = hashlib.sha256(json.dumps(self.description(), sort_keys=True).encode()).hexdigest()[:10]
        parts = [re.sub(r"[^\w.-]+", "-", self.case.name)[:40]]
        if self.settings is not None:
            parts += [self.settings.preset, self.settings.convolution, self.settings.predict, f"seed{self.settings.seed}"]
        elif self.filter_name is not None:
            parts += [self.filter_name, "tuned" if self.is_tuned else "default"]
        else:
            parts.append("input")
        return "_".join([*parts, digest])

    @property
    def title(self) -> str:
        """What is done, for a line of progress."""
        if self.settings is not None:
            chosen = self.settings
            kind = [f"preset {chosen.preset}"]
            for name, value in asdict(chosen).items():
                if name not in _SAID_OTHERWISE and value != preset_value(name, chosen.task, chosen.preset):
                    kind.append(f"{name.replace('_', ' ')} {value}")
            return f"{self.case.name}: {', '.join(kind)}, {chosen.steps} steps, seed {chosen.seed}"
        if self.filter_name is not None:
            return f"{self.case.name}: {self.filter_name} filter{', tuned' if self.is_tuned else ''}"
        return f"{self.case.name}: the input"

    @property
    def work(self) -> float:
        """About how long it takes, in seconds of some processor; only ratios of it mean anything."""
        size = self.case.n_vertices
        if self.settings is not None:
            chosen = self.settings
            seconds = _SECONDS_PER_STEP[chosen.method] * chosen.steps * size
            if chosen.method == "prior":
                seconds *= _SLOWER[chosen.convolution] * (4 / chosen.width_divisor) ** 1.4
            return 1 + seconds
        if self.filter_name is not None and self.is_tuned:
            return 1 + _SECONDS_TUNED.get(self.filter_name, 2e-2) * size
        return 1 + 2e-4 * size


def distinct(jobs: list[Job]) -> list[Job]:
    """Return the jobs without those that would give the same result as an earlier one, in their order."""
    found: dict[str, Job] = {}
    for job in jobs:
        found.setdefault(job.name, job)
    return list(found.values())
