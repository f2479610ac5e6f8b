"""Cache folder for compiled kernels: in the home folder, or a temporary one where the home cannot be written. Without a
cache folder Taichi ends the process."""

import atexit
import os
import shutil
import sys
import tempfile
import warnings
from pathlib import Path

from ...units import plain

KERNELS = {"taichi": "TI_OFFLINE_CACHE_FILE_PATH", "quadrants": "QD_OFFLINE_CACHE_FILE_PATH"}
CACHES = "XDG_CACHE_HOME"


def set_cache_folders(language: str) -> None:
    """Set the cache folder of the kernel language, before its import, for this process and its children. A folder that
    the user has set stays if it can be written."""
    home = Path(os.path.expanduser("~"))
    home = home if home.is_absolute() else Path("/nonexistent")  # the home is unknown
    if sys.platform == "win32":  # where the language would make a folder beside C:/Windows
        os.environ[KERNELS[language]] = str(kernels(language))
    elif os.name == "posix":
        os.environ["HOME"] = str(home)
    if writable(kernels(language)):
        return
    chosen = os.environ.get(KERNELS[language]) or os.environ.get(CACHES)
    folder = tempfile.mkdtemp(prefix="taichi_mps-")
    atexit.register(remove, folder, language)
    os.environ[KERNELS[language]] = os.path.join(folder, "kernels")
    warnings.warn(
        f"{plain(chosen or home)} cannot be written, so compiled kernels are not kept for the next run", stacklevel=2
    )


def kernels(language: str) -> Path:
    """Cache folder of compiled kernels: where the language keeps them, too."""
    caches = os.environ.get(CACHES) or Path(os.path.expanduser("~"), ".cache")
    return Path(os.environ.get(KERNELS[language]) or Path(caches, language))


def remove(folder: str, language: str) -> None:
    """Remove a temporary cache folder at the end of the process, after the language has written into it."""
    if language in sys.modules:
        sys.modules[language].reset()
    shutil.rmtree(folder, ignore_errors=True)


def writable(folder: Path) -> bool:
    """Whether files can be written in a folder, which is made if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
