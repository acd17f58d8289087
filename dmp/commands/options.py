"""The options that several commands take, each with its help; the settings of a training come from their declaration."""

from __future__ import annotations

from dataclasses import field, fields, make_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Optional

from cyclopts import Parameter

from dmp.settings import SETTING_FIELDS, Settings, choices


def _setting_options() -> Any:
    """Return a dataclass with one optional option for each setting; None stands for what the preset says."""
    hints = {item.name: item for item in fields(Settings)}
    options = []
    for name, item in SETTING_FIELDS.items():
        if name == "task":
            continue
        kind = Settings.__annotations__[name]
        allowed = _choices_hint(name, kind)
        default = hints[name].default
        also = " Without one: compact for denoise, best for complete." if name == "preset" else f" [compact: {default}]"
        help_text = item.metadata["help"] + also
        options.append((name, Optional[allowed], field(default=None, metadata={"help": help_text})))  # noqa: UP045
    # Named after this module: cyclopts takes a class of another module called "types" for a built-in one.
    made = make_dataclass("SettingOptions", options, kw_only=True, namespace={"__module__": __name__})
    made.__doc__ = "Settings of the training; each overrides the preset."
    return made


def _choices_hint(name: str, kind: Any) -> Any:
    allowed = choices(name)
    return Literal[allowed] if allowed else {"int": int, "float": float, "str": str}[str(kind)]


SettingOptions: Any = _setting_options()
TrainingOptions = Annotated[SettingOptions | None, Parameter(name="*", group="Settings")]

MeshPath = Annotated[Path, Parameter(help="Mesh file: OBJ, PLY, STL or OFF.")]
OutPath = Annotated[Path, Parameter(name=["--output", "-o"], help="Where to write; the suffix chooses the format.")]
RunPath = Annotated[Path | None, Parameter(help="Run folder to write; a new one in your data folder by default.")]
ReportPath = Annotated[Path | None, Parameter(help="Write a JSON report here.")]
Quiet = Annotated[bool, Parameter(name=["--quiet", "-q"], help="Say nothing but errors.")]
Verbose = Annotated[bool, Parameter(name=["--verbose", "-v"], help="Say more.")]
AsJson = Annotated[bool, Parameter(name="--json", help="Print JSON.")]
Keep = Annotated[
    str, Parameter(help="Which step to save: auto (suggested without a ground truth), last, best (needs one), or a number.")
]


def given(options: Any) -> dict[str, Any]:
    """Return the settings that were named on the command line, without those left to the preset."""
    values = {} if options is None else {item.name: getattr(options, item.name) for item in fields(options)}
    return {name: value for name, value in values.items() if value is not None}
