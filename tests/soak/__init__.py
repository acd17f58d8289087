"""Endurance checks: each part counts how often something that must never go wrong was tried, and how often it held.

The tests run every part at a small size; ``make soak`` runs them at full size and prints a table.
"""

from __future__ import annotations

from dataclasses import dataclass

# Modules of this folder, each with ``run(size, seed) -> Result`` and ``FULL_SIZE``.
PARTS = ["reading", "broken", "kills", "disks", "folders", "scales", "signals", "cycles", "clicking", "pace", "batch"]


@dataclass(frozen=True)
class Result:
    """What a part found.

    Attributes:
        name: what was tried, in a few words.
        passed: how often it held.
        total: how often it was tried.
        details: one sentence for each failure.
    """

    name: str
    passed: int
    total: int
    details: tuple[str, ...] = ()
