"""Where the cases of a study are computed: processes of this machine, Dask, Slurm, any concurrent.futures.Executor."""

import multiprocessing
import os
import signal
import threading
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from importlib.util import find_spec
from urllib.parse import parse_qsl, urlsplit

from ..quantity import SceneError

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


@contextmanager
def slurm(partition: str, settings: dict):
    """One Slurm job a case through submitit, or with the partition 'local' one process a case of this machine."""
    import submitit

    jobs = submitit.AutoExecutor("slurm-jobs", cluster="local" if partition == "local" else "slurm")
    jobs.update_parameters(
        cpus_per_task=1,
        **({} if partition == "local" else {"slurm_partition": partition}),
        **{name: int(value) if value.isdigit() else value for name, value in settings.items()},
    )
    with Jobs(jobs) as executor:
        yield executor


class Jobs(Executor):
    """submitit's jobs as concurrent.futures: its own futures cannot be waited for together."""

    def __init__(self, jobs, look_every: float = 1.0):
        self.jobs, self.look_every = jobs, look_every
        self.flying, self.over = {}, threading.Event()
        self.thread = threading.Thread(target=self._look, daemon=True)
        self.thread.start()

    def submit(self, function, /, *arguments, **keywords):
        future = Future()
        self.flying[self.jobs.submit(function, *arguments, **keywords)] = future
        return future

    def _look(self):
        while not self.over.wait(self.look_every):
            for job, future in list(self.flying.items()):
                if job.done():
                    del self.flying[job]
                    try:
                        future.set_result(job.result())
                    except Exception as error:  # of the job or of Slurm: whoever waits shall know
                        future.set_exception(error)

    def shutdown(self, wait=True, *, cancel_futures=False):
        self.over.set()
        for job in list(self.flying):
            job.cancel()


def named(text: str, workers: int):
    """A context manager that opens the executor of an address, and how many cases to hand it at once (None: all)."""
    parts = urlsplit(text)
    package = {"dask": "distributed", "slurm": "submitit"}.get(parts.scheme)
    if package and not find_spec(package):
        raise SceneError(f"executor = {text}: needs {package}: pip install 'taichi-mps[cluster]'")
    if text == "local":
        return lambda: processes(workers), workers
    if parts.scheme == "dask" and parts.netloc:
        return lambda: dask(parts.netloc), None
    if parts.scheme == "slurm" and parts.netloc:
        return lambda: slurm(parts.netloc, dict(parse_qsl(parts.query))), None
    raise SceneError(f"executor = {text}: must be {KINDS}")
