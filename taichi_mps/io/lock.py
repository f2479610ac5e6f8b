"""One writer in a folder: a lock of the operating system (filelock), which goes with its process, however that ends."""

import os
import platform
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from ..units import SceneError

NAME = "taichi_mps.lock"  # holds the process that writes, as text; of no meaning without the lock on it
PATIENCE = 0.2  # [s] for which the lock is tried: its last holder may be about to remove the file


@contextmanager
def held(folder):
    """Keep others from writing into a folder meanwhile, made if need be; SceneError that names who writes there
    already. Nobody is hindered to read. A folder that was made for this and stayed empty is removed."""
    folder = Path(folder)
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        with locked(folder / NAME):
            yield
    finally:
        with suppress(OSError):  # the first that is not empty ends it
            for path in made:
                path.rmdir()


@contextmanager
def locked(path, who="process"):
    """The lock that this file is, with the name of this process in it; SceneError where another has it."""
    folder, lock = path.parent, FileLock(path)
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            lock.acquire(timeout=PATIENCE, poll_interval=0.05 * PATIENCE)
        except Timeout:
            raise SceneError(f"out = {folder}: {holder(path)} is writing there; must be one at a time") from None
        except OSError as error:
            raise SceneError(f"out = {folder}: cannot be written ({error.strerror}); choose another folder") from None
        with suppress(OSError):  # Windows lets nobody write what is locked, not even its holder
            path.write_text(f"{who} {os.getpid()} of {platform.node()}")
        yield
    finally:
        with suppress(OSError):  # another has it, or Windows keeps what is open
            lock.acquire(timeout=0)  # had already, unless a signal came into the first try
            path.unlink()
        lock.release(force=True)


def holder(path) -> str:
    """Who wrote the text of a lock, as one line."""
    try:
        return " ".join(path.read_text(errors="replace")[:200].split()) or "another process"
    except OSError:
        return "another process"
