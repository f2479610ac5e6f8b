"""Child processes of Python for tests."""

import os
import sys
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen, run

ROOT = Path(__file__).resolve().parents[2]


def child(*words, cwd=ROOT, **environment):
    """What Python with these words did; environment: with these variables, without those that are None."""
    place = os.environ | {"PYTHONPATH": str(ROOT)} | environment
    place = {name: value for name, value in place.items() if value is not None}
    return run([sys.executable, *map(str, words)], env=place, cwd=cwd, capture_output=True, text=True)


def begun(*words, cwd=ROOT, stdin=DEVNULL, stdout=PIPE, stderr=PIPE, **settings):
    """Python with these words, running."""
    command, place = [sys.executable, *map(str, words)], os.environ | {"PYTHONPATH": str(ROOT)}
    streams = {"stdin": stdin, "stdout": stdout, "stderr": stderr, "text": True, "errors": "backslashreplace"}
    return Popen(command, env=place, cwd=cwd, **streams, **settings)
