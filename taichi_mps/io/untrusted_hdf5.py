"""Safe reading of HDF5 files of a run folder, which may come from anybody or be damaged."""

from contextlib import contextmanager

import h5py
import numpy as np

from ..units import SceneError

READ_ERRORS = (OSError, LookupError, ValueError, TypeError, AttributeError, RuntimeError, MemoryError)


@contextmanager
def readable(what: str, path):
    """Context in which any error of reading a file becomes one SceneError that names it."""
    try:
        yield
    except SceneError:
        raise
    except READ_ERRORS as error:
        reason = str(error).split("\n", 1)[0].split("(", 1)[0].strip() or type(error).__name__
        raise SceneError(f"{what} {path}: damaged or not one of taichi_mps ({reason})") from None


def demand(holds, message: str) -> None:
    """Raise ValueError, which ``readable`` tells with the file, unless what is demanded of its content holds."""
    if not holds:
        raise ValueError(message)


@contextmanager
def opened(path, what: str):
    """Context with an HDF5 file opened for reading."""
    with readable(what, path), h5py.File(path, "r", locking=False) as file:
        yield file


def own_member(group, name: str):
    """Member of a group; ValueError for a link, or for data that lie in another file."""
    linked = not isinstance(group.get(name, getlink=True), h5py.HardLink)
    elsewhere = linked or (isinstance(group[name], h5py.Dataset) and (group[name].is_virtual or group[name].external))
    demand(not elsewhere, f"{name} is not in the file")
    return group[name]


def numbers(group, name: str, rows=()) -> np.ndarray:
    """Read an array of numbers, or rows of it; refuse one that claims more data than the file stores, before
    reading."""
    dataset = own_member(group, name)
    demand(isinstance(dataset, h5py.Dataset) and dataset.dtype.kind in "fiub", f"{name} does not hold numbers")
    stored, room = dataset.id.get_storage_size(), dataset.dtype.itemsize * dataset.size
    demand(room <= stored, f"{name} claims {room} bytes and has {stored}")
    return dataset[rows]


def text(group, name: str) -> str:
    """Read a text from a dataset or an attribute."""
    if name in group.attrs:
        value = group.attrs[name]
    else:
        dataset = own_member(group, name)
        value = dataset[()] if dataset.shape == () else None  # an array may claim more than fits into memory
    value = value.decode("utf-8", "surrogateescape") if isinstance(value, bytes) else value
    demand(isinstance(value, str), f"{name} is not a text")
    return value
