"""One writer in a folder: a lock of the operating system, which goes with its process, however that ends."""

import os
import platform
from contextlib import contextmanager, suppress
from pathlib import Path

from ..units import SceneError

NAME = "taichi_mps.lock"  # holds the process that writes, as text; of no meaning without the lock on it
FAR = 1 << 30  # Windows locks bytes, which nobody else can read then: one behind the text


@contextmanager
def held(folder):
    """Keep others from writing into a folder meanwhile, made if need be; SceneError that names who writes there
    already. Nobody is hindered to read. A folder that was made for this and stayed empty is removed."""
    folder = Path(folder)
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            file = locked(folder / NAME)
        except OSError as error:
            raise SceneError(f"out = {folder}: cannot be written ({error.strerror}); choose another folder") from None
        with file:
            file.write(f"process {os.getpid()} of {platform.node()}".encode())
            file.flush()
            try:
                yield
            finally:
                with suppress(OSError):  # Windows keeps what is open
                    (folder / NAME).unlink()
    finally:
        with suppress(OSError):  # the first that is not empty ends it
            for path in made:
                path.rmdir()


def locked(path):
    """The file, made if need be, emptied and locked; SceneError where somebody else has locked it."""
    for _ in range(100):
        file = open(path, "a+b")  # noqa: SIM115  (closed by the caller)
        if not lock(file):
            file.seek(0)
            holder = " ".join(file.read(200).decode(errors="replace").split()) or "another process"
            file.close()
            raise SceneError(f"out = {path.parent}: {holder} is writing there; must be one at a time")
        if path.exists() and os.path.samestat(os.fstat(file.fileno()), os.stat(path)):
            break
        file.close()  # its last holder removed it after it was opened here
    file.truncate(0)
    return file


def lock(file) -> bool:
    """Lock an open file until it is closed: False where another has it. True, too, on a disk that knows no locks."""
    try:
        if os.name == "nt":
            import msvcrt

            file.seek(FAR)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:
        return True
    return True
