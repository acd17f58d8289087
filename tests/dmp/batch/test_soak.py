"""The endurance check of batches at a size that fits the tests."""

from __future__ import annotations

import pytest

from tests.soak import batch


def test_killed_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch, "KILL_EVERY_SECONDS", 1.0)
    monkeypatch.setattr(batch, "MOST_KILLS", 1)
    monkeypatch.setattr(batch, "STEPS", 200)
    result = batch.run(3, seed=1)
    assert result.passed == result.total == 3
    assert len(result.details) == 1
