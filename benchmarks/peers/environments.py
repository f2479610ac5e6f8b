"""Virtual environments of the peers: their places, how they are made, and what a peer's script does in one."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HOME = Path("~/.cache/taichi_mps_peers").expanduser()


@dataclass(frozen=True)
class Peer:
    script: str  # beside this file
    program: str | None = None  # a system program it needs; none: it has a virtual environment
    particles: bool = True  # or cells


PEERS = {
    "newton": Peer("newton_slump.py"),
    "openfoam": Peer("openfoam_slump.py", "interFoam", particles=False),
    "pysph": Peer("pysph_dam.py"),
    "splishsplash": Peer("splishsplash_dam.py"),
}


def folder(name: str) -> Path:
    """The virtual environment of a peer: TAICHI_MPS_PEER_NAME, or its default place."""
    return Path(os.environ.get(f"TAICHI_MPS_PEER_{name.upper()}", HOME / name))


def where(name: str) -> Path | None:
    """The Python that runs a peer's script, or None if the peer is not installed."""
    program = PEERS[name].program
    if program:
        return Path(sys.executable) if shutil.which(program) else None
    python = folder(name) / "bin" / "python"
    return python if (folder(name) / "installed").exists() and python.exists() else None


def make_environment(name: str, packages: tuple[str, ...]) -> None:
    """A virtual environment with these packages."""
    subprocess.run([sys.executable, "-m", "venv", str(folder(name))], check=True)
    subprocess.run([str(folder(name) / "bin" / "python"), "-m", "pip", "install", *packages], check=True)
    (folder(name) / "installed").write_text("\n".join(packages) + "\n", encoding="utf-8")


def main(name: str, packages: tuple[str, ...], simulate) -> None:
    """What the script of a peer does: ``install``, or CASE.json OUT.npz by its function ``simulate``."""
    if sys.argv[1:] == ["install"]:
        make_environment(name, packages)
    else:
        case, out = sys.argv[1:]
        np.savez(out, **simulate(json.loads(Path(case).read_text(encoding="utf-8"))))
