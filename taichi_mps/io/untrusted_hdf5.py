"""HDF5 files of a run folder, which may come from anybody or be damaged: read as data, and no more than they hold."""

from contextlib import contextmanager

import h5py
import numpy as np

from ..units import SceneError

DAMAGE = (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError, MemoryError)


@contextmanager
def guarded(what: str, path):
    """Whatever goes wrong with a file inside becomes one SceneError that names it."""
    try:
        yield
    except SceneError:
        raise
    except DAMAGE as error:
        reason = str(error).split("\n", 1)[0].split("(", 1)[0].strip() or type(error).__name__
        raise SceneError(f"{what} {path}: damaged or not one of taichi_mps ({reason})") from None


@contextmanager
def opened(path, what: str):
    """The HDF5 file, to be read."""
    with guarded(what, path), h5py.File(path, "r", locking=False) as file:
        yield file


def own(group, name: str):
    """A member of a group that lies in the same file: ValueError for a link or data that lie elsewhere."""
    linked = not isinstance(group.get(name, getlink=True), h5py.HardLink)
    if linked or (isinstance(group[name], h5py.Dataset) and (group[name].is_virtual or group[name].external)):
        raise ValueError(f"{name} is not in the file")
    return group[name]


def numbers(group, name: str, rows=()) -> np.ndarray:
    """Array of numbers, or rows of it. Refuses what claims to hold more than is stored in the file, before reading."""
    dataset = own(group, name)
    if not isinstance(dataset, h5py.Dataset) or dataset.dtype.kind not in "fiub":
        raise ValueError(f"{name} does not hold numbers")
    stored, room = dataset.id.get_storage_size(), dataset.dtype.itemsize * dataset.size
    if room > stored:
        raise ValueError(f"{name} claims {room} bytes and has {stored}")
    return dataset[rows]


def text(group, name: str) -> str:
    """A text of a dataset or an attribute."""
    if name in group.attrs:
        value = group.attrs[name]
    else:
        dataset = own(group, name)
        value = dataset[()] if dataset.shape == () else None  # an array may claim more than fits into memory
    value = value.decode("utf-8", "surrogateescape") if isinstance(value, bytes) else value
    if not isinstance(value, str):
        raise ValueError(f"{name} is not a text")
    return value
