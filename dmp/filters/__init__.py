"""Classical denoising filters, to compare with: one registry, default results, and the best parameters by a ground truth."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

# As in the package above: the registry is read by `--help`, which needs neither NumPy nor SciPy.
_HOME = {
    "FILTERS": "catalogue",
    "Filter": "catalogue",
    "FilterParameter": "catalogue",
    "filter_named": "catalogue",
    "filtered": "running",
    "TunedFilter": "tuning",
    "best_tuned": "tuning",
    "tuned": "tuning",
}

__all__ = ["FILTERS", "Filter", "FilterParameter", "TunedFilter", "best_tuned", "filter_named", "filtered", "tuned"]

if TYPE_CHECKING:
    from dmp.filters.catalogue import FILTERS, Filter, FilterParameter, filter_named
    from dmp.filters.running import filtered
    from dmp.filters.tuning import TunedFilter, best_tuned, tuned


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(importlib.import_module(f"dmp.filters.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'dmp.filters' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
