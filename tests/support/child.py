"""Python in a process of its own."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def child(*words, cwd=ROOT, **environment):
    """What Python with these words did; environment: with these variables, without those that are None."""
    place = os.environ | {"PYTHONPATH": str(ROOT)} | environment
    place = {name: value for name, value in place.items() if value is not None}
    return subprocess.run([sys.executable, *words], env=place, cwd=cwd, capture_output=True, text=True)
