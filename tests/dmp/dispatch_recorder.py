"""A stand-in for CUDA graphs on a processor, as strict as they are."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from dmp.captured_step import Step

# What makes Python wait for a GPU, what has a size that only the GPU knows, and what brings a number of Python's into a tensor.
_REFUSED = {
    "aten::_local_scalar_dense",
    "aten::equal",
    "aten::is_nonzero",
    "aten::item",
    "aten::lift_fresh",
    "aten::masked_select",
    "aten::nonzero",
    "aten::_unique2",
}
_Operation = tuple[Any, tuple[Any, ...], dict[str, Any], Any]


class Refusing(TorchDispatchMode):
    """Refuses, in what runs within it, all that could not be recorded as a CUDA graph."""

    def __torch_dispatch__(self, func: Any, types: Any, args: tuple[Any, ...] = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        name = func._schema.name
        moves = name == "aten::_to_copy" and kwargs.get("device") is not None
        counts = name.startswith("aten::index") and any(tensor.dtype == torch.bool for tensor in _dense(args[1:2]))
        if name in _REFUSED or moves or counts:
            raise RuntimeError(f"operation not permitted when stream is capturing: {func}")
        return self.run(func, args, kwargs)

    def run(self, func: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        """Do a permitted operation."""
        return func(*args, **kwargs)


class _Noting(Refusing):
    """Notes each operation with its very tensors, and how all memory was that it has not made itself."""

    def __init__(self, fails_at: int | None) -> None:
        super().__init__()
        self.operations: list[_Operation] = []
        self._fails_at = fails_at
        self._before: dict[int, tuple[torch.UntypedStorage, torch.UntypedStorage]] = {}
        self._made: dict[int, Tensor] = {}

    def run(self, func: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        if self._fails_at is not None and len(self.operations) >= self._fails_at:
            raise RuntimeError(f"operation {self._fails_at} cannot be recorded")
        for tensor in _dense((args, kwargs)):
            storage = tensor.untyped_storage()
            if storage.data_ptr() not in self._made and storage.data_ptr() not in self._before:
                self._before[storage.data_ptr()] = (storage, storage.clone())
        result = func(*args, **kwargs)
        for tensor in _dense(result):
            if tensor.untyped_storage().data_ptr() not in self._before:
                self._made.setdefault(tensor.untyped_storage().data_ptr(), tensor)
        self.operations.append((func, args, kwargs, result))
        return result

    @torch.no_grad()
    def undo(self) -> None:
        """Put back what was there before, and spoil what was not: recording a CUDA graph computes nothing."""
        for storage, copy in self._before.values():
            storage.copy_(copy)
        for tensor in self._made.values():
            tensor.fill_(math.nan if tensor.is_floating_point() else 0)


class DispatchRecorder:
    """Records the operations of a step, forward and backward, with their tensors, and does the list again.

    Attributes:
        done, recorded, replayed, forgotten: how often each was asked for.
        n_operations: of the last recorded step.
    """

    def __init__(self, fails_at: int | None = None) -> None:
        """Make one; with ``fails_at`` the operation of that number cannot be recorded."""
        self.done = self.recorded = self.replayed = self.forgotten = 0
        self._fails_at = fails_at
        self._operations: list[_Operation] | None = None

    @property
    def n_operations(self) -> int:
        return len(self._operations or ())

    def do(self, step: Step) -> Mapping[str, Tensor]:
        self.done += 1
        return step()

    def record(self, step: Step) -> Mapping[str, Tensor]:
        self.recorded += 1
        noting = _Noting(self._fails_at)
        try:
            with noting:
                results = step()
        finally:
            noting.undo()
        self._operations = noting.operations
        return results

    @torch.no_grad()
    def replay(self) -> None:
        assert self._operations is not None, "replayed after it was forgotten"
        self.replayed += 1
        for func, args, kwargs, result in self._operations:
            if func._schema.is_mutable:
                func(*args, **kwargs)
            elif not _storages(result) & _storages((args, kwargs)):
                for place, value in zip(_dense(result), _dense(func(*args, **kwargs)), strict=True):
                    place.copy_(value)

    def forget(self) -> None:
        self.forgotten += 1
        self._operations = None


def _dense(tree: Any) -> Iterator[Tensor]:
    """Yield all tensors with memory of their own kind; of sparse matrices the values, because their structure never changes."""
    for leaf in tree_leaves(tree):
        if isinstance(leaf, Tensor):
            tensor = leaf if leaf.layout == torch.strided else leaf.values()
            if tensor.numel():
                yield tensor


def _storages(tree: Any) -> set[int]:
    return {tensor.untyped_storage().data_ptr() for tensor in _dense(tree)}


def refused(call: Callable[[], object]) -> str:
    """Return the words with which a call is refused, or an empty text where it is not."""
    try:
        with Refusing():
            call()
    except RuntimeError as error:
        return str(error)
    return ""
