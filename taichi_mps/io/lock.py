"""Lock of a run folder for one writer (filelock); the operating system releases it at any end of the process."""

import os
import platform
from contextlib import contextmanager, suppress

from filelock import FileLock, Timeout

from ..units import SceneError, regular_file, user_path

NAME = "taichi_mps.lock"  # file with the writing process as text, valid only while it is locked
LOCK_TIMEOUT = 0.2  # time for which the lock is tried [s]: its last holder may be about to remove the file


@contextmanager
def held(folder, name: str = NAME, who: str = "process"):
    """Context in which no other process can write into a folder, which is made if it is missing; SceneError that names
    the process that has the lock. Reading is not restricted. A folder made here that stays empty is removed."""
    folder = user_path(folder)
    path, made = folder / name, [new for new in (folder, *folder.parents) if not new.exists()]
    lock = FileLock(path)
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lock.acquire(timeout=LOCK_TIMEOUT, poll_interval=0.05 * LOCK_TIMEOUT)
        except Timeout:
            raise SceneError(f"out = {folder}: {holder(path)} is writing there; must be one at a time") from None
        except OSError as error:
            raise SceneError(f"out = {folder}: cannot be written ({error.strerror}); choose another folder") from None
        with suppress(OSError):  # on Windows a locked file cannot be written, not even by its holder
            path.write_text(f"{who} {os.getpid()} of {platform.node()}")
        yield
    finally:
        with suppress(OSError):  # another has it, or Windows keeps what is open
            lock.acquire(timeout=0)  # had already, unless a signal came into the first try
            path.unlink()
        lock.release(force=True)
        with suppress(OSError):  # the first that is not empty ends it
            for new in made:
                new.rmdir()


def writer(folder) -> int | None:
    """Number of the process that writes a run into a folder, which is named in the lock and has it open; None without
    one, or on a system without /proc."""
    path = (user_path(folder) / NAME).resolve()
    with suppress(OSError, ValueError, IndexError):
        process = int(regular_file("lock", path, 1000).read_text(errors="replace").split()[1])
        if any(os.readlink(opened) == str(path) for opened in user_path(f"/proc/{process}/fd").iterdir()):
            return process
    return None


def holder(path) -> str:
    """Text of a lock, which names its writer, on one line."""
    with suppress(OSError, ValueError):
        return " ".join(regular_file("lock", path, 1e4).read_text(errors="replace")[:200].split()) or "another process"
    return "another process"
