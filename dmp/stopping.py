"""When to stop without a ground truth: overfitting signals and the step that they suggest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dmp.mesh import FloatArray

# The signal is averaged over this share of the curve, and at least three points, before its minimum is taken.
_WINDOW_SHARE = 0.05
# So many standard errors above its lowest value the risk on held-out parts has risen.
_CLEARLY = 2.0
# As good as the lowest value is what is above it by no more than the signal scatters, or this part of it.
_AS_GOOD = 0.002
_MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True)
class Suggestion:
    """A step to keep, and why, in one sentence for the user.

    Attributes:
        step: one of the steps that can be kept.
        reason: the sentence.
        between: first and last logged step around it that are as good, where that can be told.
    """

    step: int
    reason: str
    between: tuple[int, int] | None = None


def suggest(curve: Sequence[Mapping[str, float]], steps: Sequence[int]) -> Suggestion | None:
    """Suggest one of ``steps`` from a training curve.

    The error of the held-out vertices is the true error plus the variance of the noise, as long as the noise of a vertex
    tells nothing about that of its neighbours (the idea of Noise2Self, Batson & Royer 2019). Where it stops falling, the
    network has begun to learn the noise. Without held-out vertices the last step is suggested.

    Args:
        curve: logged steps in ascending order, each with ``step`` and perhaps ``held_out_error``.
        steps: the steps that can be kept, ascending.

    Returns:
        The suggestion, or None when nothing has been kept yet.
    """
    candidates = [step for step in steps if step > 0]
    if not candidates:
        return Suggestion(steps[-1], "Nothing has been learnt yet.") if steps else None
    if any("held_out_excess" in row for row in curve):
        return _by_risk(curve, candidates)
    if any("position_loss" in row or "made_up_error" in row for row in curve):
        return Suggestion(candidates[-1], "The last step: this method does not overfit, so there is no step to choose.")
    if any("inserted_movement" in row for row in curve) and not any("held_out_error" in row for row in curve):
        return Suggestion(candidates[-1], "The last step: a completion only gets better until its inserted vertices rest.")
    points = [(row["step"], row["held_out_error"]) for row in curve if row["step"] > 0 and "held_out_error" in row]
    if 0 < len(points) < 5:
        return Suggestion(candidates[-1], "The last step: so few steps give nothing to judge by.")
    if not points:
        return Suggestion(candidates[-1], "The last step, because no vertices were held out to judge by.")
    where, error = np.array(points).T
    half = max(1, round(_WINDOW_SHARE * len(points) / 2))
    padded = np.pad(error, half, mode="edge")
    smooth = np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid")
    best = int(np.argmin(smooth))
    step = min(candidates, key=lambda candidate: abs(candidate - where[best]))
    if best >= len(points) - 1 - half:
        return Suggestion(step, "The error of the held-out vertices is still falling: more steps may give a better mesh.")
    first, last = _as_good(error, smooth, best)
    between = int(where[first]), int(where[last])
    lowest = f"The error of the held-out vertices is lowest around step {int(where[best])}"
    if first == last:
        return Suggestion(step, f"{lowest}.", between)
    return Suggestion(step, f"{lowest}; between {between[0]} and {between[1]} nothing gets better.", between)


def _as_good(error: FloatArray, smooth: FloatArray, best: int) -> tuple[int, int]:
    """Return the ends of the stretch around ``best`` where the smooth signal is about as low as there."""
    # The median, because the fall at the beginning is no scatter.
    scatter = _MAD_TO_SIGMA * float(np.median(np.abs(error - smooth)))
    high = np.flatnonzero(smooth > smooth[best] + max(scatter, _AS_GOOD * smooth[best]))
    return int(high[high < best].max(initial=-1)) + 1, int(high[high > best].min(initial=len(smooth))) - 1


def _by_risk(curve: Sequence[Mapping[str, float]], candidates: Sequence[int]) -> Suggestion:
    """Suggest the last step, unless the risk on held-out parts is clearly higher there than it was before."""
    last = next(row for row in reversed(curve) if "held_out_excess" in row)
    if last["held_out_excess"] < _CLEARLY:
        return Suggestion(candidates[-1], "The last step: the risk on vertices that the training never sees has not risen.")
    lowest = last["held_out_lowest_step"]
    step = min(candidates, key=lambda candidate: abs(candidate - lowest))
    return Suggestion(step, f"The risk on vertices that the training never sees was clearly lower at step {int(lowest)}.")
