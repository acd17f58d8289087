"""Times as people say them."""

from __future__ import annotations


def duration(seconds: float) -> str:
    """Return a time as a person says it: 8 s, 2 min 05 s, 1 h 20 min."""
    if seconds < 1:
        return "under 1 s"
    if seconds < 60:
        return f"{round(seconds)} s"
    if seconds < 3600:
        minutes, rest = divmod(round(seconds), 60)
        return f"{minutes} min {rest:02d} s"
    hours, rest = divmod(round(seconds / 60), 60)
    return f"{hours} h {rest:02d} min"
