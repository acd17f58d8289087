"""The command line of the window."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from dmp import settings as method
from dmp_viewer.tasks import TASKS

ThemeChoice = Literal["auto", "light", "dark"]


@dataclass(frozen=True)
class Arguments:
    """What was asked for on the command line; ``None`` means "not said"."""

    path: Path | None = None
    ground_truth: Path | None = None
    task: str = "denoise"
    start: bool = False
    steps: int | None = None
    preset: str | None = None
    seed: int | None = None
    snapshot_every: int | None = None
    device: str | None = None
    check: bool = False
    reset_settings: bool = False
    screenshot: Path | None = None
    at_step: int | None = None
    theme: ThemeChoice | None = None
    size: tuple[int, int] | None = None
    config: Path | None = None
    list_bindings: bool = False

    @property
    def overrides(self) -> dict[str, int | str | None]:
        """The settings that were given, for :func:`dmp.settings.settings_for`."""
        return {"steps": self.steps, "seed": self.seed, "snapshot_every": self.snapshot_every, "device": self.device}


def version_text() -> str:
    """Return the versions that a bug report needs, read from package metadata without importing anything."""
    lines = []
    for package, label in (
        ("dmp-viewer", "dmp-viewer"), ("torch", "torch"), ("PySide6-Essentials", "Qt (PySide6)"), ("vtk", "VTK"),
        ("pyvista", "pyvista"), ("pyvistaqt", "pyvistaqt"), ("pyqtgraph", "pyqtgraph"), ("numpy", "numpy"),
    ):  # fmt: skip
        try:
            lines.append(f"{label} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            lines.append(f"{label} (no package information)")
    return "\n".join(lines)


class _Version(argparse.Action):
    """Print the versions as they are: argparse would join the lines."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(version_text())
        parser.exit()


def _size(text: str) -> tuple[int, int]:
    width, separator, height = text.lower().partition("x")
    if not separator or not width.isdecimal() or not height.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not a size such as 1280x800")
    return int(width), int(height)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="dmp-viewer",
        description="Watch a network learn one damaged mesh, choose the step to keep, and save it.",
        epilog="Without a display, `dmp denoise MESH -o OUT` does the same work on the command line.",
    )
    parser.add_argument("path", nargs="?", type=Path, metavar="MESH|RUN", help="mesh file or run folder to open")
    parser.add_argument("--ground-truth", type=Path, metavar="GT", help="clean mesh with the same faces, to measure against")
    parser.add_argument("--task", choices=TASKS, default="denoise", help="what to do (default: %(default)s)")
    parser.add_argument("--start", action="store_true", help="start training at once")
    parser.add_argument("--steps", type=int, metavar="N", help="training steps")
    parser.add_argument("--preset", choices=method.choices("preset"), help="settings to begin with")
    parser.add_argument("--seed", type=int, metavar="N", help="seed of everything random")
    parser.add_argument("--snapshot-every", type=int, metavar="N", help="keep the predicted mesh every N steps")
    parser.add_argument("--device", metavar="DEVICE", help="auto, cpu, cuda or cuda:N")
    parser.add_argument(
        "--theme", choices=("auto", "light", "dark"), help="colours of the window (remembered by the View menu)"
    )
    parser.add_argument("--size", type=_size, metavar="WxH", help="size of the window in pixels, such as 1280x800")
    parser.add_argument("--screenshot", type=Path, metavar="PNG", help="save a picture of the whole window, then exit")
    parser.add_argument("--at-step", type=int, metavar="N", help="with --screenshot: train to step N (or show it) first")
    parser.add_argument("--check", action="store_true", help="tell whether the window can work on this machine, then exit")
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="remember choices and keys in FILE instead of the user's own (window.json)"
    )
    parser.add_argument("--list-bindings", action="store_true", help="list all actions with their names and keys, then exit")
    parser.add_argument("--reset-settings", action="store_true", help="forget window layout, recent files and choices")
    parser.add_argument("--version", action=_Version, nargs=0, dest=argparse.SUPPRESS, help="show versions, then exit")
    return parser


def parse(argv: Sequence[str] | None = None) -> Arguments:
    """Parse the command line; wrong usage ends the program with one line on stderr and exit code 2."""
    parser = _parser()
    values = vars(parser.parse_args(argv))
    if values["at_step"] is not None and values["screenshot"] is None:
        parser.error("--at-step says when to take a picture, so it needs --screenshot PNG.")
    if values["at_step"] is not None and values["at_step"] < 0:
        parser.error(f"--at-step is {values['at_step']}, but steps count from 0.")
    if values["path"] is None and (values["start"] or values["at_step"] is not None or values["ground_truth"] is not None):
        parser.error("--start, --ground-truth and --at-step need a mesh: dmp-viewer MESH …")
    if values["steps"] is not None and values["at_step"] is not None and values["at_step"] > values["steps"]:
        parser.error(f"--at-step {values['at_step']} comes after the last step ({values['steps']}).")
    return Arguments(**values)
