"""Each part of the endurance checks at a size that fits the tests."""

from __future__ import annotations

import os

import pytest

from tests.soak import disks, folders, kills, scales

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a system that can fork")


@pytest.fixture(autouse=True)
def _no_waiting_for_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a killed process has written is in the system's hands; only a power failure needs the disk itself."""
    monkeypatch.setattr(os, "fsync", lambda _descriptor: None)


# A fork of a process with threads is safe here: the child leaves by itself, and uses one thread only.
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_kills(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kills, "CASES", kills.CASES[:1])
    result = kills.run(2, seed=1)
    assert result.details == ()
    assert result.passed == result.total >= 2


def test_folders() -> None:
    result = folders.run(15, seed=1)
    assert result.details == ()
    assert result.passed == result.total == 15


def test_scales() -> None:
    result = scales.run(3, seed=1)
    assert result.details == ()
    assert result.passed == result.total == 3


def test_disks() -> None:
    result = disks.run(2, seed=1)
    if not result.total:
        pytest.skip(result.details[0])
    assert result.details == ()
    assert result.passed == result.total == 2
