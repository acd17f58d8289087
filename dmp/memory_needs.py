"""What a training will take of memory, said before it begins: it fits, it takes a longer way, or it is refused."""

from __future__ import annotations

import bisect
import math

import torch

from dmp.compiled.packed_weights import packing_for
from dmp.devices import available_cores, choose_device, type_between_layers
from dmp.errors import SettingsError
from dmp.layers.stack_sizes import bytes_of_weights, bytes_of_whole_pass, bytes_per_vertex
from dmp.memory import free_memory, gigabytes, held_memory
from dmp.network import LAYOUTS
from dmp.settings import Settings, settings_for

# Bytes for each vertex beside the layers: mesh, base, sparse matrices, losses, what is shown; measured, see docs/benchmarks.md.
_BESIDE_LAYERS = 1_300
# What the other methods take for each vertex in all, measured likewise; the last keeps 150 sets of made-up holes, of which the
# measurement had made 3, and 12,000 bytes are added for the others.
_RECORRUPTED, _MADE_UP_HOLES = 7_000, 26_000
# Independent of the mesh: modules that are loaded late, weights, and the allocator's slack.
_IN_ANY_CASE = 200_000_000
# Automatic derivatives keep more between the layers than buffers do; a mixture has products for each of its kernels.
_PLAIN_LAYERS = 1.9
# Vertices of a patch without its halo, where the layers of the whole mesh find no room: as many as fit. The more, the less is
# computed twice.
_PATCHES = (200_000, 100_000, 50_000, 20_000)
LARGEST_PATCH = _PATCHES[0]
# A patch is longer than wide, and its border not straight: so much larger is its halo than that of a disc.
_LONGER_BORDER = 1.5
# Matrices of the patches, for each vertex of the mesh: seven numbers of a row, and some rows twice.
_MATRICES_OF_PATCHES = 130
# Part of the free memory that is counted on; other programs need some too.
_USABLE = 0.9


def memory_needed(settings: Settings, n_vertices: int, *, keep_outputs: bool = True) -> int:
    """Return the bytes that a training on the processor takes, beside what the process holds already.

    Args:
        settings: of the training.
        n_vertices: of the mesh.
        keep_outputs: see :class:`dmp.layers.stack_buffers.StackBuffers`; without meaning where there are none.
    """
    if settings.method == "recorrupted":
        each = float(_RECORRUPTED)
    elif settings.method == "made-up-holes":
        each = float(_MADE_UP_HOLES)
    else:
        each = _of_layers(settings, n_vertices, keep_outputs=keep_outputs) + _BESIDE_LAYERS
    return int(_IN_ANY_CASE + _of_threads(settings) + each * n_vertices)


def memory_needed_in_patches(settings: Settings, n_vertices: int, patch_vertices: int) -> int:
    """Return the bytes that a training takes whose gradients are found in patches (:mod:`dmp.patches`).

    Args:
        settings: of a training that can do so.
        n_vertices: of the mesh.
        patch_vertices: most vertices of a patch without its halo.
    """
    widths = LAYOUTS[settings.architecture].divided(settings.width_divisor).widths
    each = (
        bytes_of_whole_pass(widths, value_bytes=_type_between(settings, n_vertices).itemsize)
        + _BESIDE_LAYERS
        + _MATRICES_OF_PATCHES
    )
    core = min(n_vertices, patch_vertices)
    # A disc of N vertices, of an area of sqrt(3)/2 each, and a ring around it as wide as there are layers.
    radius = math.sqrt(core * math.sqrt(0.75) / math.pi)
    halo = _LONGER_BORDER * math.pi * (2 * radius + len(widths)) * len(widths) / math.sqrt(0.75)
    largest = min(n_vertices, core + halo)
    return int(
        _IN_ANY_CASE
        + _of_threads(settings)
        + each * n_vertices
        + _of_layers(settings, n_vertices, keep_outputs=False) * largest
    )


def patch_vertices_for(settings: Settings, n_vertices: int) -> int:
    """Return of how many vertices patches are where the layers of the whole mesh find no room; 0 where they do.

    The least there is, where nothing fits.
    """
    usable = usable_memory(settings)
    if usable is None or not _has_buffers(settings) or memory_needed(settings, n_vertices, keep_outputs=False) <= usable:
        return 0
    smaller = [size for size in _PATCHES if size < n_vertices]
    if not smaller:
        return 0
    return next((size for size in smaller if memory_needed_in_patches(settings, n_vertices, size) <= usable), smaller[-1])


def least_memory(settings: Settings, n_vertices: int) -> int:
    """Return the bytes that a training takes at least, on the longest way."""
    needed = memory_needed(settings, n_vertices, keep_outputs=False)
    if _has_buffers(settings) and n_vertices > _PATCHES[-1]:
        needed = min(needed, memory_needed_in_patches(settings, n_vertices, _PATCHES[-1]))
    return needed


def check_memory(settings: Settings, n_vertices: int) -> str | None:
    """Refuse a training that will not fit into what is free, or into ``settings.memory``.

    Returns:
        A sentence for the user where the training takes a longer way that they will notice; None otherwise.

    Raises:
        SettingsError: the text says how much is needed, how much there is, and what to do.
    """
    usable = usable_memory(settings)
    if usable is None:
        return None
    needed = least_memory(settings, n_vertices)
    if needed > usable:
        raise SettingsError(_refusal(settings, n_vertices, needed, usable))
    patch_vertices = patch_vertices_for(settings, n_vertices)
    if not patch_vertices:
        return None
    whole, less = (
        memory_needed(settings, n_vertices, keep_outputs=False),
        memory_needed_in_patches(settings, n_vertices, patch_vertices),
    )
    return (
        f"Training on all {n_vertices:,} vertices at once needs about {gigabytes(whole)}, more than there is. It is done in "
        f"patches of {patch_vertices:,} vertices, which needs about {gigabytes(less)} and takes longer."
    )


def has_room_for_outputs(settings: Settings, n_vertices: int) -> bool:
    """Return whether outputs of layers can be kept, see :class:`dmp.layers.stack_buffers.StackBuffers`."""
    usable = usable_memory(settings)
    return usable is None or memory_needed(settings, n_vertices) <= usable


def usable_memory(settings: Settings) -> float | None:
    """Return the bytes that a training may still take, or None where there is no telling or it is not the processor's."""
    if choose_device(settings.device).type != "cpu":
        return None
    free = free_memory()
    usable = None if free is None else free * _USABLE
    if settings.memory:
        allowed = settings.memory * 1e9 - held_memory()
        usable = allowed if usable is None else min(allowed, usable)
    return usable


def _of_layers(settings: Settings, n_vertices: int, *, keep_outputs: bool) -> float:
    """Return what the layers of Deep Mesh Prior take for each vertex, in a mesh of ``n_vertices``."""
    widths = LAYOUTS[settings.architecture].divided(settings.width_divisor).widths
    if not _has_buffers(settings):
        each = _PLAIN_LAYERS * bytes_per_vertex(settings.input_channels, widths)
        return each * (settings.gmm_kernels if settings.convolution.startswith("gmm") else 1)
    dtype = _type_between(settings, n_vertices)
    fused = packing_for(dtype) is not None
    return float(
        bytes_per_vertex(settings.input_channels, widths, value_bytes=dtype.itemsize, keep_outputs=keep_outputs, fused=fused)
    )


def _of_threads(settings: Settings) -> int:
    """Return what the threads need for themselves."""
    if not _has_buffers(settings):
        return 0
    widths = LAYOUTS[settings.architecture].divided(settings.width_divisor).widths
    return (settings.threads or available_cores()) * bytes_of_weights(settings.input_channels, widths)


def _type_between(settings: Settings, n_vertices: int) -> torch.dtype:
    widest = max(LAYOUTS[settings.architecture].divided(settings.width_divisor).widths)
    return type_between_layers(settings.precision, widest, n_vertices)


def _has_buffers(settings: Settings) -> bool:
    return settings.method == "prior" and settings.convolution == "gcn" and not settings.skip


def _refusal(settings: Settings, n_vertices: int, needed: int, usable: float) -> str:
    free = free_memory()
    is_bounded = settings.memory > 0 and (free is None or usable < free * _USABLE)
    left = f"--memory {settings.memory:g} leaves {gigabytes(max(0.0, usable))}"
    there = left if is_bounded else f"{gigabytes(free or 0)} are free"
    text = f"Training on {n_vertices:,} vertices with preset '{settings.preset}' needs about {gigabytes(needed)}; {there}."
    if is_bounded and (free is None or needed <= free * _USABLE):
        return f"{text} Use --memory {(needed + held_memory()) / 1e9 + 0.1:.1f} or more."
    if _compact_fits(settings, n_vertices, usable):
        return f"{text} Use --preset compact, which needs less."
    # The largest mesh that fits; what is needed grows with the mesh, but for a step of a few MB where bfloat16 begins.
    fitting = bisect.bisect_right(range(n_vertices), usable, key=lambda fewer: least_memory(settings, fewer)) - 1
    return f"{text} Close other programs, or reduce the mesh to {_rounded_down(max(0, fitting)):,} vertices or fewer."


def _compact_fits(settings: Settings, n_vertices: int, usable: float) -> bool:
    if settings.preset == "compact":
        return False
    other = settings_for(settings.task, "compact", memory=settings.memory, device=settings.device)
    return least_memory(other, n_vertices) <= usable


def _rounded_down(count: int) -> int:
    digits = max(0, len(str(count)) - 2)
    return count // 10**digits * 10**digits
