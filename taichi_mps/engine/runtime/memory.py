"""Available memory, and the refusal of runs that do not fit into it."""

import os
from pathlib import Path

from ...spelling import size
from ...units import SceneError

CONTROL_GROUPS = {  # by kind, of cgroup version 2 and 1: files of limit and use, and the row of reclaimable cache
    "": ("memory.max", "memory.current", "inactive_file"),
    "memory": ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}
PROCESS_LIMITS = {"Max address space": 0, "Max data size": 5}  # of ulimit -v, -d: column of /proc/self/statm


class ShortOfMemoryError(SceneError, MemoryError):
    """Error for a run that would not fit into the memory that is there now."""


def memory(root: str = "/") -> int | None:
    """Bytes that this process holds and may still take, from the machine, its control groups (cgroup, versions 1 and 2)
    and its own limits. None on a system without /proc/meminfo. ``root``: folder of /proc and /sys."""
    root = Path(root)
    machine = {words[0]: 1024 * int(words[1]) for words in table(root / "proc/meminfo")}
    if "MemAvailable:" not in machine:
        return None
    pages = int((root / "proc/self/statm").read_text().split()[1])
    left = [machine["MemAvailable:"], *left_by_control_groups(root), *left_by_process_limits(root)]
    return min(left) + pages * os.sysconf("SC_PAGE_SIZE")


def left_by_process_limits(root: Path = Path("/")):
    """Yield the bytes left to this process by its limits of address space and of data."""
    used = table(root / "proc/self/statm")
    for words in table(root / "proc/self/limits"):
        column = PROCESS_LIMITS.get(" ".join(words[:3]))
        if column is not None and words[3] != "unlimited":
            yield int(words[3]) - int(used[0][column]) * os.sysconf("SC_PAGE_SIZE")


def left_by_control_groups(root: Path):
    """Yield the bytes left in each control group of this process that has a memory limit."""
    for _, kinds, path in table(root / "proc/self/cgroup", ":"):
        for kind in CONTROL_GROUPS.keys() & kinds.split(","):
            limit, used, cache = CONTROL_GROUPS[kind]
            inner = root / "sys/fs/cgroup" / kind / path.lstrip("/")
            for folder in (inner, *inner.parents):
                sizes = [row[0] for name in (limit, used) for row in table(folder / name)]
                if len(sizes) == 2 and sizes[0] != "max":
                    yield int(sizes[0]) - int(sizes[1]) + int(dict(table(folder / "memory.stat")).get(cache, 0))


def table(path: Path, separator: str | None = None) -> list[list[str]]:
    """Lines of a system file, split into words; an empty list if there is no such file."""
    try:
        return [line.split(separator) for line in path.read_text().splitlines()]
    except OSError:
        return []


def require_available(needed: float, what: str, remedy=lambda available: "") -> None:
    """Raise a SceneError if ``what`` needs more bytes than are available; ``remedy(available)`` ends its message."""
    available = memory()
    if available is not None and needed > available:
        raise ShortOfMemoryError(
            f"{what} about {size(needed)} of memory, and {size(available)} are there{remedy(available)}"
        )
