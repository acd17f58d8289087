"""A step that matters, with the sentence that says why. No widgets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

MarkName = Literal["kept", "suggested", "held_out", "best", "bookmark", "reference"]


@dataclass(frozen=True)
class StepMark:
    """A step that matters.

    Attributes:
        name: by what it was found; no two marks but bookmarks share one.
        step: which one.
        label: two words for the curve.
        sentence: why it matters.
    """

    name: MarkName
    step: int
    label: str
    sentence: str
