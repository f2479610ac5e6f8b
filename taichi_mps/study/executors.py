"""Where the cases of a study are computed: processes of this machine, the workers of Dask, Slurm (slurm.py)."""

import multiprocessing
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from importlib.util import find_spec
from urllib.parse import parse_qsl, urlsplit

from ..units import SceneError
from .slurm import slurm

KINDS = "dask://HOST:PORT, slurm://PARTITION?timeout_min=60 or local"


@contextmanager
def processes(workers: int):
    """Processes of this machine, each with one thread; none survives this one."""
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), initializer=_live_with_the_parent)
    try:
        yield pool
        pool.shutdown()
    except BaseException:
        for process in list((pool._processes or {}).values()):  # 3.14 has terminate_workers for this
            process.terminate()
        pool.shutdown(wait=False, cancel_futures=True)
        raise


def _live_with_the_parent():
    """Ctrl-C is the parent's to answer; when the parent is killed, this process ends, too."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch():
        multiprocessing.parent_process().join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def dask(address: str):
    """The workers of a running scheduler: dask worker ADDRESS --nworkers N --nthreads 1."""
    from distributed import Client

    try:
        client = Client(f"tcp://{address}", timeout=10, set_as_default=False)
    except OSError as error:
        raise SceneError(f"executor = dask://{address}: no scheduler answers there ({error})") from None
    with client:
        yield client.get_executor(pure=False)


def named(text: str, workers: int | None, folder):
    """A context manager that opens the executor of an address for a study's folder, and how many cases to hand it at
    once (None: all)."""
    parts = urlsplit(text)
    if parts.scheme == "dask" and not find_spec("distributed"):
        raise SceneError(f"executor = {text}: needs distributed: pip install 'taichi-mps[cluster]'")
    if text == "local":
        workers = workers or os.cpu_count() or 1
        return lambda: processes(workers), workers
    if parts.scheme == "dask" and has_port(parts):
        return lambda: dask(parts.netloc), workers
    if parts.scheme == "slurm" and parts.netloc:
        return lambda: slurm(text, parts.netloc, dict(parse_qsl(parts.query)), folder), workers
    raise SceneError(f"executor = {text}: must be {KINDS}")


def has_port(parts) -> bool:
    """Does an address name a host and a port?"""
    try:
        return bool(parts.hostname and parts.port)
    except ValueError:  # no number, or none of a port
        return False
