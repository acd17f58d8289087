"""The options that several commands take, each with its help; the settings of a training come from their declaration."""

from __future__ import annotations

from dataclasses import field, fields, make_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Optional

from cyclopts import Group, Parameter

from dmp.formats.names import READABLE_FORMATS
from dmp.settings import SETTING_FIELDS, Settings, Task, choices, default_preset, preset_value, presets_for


def _setting_options(task: Task) -> Any:
    """Return a dataclass with one optional option for each setting; None stands for what the preset says."""
    options = []
    for name, item in SETTING_FIELDS.items():
        if name == "task":
            continue
        hint = _hint(name, str(Settings.__annotations__[name]))
        help_text = f"{item.metadata['help']} [{_values_by_preset(name, task)}]"
        options.append((name, Optional[hint], field(default=None, metadata={"help": help_text})))  # noqa: UP045
    # Named after this module: cyclopts takes a class of another module called "types" for a built-in one.
    made = make_dataclass(f"{task.capitalize()}Settings", options, kw_only=True, namespace={"__module__": __name__})
    made.__doc__ = "Settings of the training; each overrides the preset."
    return made


def _values_by_preset(name: str, task: Task) -> str:
    """Return the value that a setting has when nothing is said, and that of the presets where it differs.

    For example ``25; paper, paper-2021-04: 50; best: 10``.
    """
    usual = default_preset(task)
    if name == "preset":
        return usual
    by_value: dict[Any, list[str]] = {preset_value(name, task, usual): []}
    for preset in presets_for(task):
        if preset != usual:
            by_value.setdefault(preset_value(name, task, preset), []).append(preset)
    (first, _), *others = by_value.items()
    return "; ".join([_said(first), *(f"{', '.join(presets)}: {_said(value)}" for value, presets in others)])


def _said(value: Any) -> str:
    return ("off", "on")[value] if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def _hint(name: str, kind: str) -> Any:
    """Return the type of an option, for the setting ``name`` that is declared as ``kind``."""
    if allowed := choices(name):
        return Literal[allowed]
    if kind == "bool":
        # A preset may switch it on, so it takes both words.
        return Annotated[bool, Parameter(negative=f"--no-{name.replace('_', '-')}")]
    return {"int": int, "float": float, "str": str, "bool": bool}[kind]


_SETTINGS_GROUP = Group(
    "Settings", help="In brackets: the value when nothing is said, and the presets that have another.", sort_key=10
)
DenoiseSettings: Any = _setting_options("denoise")
CompleteSettings: Any = _setting_options("complete")
DenoiseOptions = Annotated[DenoiseSettings | None, Parameter(name="*", group=_SETTINGS_GROUP)]
CompleteOptions = Annotated[CompleteSettings | None, Parameter(name="*", group=_SETTINGS_GROUP)]

MeshPath = Annotated[Path, Parameter(help=f"Mesh file: {READABLE_FORMATS}.")]
OutPath = Annotated[Path, Parameter(name=["--output", "-o"], help="Where to write; the suffix chooses the format.")]
RunPath = Annotated[Path | None, Parameter(help="Run folder to write; a new one in your data folder by default.")]
ReportPath = Annotated[Path | None, Parameter(help="Write a JSON report here.")]
Quiet = Annotated[bool, Parameter(name=["--quiet", "-q"], help="Say nothing but errors.")]
Verbose = Annotated[bool, Parameter(name=["--verbose", "-v"], help="Say more.")]
AsJson = Annotated[bool, Parameter(name="--json", help="Print JSON.")]
Keep = Annotated[
    str, Parameter(help="Which step to save: auto (suggested without a ground truth), last, best (needs one), or a number.")
]

PLACE = Group("Where", help="By default on this computer.", sort_key=5)
Scheduler = Annotated[
    str, Parameter(group=PLACE, help="Address of a scheduler, such as tcp://127.0.0.1:8786; start one by 'dmp serve'.")
]
TlsFile = Annotated[Path | None, Parameter(group=PLACE, help="PEM file for an encrypted connection; all three are needed.")]


def given(options: Any) -> dict[str, Any]:
    """Return the settings that were named on the command line, without those left to the preset."""
    values = {} if options is None else {item.name: getattr(options, item.name) for item in fields(options)}
    return {name: value for name, value in values.items() if value is not None}
