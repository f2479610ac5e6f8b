"""Available memory, and the refusal of a run that does not fit into it."""

import os
from pathlib import Path

from ..units import SceneError

CONTROL_GROUPS = {  # by kind, of version 2 and 1: files of limit and use, and the row of what the cache may drop
    "": ("memory.max", "memory.current", "inactive_file"),
    "memory": ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}
OF_LIMITS = {"Max address space": 0, "Max data size": 5}  # of a process (ulimit -v, -d): column of what is used


def memory(root: str = "/") -> int | None:
    """Bytes that this process has and may still take: of the machine, or of its control group (cgroup, versions 1 and
    2) if that has less left. None on a system that does not say. ``root``: where /proc and /sys are."""
    root = Path(root)
    machine = {words[0]: 1024 * int(words[1]) for words in table(root / "proc/meminfo")}
    if "MemAvailable:" not in machine:
        return None
    pages = int((root / "proc/self/statm").read_text().split()[1])
    left = [machine["MemAvailable:"], *left_of_groups(root), *left_of_limits(root)]
    return min(left) + pages * os.sysconf("SC_PAGE_SIZE")


def left_of_limits(root: Path = Path("/")):
    """Bytes that limits of the process itself leave to it, of its address space and its data."""
    used = table(root / "proc/self/statm")
    for words in table(root / "proc/self/limits"):
        column = OF_LIMITS.get(" ".join(words[:3]))
        if column is not None and words[3] != "unlimited":
            yield int(words[3]) - int(used[0][column]) * os.sysconf("SC_PAGE_SIZE")


def left_of_groups(root: Path):
    """Bytes that are left to each control group of this process that bounds its memory."""
    for _, kinds, path in table(root / "proc/self/cgroup", ":"):
        for kind in CONTROL_GROUPS.keys() & kinds.split(","):
            limit, used, cache = CONTROL_GROUPS[kind]
            inner = root / "sys/fs/cgroup" / kind / path.lstrip("/")
            for folder in (inner, *inner.parents):
                sizes = [row[0] for name in (limit, used) for row in table(folder / name)]
                if len(sizes) == 2 and sizes[0] != "max":
                    yield int(sizes[0]) - int(sizes[1]) + int(dict(table(folder / "memory.stat")).get(cache, 0))


def table(path: Path, separator: str | None = None) -> list[list[str]]:
    """Lines of a file of the system as words; none where there is no such file."""
    try:
        return [line.split(separator) for line in path.read_text().splitlines()]
    except OSError:
        return []


def admit(needed: float, what: str, remedy=lambda there: "") -> None:
    """SceneError, one line, where ``what`` needs more bytes than there are; ``remedy`` of what there is."""
    there = memory()
    if there is not None and needed > there:
        raise SceneError(f"{what} about {size(needed)} of memory, and {size(there)} are there{remedy(there)}")


def size(number: float) -> str:
    """Bytes as text: 1.2 GB, 350 MB."""
    return f"{1e-9 * number:.3g} GB" if number >= 1e9 else f"{1e-6 * number:.0f} MB"
