"""Server of the page in a process of its own."""

import re
import signal
import time
from contextlib import contextmanager
from pathlib import Path

from tests.support.child import begun

READY = 60.0  # [s] for the server to end, on a busy machine


@contextmanager
def serving(folder, token=""):
    """A server of the runs in a folder, with this token, or without one: its port and its process; at its end Ctrl-C,
    and no child is left. On stderr it says that alone."""
    words = "-m", "taichi_mps", "app", "--port", "0", "--no-browser", "--folder", folder, f"--token={token}"
    server = begun(*words, cwd=folder)
    try:
        query = f"\\?token={token} " * bool(token)
        yield int(re.match(rf"http://127\.0\.0\.1:(\d+)/{query}", server.stdout.readline())[1]), server
    finally:
        family = children(server.pid)
        server.send_signal(signal.SIGINT)
        told, said = server.communicate(timeout=READY)
    assert (told, server.returncode) == (f"The runs lie in {folder}\n", 130)
    assert said == "taichi-mps: interrupted\n"
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
