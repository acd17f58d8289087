from __future__ import annotations

import numpy as np
import pytest

from dmp.exports.color_tables import color_table
from dmp.quantities import QUANTITIES, Quantity


@pytest.mark.parametrize("quantity", list(QUANTITIES))
def test_the_colours_are_those_of_the_window(quantity: Quantity) -> None:
    pyqtgraph = pytest.importorskip("pyqtgraph")
    name = "CET-D1A" if QUANTITIES[quantity].is_signed else "viridis"
    window = pyqtgraph.colormap.get(name).getLookupTable(0.0, 1.0, 256, alpha=True, mode="byte")
    table = color_table(quantity)
    assert (table.shape, table.dtype) == ((256, 4), np.uint8)
    assert np.abs(table.astype(int) - window.astype(int)).max() <= 3
