"""How much memory there is, and the refusal of what does not fit into it."""

import os
from pathlib import Path

from .units import SceneError

UNLIMITED = 1 << 60  # [bytes] from here on a limit of a control group is none


def memory(root: str = "/") -> int | None:
    """Bytes that this process has and may still take: of the machine, or of its control group (cgroup, versions 1 and
    2) if that has less left. None on a system that does not say. ``root``: where /proc and /sys are."""
    root = Path(root)
    machine = {words[0]: 1024 * int(words[1]) for words in table(root / "proc/meminfo")}
    if "MemAvailable:" not in machine:
        return None
    pages = int((root / "proc/self/statm").read_text().split()[1])
    left = [machine["MemAvailable:"], *(limit - used for limit, used in control_groups(root))]
    return min(left) + pages * os.sysconf("SC_PAGE_SIZE")


def control_groups(root: Path):
    """(limit, used) [bytes] of the control groups of this process that bound its memory; what the system can drop from
    its cache is not used."""
    files = {"": ("memory.max", "memory.current", "inactive_file")}
    files["memory"] = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
    for words in table(root / "proc/self/cgroup", ":"):
        kinds, path = words[1].split(","), Path(words[2].lstrip("/"))
        for kind in set(kinds) & set(files):
            limit, used, cache = files[kind]
            top = root / "sys/fs/cgroup" / kind
            for folder in (top / path, *(top / parent for parent in path.parents)):
                dropped = {row[0]: int(row[1]) for row in table(folder / "memory.stat")}.get(cache, 0)
                sizes = [row[0] for name in (limit, used) for row in table(folder / name)]
                if len(sizes) == 2 and sizes[0] != "max" and int(sizes[0]) < UNLIMITED:
                    yield int(sizes[0]), int(sizes[1]) - dropped


def table(path: Path, separator: str | None = None) -> list[list[str]]:
    """The lines of a file of the system as words; none where there is no such file."""
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
