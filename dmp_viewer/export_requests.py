"""What can be exported, as the dialog offers it and as it is asked for. No widgets."""

from __future__ import annotations

from dataclasses import dataclass

from dmp.exports.animations import Plan
from dmp_viewer.export_scenes import PaneChoice, PictureWish


@dataclass(frozen=True)
class Offer:
    """What is there to be exported.

    Attributes:
        stem: of proposed file names.
        steps: the snapshots of the run on show, ascending; empty without a run.
        shown_step, kept_step: of these, None for none.
        pane_names: what the three panes show.
        color_name: what the colours show; empty for bare surfaces.
        screen_size: of the three panes on the screen, pixels.
        has_curve: whether a step was logged.
        no_mp4: why there is no MP4, empty when there is.
    """

    stem: str = "mesh"
    steps: tuple[int, ...] = ()
    shown_step: int | None = None
    kept_step: int | None = None
    pane_names: tuple[str, str, str] = ("Input", "Smoothed", "Predicted")
    color_name: str = ""
    screen_size: tuple[int, int] = (1200, 500)
    has_curve: bool = False
    no_mp4: str = ""

    @property
    def result_step(self) -> int | None:
        """The kept step, else the shown one."""
        return self.kept_step if self.kept_step is not None else self.shown_step


@dataclass(frozen=True)
class MeshRequest:
    """The mesh of a step. Attributes: the step, the suffix, whether to write what is known of each vertex, and colours."""

    step: int
    suffix: str = ".ply"
    has_attributes: bool = True
    has_colors: bool = False


@dataclass(frozen=True)
class PictureRequest:
    """A picture of the panes."""

    wish: PictureWish
    suffix: str = ".png"


@dataclass(frozen=True)
class AnimationRequest:
    """An animation of the panes."""

    wish: PictureWish
    plan: Plan
    suffix: str = ".gif"


@dataclass(frozen=True)
class CurveRequest:
    """The curve, with what is drawn in the window."""

    suffix: str = ".csv"


@dataclass(frozen=True)
class ReportRequest:
    """A report on a step."""

    step: int
    suffix: str = ".html"


Request = MeshRequest | PictureRequest | AnimationRequest | CurveRequest | ReportRequest

__all__ = [
    "AnimationRequest", "CurveRequest", "MeshRequest", "Offer", "PaneChoice", "PictureRequest", "ReportRequest", "Request",
]  # fmt: skip
