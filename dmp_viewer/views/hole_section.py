"""The part of the run panel that is about holes: the list, what happens to what was measured, and noise."""

from __future__ import annotations

from qtpy.QtCore import Signal
from qtpy.QtWidgets import QCheckBox, QFormLayout, QVBoxLayout, QWidget

from dmp.settings import DENOISE_TOO, Settings
from dmp_viewer.theme import Theme
from dmp_viewer.views.hole_list import HoleList

# Settings of the completion that are edited here.
HOLE_SETTINGS = ("known_vertices", "max_hole_edges")
_NOISE_TIP = "The mesh is noisy as well: take the prediction for all vertices, with the settings that remove noise."
# What of the settings tells that noise is removed as well; how long and how often belongs to every training.
_TELLING = tuple(name for name in DENOISE_TOO if name not in ("steps", "snapshot_every", "log_every", "hold_out", "preset"))


class HoleSection(QWidget):
    """Holes to fill, and how.

    Args:
        form: rows with the editors of :data:`HOLE_SETTINGS`.

    Signals:
        denoiseTooChosen: whether noise is to be removed as well.
    """

    denoiseTooChosen = Signal(bool)

    def __init__(self, form: QFormLayout, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.holes = HoleList(self)
        self.denoise_too = QCheckBox("Remove noise as well", self)
        self.denoise_too.setObjectName("denoise_too")
        self.denoise_too.setToolTip(f"<p>{_NOISE_TIP}</p>")
        self.denoise_too.clicked.connect(self.denoiseTooChosen)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 2, 0, 2)
        layout.setSpacing(8)
        layout.addWidget(self.holes)
        layout.addWidget(self.denoise_too)
        layout.addLayout(form)

    def set_settings(self, settings: Settings) -> None:
        """Show what the settings say about noise."""
        self.denoise_too.setChecked(is_denoising_too(settings))

    def set_locked(self, locked: bool) -> None:
        """Let what is to be filled be as it is."""
        self.holes.set_locked(locked)
        self.denoise_too.setEnabled(not locked)

    def set_theme(self, theme: Theme) -> None:
        """Take the colours of a theme."""
        self.holes.set_theme(theme)


def is_denoising_too(settings: Settings) -> bool:
    """Tell whether a completion removes noise as well."""
    return settings.task == "complete" and all(getattr(settings, name) == DENOISE_TOO[name] for name in _TELLING)
