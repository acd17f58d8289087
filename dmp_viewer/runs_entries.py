"""What the list of runs says about each: read from the run folders off the GUI thread. No widgets."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from dmp.run_upkeep import changed_settings, kept_runs
from dmp.runs import Run
from dmp.settings import Settings
from dmp_viewer.views.setting_editors import PRESET_TEXTS, TASK_TEXTS, label

STATE_TEXTS = {
    "finished": "Finished", "stopped": "Stopped", "interrupted": "Interrupted", "failed": "Failed", "running": "Training",
    "waiting": "Not begun", "damaged": "Cannot be read",
}  # fmt: skip
# What a run is called by itself: its mesh and the minute of its beginning.
_OWN_NAME = re.compile(r"(.+), \d{4}-\d\d-\d\d \d\d:\d\d")
_MOST_CHANGES = 4


@dataclass(frozen=True)
class RunRow:
    """One run as the list tells it.

    Attributes:
        folder: where it lies.
        run_id: identifies it; empty for one that cannot be read.
        title: its name, without the date that it was given at first.
        mesh: name of the file it was trained on, or empty.
        settings_text: task, preset, steps, and what differs from the preset.
        differs_text: preset and what differs from it, and the task when it is not the usual one.
        state: one of the keys of :data:`STATE_TEXTS`.
        last_step: the highest step that is kept.
        steps: the step that it is to reach.
        kept_step: the step that a person chose, or None.
        created: when it was made, ISO 8601, or empty.
        size: vertices and faces.
        settings: how it was trained, None for one that cannot be read.
        input_path: the file it was trained on, as the run says.
        reason: why it failed or cannot be read.
    """

    folder: Path
    run_id: str = ""
    title: str = ""
    mesh: str = ""
    settings_text: str = ""
    differs_text: str = ""
    state: str = "damaged"
    last_step: int = 0
    steps: int = 0
    kept_step: int | None = None
    created: str = ""
    size: tuple[int, int] = (0, 0)
    settings: Settings | None = None
    input_path: Path | None = None
    reason: str = ""

    @property
    def can_be_opened(self) -> bool:
        """Whether there is something to show."""
        return self.state != "damaged"

    @property
    def can_be_continued(self) -> bool:
        """Whether there are steps left, and nobody trains it right now."""
        return self.state in ("stopped", "interrupted", "failed", "waiting") and self.last_step < self.steps

    @property
    def pictured_step(self) -> int | None:
        """The step that its small picture shows: the kept one, else the last; None for the input."""
        # The last step of a training moves on, faster than anybody needs pictures.
        if self.state in ("waiting", "running") and self.kept_step is None:
            return None
        return self.kept_step if self.kept_step is not None else self.last_step

    @property
    def state_text(self) -> str:
        """How far it is, in one line."""
        text = STATE_TEXTS[self.state]
        if self.state == "damaged":
            return text
        if self.state == "waiting":
            text += f", {self.steps:,} steps"
        else:
            whole = self.last_step >= self.steps
            text += f", {self.last_step:,} steps" if whole else f" at {self.last_step:,} of {self.steps:,}"
        return text if self.kept_step is None else f"{text}  ·  kept {self.kept_step:,}"

    @property
    def about_text(self) -> str:
        """What it was trained on, unless its title says so, and how; why it cannot be read, for one that cannot."""
        if self.state == "damaged":
            return self.reason.removeprefix(f"{self.folder}/")
        named = self.mesh and Path(self.mesh).stem != self.title
        return "  ·  ".join([*([self.mesh] if named else []), self.differs_text])

    @property
    def details(self) -> str:
        """Everything about it, in lines."""
        lines = [self.title, *([self.mesh] if self.mesh else []), *([self.settings_text] if self.settings_text else [])]
        lines.append(self.state_text)
        if self.size[0]:
            lines.append(f"{self.size[0]:,} vertices, {self.size[1]:,} faces")
        if self.created:
            lines.append(f"Made {self.created.replace('T', ' ')[:16]}")
        if self.reason:
            lines.append(self.reason)
        return "\n".join([*lines, str(self.folder)])

    @property
    def searched(self) -> str:
        """What the search looks at."""
        return f"{self.details}\n{self.input_path or ''}".casefold()


def matches(row: RunRow, search: str) -> bool:
    """Tell whether all words of a search occur in a row."""
    return all(word in row.searched for word in search.casefold().split())


def rows_of(folder: Path) -> list[RunRow]:
    """Return the runs in a folder, newest first, then what looks like one and cannot be read."""
    kept = kept_runs(folder)
    damaged = (RunRow(path, title=path.name, settings_text="", reason=reason) for path, reason in kept.unreadable)
    return [*map(row_of, kept.runs), *damaged]


def row_of(run: Run) -> RunRow:
    """Return what the list says about a run."""
    last, state = run.last_step, run.state
    if state == "stopped" and not run.snapshot_steps():
        state = "waiting"
    own = _OWN_NAME.fullmatch(run.name)
    return RunRow(
        folder=run.folder,
        run_id=run.run_id,
        title=own[1] if own else run.name,
        mesh=run.input_path.name if run.input_path is not None else "",
        settings_text=in_short(run.settings),
        differs_text=differing(run.settings),
        state=state,
        last_step=last,
        steps=run.settings.steps,
        kept_step=run.kept_step,
        created=run.created,
        size=run.mesh_size,
        settings=run.settings,
        input_path=run.input_path,
        reason=run.reason,
    )


def in_short(settings: Settings) -> str:
    """Return task, preset and steps, and what differs from the preset, in one line."""
    preset = PRESET_TEXTS.get(settings.preset, settings.preset)
    return "  ·  ".join([TASK_TEXTS[settings.task], preset, f"{settings.steps:,} steps", *_changes(settings)])


def differing(settings: Settings) -> str:
    """Return the preset and what differs from it; the task only when holes are filled, to save room."""
    task = [TASK_TEXTS[settings.task]] if settings.task == "complete" else []
    return "  ·  ".join([*task, PRESET_TEXTS.get(settings.preset, settings.preset), *_changes(settings)])


def day_text(created: str, now: datetime) -> str:
    """Return a date as short as it can be told: the time of today, the day of this year, the whole date."""
    try:
        made = datetime.fromisoformat(created).astimezone(now.tzinfo)
    except (ValueError, OverflowError, OSError):
        return ""
    if made.date() == now.date():
        return f"{made:%H:%M}"
    return f"{made.day} {made:%b}" if made.year == now.year else f"{made:%Y-%m-%d}"


def _changes(settings: Settings) -> list[str]:
    changes = [f"{label(name)} {_value(value)}" for name, value in changed_settings(settings).items()]
    if len(changes) > _MOST_CHANGES:
        changes[_MOST_CHANGES - 1 :] = [f"{len(changes) - _MOST_CHANGES + 1} more changed"]
    return changes


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, float) else str(value)
