"""How much memory there is, and how much a training will take: told beforehand, because nobody likes to be stopped midway."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

_PROC = Path("/proc")
_CGROUPS = Path("/sys/fs/cgroup")
# A limit of this size or more is how the older kind of control group says that there is none.
_NO_LIMIT = 1 << 60


def peak_memory() -> int:
    """Return the largest memory that this process has held so far, bytes; 0 where the system does not say."""
    # Linux's other number, below, is at least that of the process that started this one.
    with contextlib.suppress(OSError, ValueError):
        for line in (_PROC / "self" / "status").read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return 1024 * int(line.split()[1])
    if sys.platform == "win32":
        return 0
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # In kilobytes, but on a Mac in bytes.
    return peak if sys.platform == "darwin" else 1024 * peak


def held_memory() -> int:
    """Return how many bytes of memory this process holds now, 0 where the system does not say."""
    with contextlib.suppress(OSError, ValueError, IndexError):
        return int((_PROC / "self" / "statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return 0


def free_memory() -> int | None:
    """Return how many bytes this process can still take without the system running out, or None where nobody says.

    That is the least of what the system has left, what the control groups of this process (a container's limit) leave, and
    what its own limit (``ulimit -v``) leaves.
    """
    found = [amount for amount in (_free_in_system(), _free_in_groups(), _free_in_own_limit()) if amount is not None]
    return max(0, min(found)) if found else None


def _free_in_system(proc: Path = _PROC) -> int | None:
    with contextlib.suppress(OSError, ValueError):
        for line in (proc / "meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return 1024 * int(line.split()[1])
    if sys.platform == "win32":
        return _free_in_windows()
    # Elsewhere only the whole is known; half of it is a fair guess of what is left.
    with contextlib.suppress(OSError, ValueError, AttributeError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    return None


def _free_in_windows() -> int | None:
    import ctypes

    class Status(ctypes.Structure):
        _fields_ = (
            ("length", ctypes.c_ulong),
            ("load", ctypes.c_ulong),
            *((name, ctypes.c_ulonglong) for name in ("whole", "free", "f", "g", "v", "w", "x")),
        )

    status = Status(length=ctypes.sizeof(Status))
    kernel = getattr(ctypes, "windll").kernel32  # noqa: B009  # there is none for a type checker on other systems
    return int(status.free) if kernel.GlobalMemoryStatusEx(ctypes.byref(status)) else None


def _free_in_groups(proc: Path = _PROC, root: Path = _CGROUPS) -> int | None:
    """Return what the tightest control group around this process leaves; caches that the system can drop count as free."""
    try:
        lines = (proc / "self" / "cgroup").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return None
    left: list[int] = []
    for line in lines:
        _, _, rest = line.partition(":")
        controllers, _, name = rest.partition(":")
        if controllers and "memory" not in controllers.split(","):
            continue
        top = root / "memory" if controllers else root
        names = ("memory.limit_in_bytes", "memory.usage_in_bytes") if controllers else ("memory.max", "memory.current")
        # Inside a container the name is that of the machine outside, and the group itself lies at the top.
        folder = top / name.lstrip("/")
        for group in (folder, *folder.parents):
            if group != top and top not in group.parents:
                break
            limit, used = (_number(group / part) for part in names)
            if limit is not None and used is not None and limit < _NO_LIMIT:
                left.append(limit - used + _droppable(group / "memory.stat"))
    return min(left) if left else None


def _number(path: Path) -> int | None:
    try:
        return int(path.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def _droppable(path: Path) -> int:
    with contextlib.suppress(OSError, ValueError):
        for line in path.read_text(encoding="ascii").splitlines():
            name, _, value = line.partition(" ")
            if name in ("inactive_file", "total_inactive_file"):
                return int(value)
    return 0


def _free_in_own_limit(proc: Path = _PROC) -> int | None:
    if sys.platform == "win32":
        return None
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return None
    try:
        used = int((proc / "self" / "statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        return None
    return limit - used


def gigabytes(amount: float) -> str:
    """Return bytes as a person would say them, such as ``9 GB`` or ``0.4 GB``; 1 GB are 10^9 bytes."""
    value = amount / 1e9
    return f"{value:.0f} GB" if value >= 9.5 else f"{value:.1f} GB"
