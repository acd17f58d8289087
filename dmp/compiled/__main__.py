"""Compiles all kernels now, so that no first training has to wait: ``python -m dmp.compiled``."""

from __future__ import annotations

import importlib
import pkgutil

import torch

import dmp.compiled
from dmp.compiled.kernel import Kernel


def all_kernels() -> list[Kernel]:
    """Return the kernels of all modules, for each type of rows that they are made for."""
    names = [module.name for module in pkgutil.iter_modules(dmp.compiled.__path__) if module.name.endswith("_kernels")]
    modules = [importlib.import_module(f"dmp.compiled.{name}") for name in sorted(names)]
    found = [value for module in modules for value in vars(module).values() if isinstance(value, Kernel)]
    return [*found, *(kernel.of(torch.bfloat16) for kernel in found if kernel.has_rows)]


def main() -> None:
    """Compile what is not kept yet."""
    for kernel in all_kernels():
        _ = kernel.address


if __name__ == "__main__":
    main()
