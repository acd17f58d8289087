"""Settings under which steps are timed: without records between."""

from __future__ import annotations

from typing import Any

from dmp.devices import available_cores
from dmp.settings import Settings, settings_for

# More steps than are ever timed, and more than lie between two records.
_NEVER = 10**6


def for_timing(preset: str, threads: int, **overrides: Any) -> Settings:
    """Return the settings of a preset of denoising for timing: float32 on the processor, but for ``overrides``.

    Args:
        preset: its name.
        threads: processor threads; 0 for all.
        overrides: of single settings.
    """
    values = {
        "threads": threads or available_cores(),
        "device": "cpu",
        "precision": "float32",
        "steps": _NEVER,
        "log_every": _NEVER,
        "snapshot_every": _NEVER,
    }
    return settings_for("denoise", preset, **{**values, **overrides})
