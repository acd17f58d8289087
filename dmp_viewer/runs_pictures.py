"""Small pictures of runs: made off the GUI thread when somebody looks at a run, and kept in the user's cache folder.

Not in the run folder: it may be on a read-only disk or of somebody else, and a picture that came with it would have to be
decoded on its word.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import platformdirs
from qtpy.QtCore import QBuffer, QIODevice, QObject, Signal
from qtpy.QtGui import QImage

from dmp.files import atomic_write_bytes
from dmp.run_upkeep import shape_of
from dmp.runs import Run
from dmp_viewer.background import Background
from dmp_viewer.colors import UpAxis
from dmp_viewer.runs_entries import RunRow
from dmp_viewer.tasks import up_axis_of
from dmp_viewer.thumbnails import thumbnail

_LOG = logging.getLogger(__name__)
# Of the list, in device-independent pixels; drawn for screens of twice the density.
WIDTH, HEIGHT = 84, 60
# Between light and dark grounds, so that one picture serves both themes.
_COLOR = (0.66, 0.74, 0.85)
_MOST_FILES = 500
Key = tuple[str, int | None]


def cache_folder() -> Path:
    """Return where the pictures are kept."""
    return platformdirs.user_cache_path("dmp-viewer", appauthor=False) / "runs"


class RunPictures(QObject):
    """Makes the pictures that are asked for, the newest wish first.

    Args:
        up: the axis that points up unless a file says otherwise, asked when a picture is made.
        parent: as usual.

    Signals:
        made: key of a picture that has come, (run id, step).
    """

    made = Signal(object)

    def __init__(self, up: Callable[[], str], parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._up = up
        self._background = Background(self)
        self._pictures: dict[Key, QImage | None] = {}
        self._wishes: dict[Key, RunRow] = {}
        self._is_working = False

    def picture(self, row: RunRow) -> QImage | None:
        """Return the picture of a run when it is there; otherwise it is made, and :attr:`made` tells."""
        key = (row.run_id, row.pictured_step)
        if key in self._pictures or not row.run_id:
            return self._pictures.get(key)
        self._wishes.pop(key, None)
        self._wishes[key] = row
        self._go_on()
        return None

    def forget_wishes(self) -> None:
        """Make none of the pictures that nobody looks at any more."""
        self._wishes.clear()

    def wait(self, seconds: float) -> bool:
        """Pump events until all pictures are made; tells whether that was reached in time."""
        return self._background.wait(seconds) and not self._wishes

    def close(self) -> None:
        """Make no more pictures."""
        self._wishes.clear()
        self._background.close()

    def _go_on(self) -> None:
        if self._is_working or not self._wishes:
            return
        key, row = self._wishes.popitem()
        default: UpAxis = "z" if self._up() == "z" else "y"
        self._is_working = True
        self._background.submit(
            "",
            lambda: make_picture(row, up_axis_of(row.input_path) or default),
            lambda image: self._on_made(key, image),
            lambda error: self._on_failed(key, error),
        )

    def _on_made(self, key: Key, image: QImage | None) -> None:
        self._is_working = False
        self._pictures[key] = image
        self.made.emit(key)
        self._go_on()

    def _on_failed(self, key: Key, error: Exception) -> None:
        _LOG.info("No picture of the run %s: %s", key[0], error)
        self._on_made(key, None)


def make_picture(row: RunRow, up: UpAxis) -> QImage:
    """Return the picture of a run, from the cache or drawn (raises :class:`dmp.errors.RunError`)."""
    step = row.pictured_step
    path = cache_folder() / f"{row.run_id}_{'input' if step is None else step}_{up}.png"
    cached = QImage()
    with suppress(OSError):
        cached.loadFromData(path.read_bytes(), "PNG")
    if not cached.isNull() and cached.width() == 2 * WIDTH:
        return cached
    pixels = thumbnail(shape_of(Run.open(row.folder), step), 2 * WIDTH, 2 * HEIGHT, _COLOR, up)
    height, width, _ = pixels.shape
    image = QImage(pixels.tobytes(), width, height, 4 * width, QImage.Format.Format_RGBA8888).copy()
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write_bytes(path, _png(image))
        _clear_oldest(path.parent)
    return image


def _png(image: QImage) -> bytes:
    buffer = QBuffer()
    buffer.open(QIODevice.OpenModeFlag.WriteOnly)
    image.save(buffer, "PNG")
    return bytes(buffer.data().data())


def _clear_oldest(folder: Path) -> None:
    files = sorted(folder.glob("*.png"), key=lambda path: path.stat().st_mtime)
    for path in files[: max(0, len(files) - _MOST_FILES)]:
        path.unlink(missing_ok=True)
