"""Server of the page in a process of its own."""

import os
import re
import signal
import time
from contextlib import contextmanager
from pathlib import Path

from tests.support.child import begun

READY = 60.0  # [s] for the server to end, on a busy machine


@contextmanager
def serving(folder, quiet=True):
    """A server of the runs in a folder: its port and its process; at its end Ctrl-C, and no child is left. What it says
    on stderr is that alone or, of one that is not ``quiet``, no traceback that ends in a line of the package."""
    server = begun("-m", "taichi_mps", "app", "--port", "0", "--no-browser", "--folder", folder, cwd=folder)
    try:
        port = int(re.match(r"http://127\.0\.0\.1:(\d+)/", server.stdout.readline())[1])
        yield port, server
    finally:
        family = children(server.pid)
        server.send_signal(signal.SIGINT)
        told, said = server.communicate(timeout=READY)
    assert (told, server.returncode) == (f"The runs lie in {folder}\n", 130)
    raised = [re.findall(r'File "([^"]+)"', trace)[-1] for trace in said.split("Traceback")[1:]]
    assert not [file for file in raised if f"{os.sep}taichi_mps{os.sep}" in file], said[-900:]
    assert said == "taichi-mps: interrupted\n" or not quiet
    deadline = time.monotonic() + 2.0  # for what Python itself leaves to end by itself
    while left := [child for child in family if Path(f"/proc/{child}").exists()]:
        assert time.monotonic() < deadline, [Path(f"/proc/{child}/cmdline").read_text() for child in left]
        time.sleep(0.05)


def children(process: int) -> list[int]:
    """Processes that descend from one."""
    parents = {}
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            parents[int(status.parent.name)] = int(re.search(r"PPid:\s*(\d+)", status.read_text())[1])
        except OSError:  # gone meanwhile
            continue
    found = [child for child, parent in parents.items() if parent == process]
    return found + [grandchild for child in found for grandchild in children(child)]
