"""What the window remembers between two starts: layout, choices and recent files, in one small JSON file."""

from __future__ import annotations

import json
import logging
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, get_args

import platformdirs

from dmp.files import atomic_write_bytes
from dmp_viewer.colors import Quantity, Unit
from dmp_viewer.look import Shading

_LOG = logging.getLogger(__name__)
MOST_RECENT_FILES = 9


def default_path() -> Path:
    """Return where the choices are kept: the user's configuration folder."""
    return platformdirs.user_config_path("dmp-viewer", appauthor=False) / "window.json"


@dataclass
class Preferences:
    """Everything remembered. A file that is missing or damaged gives the defaults.

    Attributes:
        theme: ``auto``, ``light`` or ``dark``.
        geometry: place and size of the window, as Qt encodes it, base64.
        splitters: sizes of the parts of the window by name of the splitter.
        docks: where the list of runs is, as Qt encodes it, base64.
        recent: paths of meshes and runs opened lately, newest first; a list, because any character may occur in a name.
        servers: addresses of other computers where trainings were done, newest first.
        folder: where the last file was opened.
        quantity, range, unit: the colour policy.
        outliers: whether the colours cover every vertex.
        edges: draw the edges of the triangles.
        shading: ``flat`` or ``smooth``.
        up: the axis that points up, ``y`` or ``z``.
        orthographic: draw the meshes without perspective.
        keys: keys that are others than those of the table of actions, by name of the action; a person writes them, so
            :func:`dmp_viewer.keys.bindings` looks what can be used.
        log_axis: logarithmic axis of the curve.
        smoothing: strength of the curve's smoothing; 0 by default, because the prediction is an average over steps already, and
            a smoothed line has its minimum too late.
        show_panel: whether the run panel is open.
        show_curve: whether the curve is open.
        show_thumbnails: whether the timeline has small pictures.
        play_speed: snapshots per second when playing.
        pace: who comes first, ``smooth`` (the window) or ``fast`` (the training).
    """

    theme: str = "auto"
    geometry: str = ""
    splitters: dict[str, list[int]] = field(default_factory=dict)
    docks: str = ""
    recent: list[str] = field(default_factory=list)
    servers: list[str] = field(default_factory=list)
    folder: str = ""
    quantity: str = "magnitude"
    range: str = "step"
    unit: str = "edges"
    outliers: bool = False
    edges: bool = False
    shading: str = "flat"
    up: str = "y"
    orthographic: bool = False
    keys: dict[str, Any] = field(default_factory=dict)
    log_axis: bool = True
    smoothing: float = 0.0
    show_panel: bool = True
    show_curve: bool = True
    show_thumbnails: bool = True
    play_speed: int = 5
    pace: str = "smooth"

    def add_recent(self, path: Path) -> None:
        """Put a path at the top of the recent files."""
        text = str(path.absolute())
        self.recent = [text, *(other for other in self.recent if other != text)][:MOST_RECENT_FILES]

    def add_server(self, address: str) -> None:
        """Put the address of another computer at the top of those offered."""
        self.servers = [address, *(other for other in self.servers if other != address)][:MOST_RECENT_FILES]

    def existing_recent(self) -> list[Path]:
        """Return the recent files that are still there."""
        return [Path(text) for text in self.recent if Path(text).exists()]


_CHOICES: dict[str, tuple[str, ...]] = {
    "theme": ("auto", "light", "dark"),
    "quantity": get_args(Quantity),
    "range": ("step", "run"),
    "unit": get_args(Unit),
    "shading": get_args(Shading),
    "up": ("y", "z"),
    "pace": ("smooth", "fast"),
}


def load(path: Path) -> Preferences:
    """Read the remembered choices; what does not fit is replaced by its default, so that the window always starts."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return Preferences()
    except (OSError, ValueError, RecursionError) as error:
        _LOG.warning("%s cannot be read (%s); the defaults are used", path, error)
        return Preferences()
    preferences = Preferences()
    for item in fields(Preferences):
        value = values.get(item.name) if isinstance(values, dict) else None
        if _fits(item.name, value, getattr(preferences, item.name)):
            setattr(preferences, item.name, value)
    return preferences


def save(preferences: Preferences, path: Path) -> None:
    """Write the choices; a failure is logged only, because it must not stop anybody from leaving."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write_bytes(path, json.dumps(asdict(preferences), indent=2).encode())
    except OSError as error:
        _LOG.warning("%s cannot be written: %s", path, error)


def _fits(name: str, value: Any, default: Any) -> bool:
    if name in _CHOICES:
        return value in _CHOICES[name]
    if name in ("recent", "servers"):
        return isinstance(value, list) and all(isinstance(text, str) and "\0" not in text for text in value)
    if name == "splitters":
        return isinstance(value, dict) and all(
            isinstance(sizes, list) and all(isinstance(size, int) and 0 <= size < 100_000 for size in sizes)
            for sizes in value.values()
        )
    if isinstance(default, float):
        return isinstance(value, (int, float)) and not isinstance(value, bool) and 0 <= value <= 0.99
    if name == "play_speed":
        return type(value) is int and 1 <= value <= 1000
    return type(value) is type(default)
