"""Where the cases of a study are computed: processes of this machine, the workers of Dask, Slurm (slurm.py)."""

import multiprocessing
import os
import re
import signal
import threading
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from importlib.util import find_spec

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
    if not find_spec("distributed"):
        raise SceneError(f"executor = {address}: needs distributed: pip install 'taichi-mps[cluster]'")
    from distributed import Client

    try:
        client = Client(address.replace("dask://", "tcp://"), timeout=10, set_as_default=False)
    except OSError as error:
        raise SceneError(f"executor = {address}: no scheduler answers there ({error})") from None
    with client:
        yield client.get_executor(pure=False)


def named(text: str, workers: int | None, folder):
    """A context manager that opens the executor of an address for a study's folder, and how many cases to hand it at
    once (None: all)."""
    if text == "local":
        workers = workers or os.cpu_count() or 1
        return lambda: processes(workers), workers
    if re.fullmatch(r"dask://[^\s/]+:\d{1,5}", text):
        return lambda: dask(text), workers
    if re.match(r"slurm://[^\s/?]", text):
        return lambda: slurm(text, folder, workers), workers
    raise SceneError(f"executor = {text}: must be {KINDS}")
