"""The table of phases that :func:`dmp.compiled.fused_kernels.run_phases` goes through."""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple, TypeAlias

import numpy as np

from dmp.compiled import fused_kernels as kernels
from dmp.compiled.phases import launch_parts


class Later(NamedTuple):
    """An address that is known at each run only: so many bytes behind what is called by this name."""

    name: str
    offset: int = 0


Value: TypeAlias = "int | Later"

_PLACES = {name: place for place, name in enumerate(kernels.FIELDS)}


class PhaseTable:
    """Phases, and where addresses that change from run to run belong."""

    def __init__(self, parts: int) -> None:
        """Begin a table whose phases are divided into so many ``parts`` each."""
        self.parts = parts
        self._phases: list[list[int]] = []
        self._later: dict[str, list[tuple[int, int, int]]] = defaultdict(list)
        self._kept: list[object] = []
        self._table: np.ndarray | None = None

    def add(self, kind: int, **values: Value) -> None:
        """Add a phase of a ``kind``, with ``values`` for some of its :data:`~dmp.compiled.fused_kernels.FIELDS`.

        Raises:
            ValueError: after :meth:`place`.
        """
        if self._table is not None:
            raise ValueError("The table has its addresses already.")
        phase = [0] * len(kernels.FIELDS)
        phase[_PLACES["kind"]] = kind
        for name, value in values.items():
            if isinstance(value, Later):
                self._later[value.name].append((len(self._phases), _PLACES[name], value.offset))
            else:
                phase[_PLACES[name]] = value
        self._phases.append(phase)

    def keep(self, *owners: object) -> None:
        """Keep alive what owns memory whose addresses stand in the table."""
        self._kept += owners

    def place(self, **addresses: int) -> None:
        """Write ``addresses`` for what is called by these names: all of them, and they stay until they are written anew.

        Raises:
            KeyError: when one is missing.
        """
        if self._table is None:
            self._table = np.array(self._phases, dtype=np.int64)
            self._where = {name: np.array(places, dtype=np.int64).T for name, places in self._later.items()}
        for name, (phases, slots, offsets) in self._where.items():
            self._table[phases, slots] = addresses[name] + offsets

    def run(self, threads: int | None = None) -> None:
        """Do all phases, on all threads of torch or so many of them, which changes no digit.

        Raises:
            ValueError: before :meth:`place`.
        """
        if self._table is None:
            raise ValueError("Nobody has said where things are.")
        launch_parts(kernels.run_phases, len(self._table), self.parts, self._table.ctypes.data, threads=threads)
