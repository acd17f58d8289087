"""Kernels of several phases, each of which needs all that the one before it made: passes over a mesh.

A launch for each pass would cost as much as a pass over ten thousand faces. So the threads go through all phases in one launch:
each takes one part after the other, and waits, before it begins one, until all parts of the phase before are done. It waits for
threads that are at work only, so it does not matter how many there are.
"""

# Numba has no types for mypy, and its compiler reads signatures from values.
# mypy: ignore-errors
from __future__ import annotations

import ctypes
import sys
from contextlib import suppress

import torch
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from dmp.compiled.kernel import Kernel
from dmp.compiled.launching import launch
from dmp.compiled.pointers import row_function, take_next

# Where the arguments of such a kernel begin: before them come the number of the next part, the number of parts in a phase, the
# number of parts that are done, the number of phases, and what lets other threads have the processor.
FIRST_ARGUMENT = 5

# Fewer faces or vertices are not worth a second thread.
_LEAST_PART = 512
# Parts for each thread, so that one that is held up holds up little.
_PARTS = 2
_LOOKS = 2_000


def launch_phases(kernel: Kernel, phases: int, size: int, *arguments: int) -> None:
    """Run a kernel of so many phases over ``size`` faces or vertices on the threads of torch; see :func:`launch`."""
    threads = torch.get_num_threads()
    parts = 1 if threads == 1 else max(1, min(_PARTS * threads, size // _LEAST_PART))
    launch_parts(kernel, phases, parts, *arguments)


def launch_parts(kernel: Kernel, phases: int, parts: int, *arguments: int, threads: int | None = None) -> None:
    """Run a kernel of so many phases, each divided into so many ``parts``, on all threads of torch or so many of them."""
    launch(kernel, (0, phases, _give_way_at, *arguments), parts, threads)


@row_function
def next_part(job):
    """Return the number of the next phase and of the part of it that is to be done next; a phase below 0 is none.

    What returns it must call :func:`part_is_done` when it has done it.
    """
    ticket = take_next(job)
    if ticket >= job[1] * job[3]:
        return -1, 0
    phase = ticket // job[1]
    looks = 0
    while _done(job) < phase * job[1]:
        looks += 1
        if looks > _LOOKS and job[4] != 0:
            _call(job[4])
    return phase, ticket - phase * job[1]


@row_function
def share(part, parts, count):
    """Return the first of ``count`` things of a part, and the one after its last: whole fours."""
    fours = (count + 3) // 4
    return part * fours // parts * 4, (part + 1) * fours // parts * 4


@intrinsic
def part_is_done(typing_context, job):
    """Say that another part is done."""

    def generate(context, builder, signature, arguments):
        place = builder.gep(arguments[0], [ir.Constant(ir.IntType(64), 2)])
        builder.atomic_rmw("add", place, ir.Constant(ir.IntType(64), 1), "release")
        return context.get_dummy_value()

    return types.void(job), generate


@intrinsic
def _done(typing_context, job):
    def generate(context, builder, signature, arguments):
        place = builder.gep(arguments[0], [ir.Constant(ir.IntType(64), 2)])
        return builder.load_atomic(place, "acquire", 8)

    return types.int64(job), generate


@intrinsic
def _call(typing_context, address):
    def generate(context, builder, signature, arguments):
        kind = ir.FunctionType(ir.IntType(32), [])
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), [])
        return context.get_dummy_value()

    return types.void(types.int64), generate


def _find_give_way() -> int:
    """Return the address of the system's function that lets another thread run on this core; 0 where there is none."""
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL("kernel32" if sys.platform == "win32" else None)
        function = library.SwitchToThread if sys.platform == "win32" else library.sched_yield
        return ctypes.cast(function, ctypes.c_void_p).value or 0
    return 0


_give_way_at = _find_give_way()
