"""Head of a result: commit, date, processor, versions, hash of what short runs give; and how pages tell it."""

import os
import platform
import subprocess
import sys
from datetime import date
from pathlib import Path

from taichi_mps import __version__
from taichi_mps.engine.runtime import workarounds
from taichi_mps.io.summary import commit

ROOT = Path(__file__).resolve().parents[1]
NUMERICS = "fingerprint"  # key of the hash: equal where the numerics are


def facts() -> dict:
    """Origin of a result: processor, load, versions, commit (with -dirty where files differ), date."""
    cpu = Path("/proc/cpuinfo")
    lines = cpu.read_text(encoding="utf-8").splitlines() if cpu.exists() else []
    models = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": models[0] if models else platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
        "system": platform.platform(),
        "python": platform.python_version(),
        "taichi": workarounds.VERSION,
        "taichi_mps": __version__,
        "commit": commit(ROOT),
        "date": date.today().isoformat(),
    }


def head(folder: Path) -> dict:
    """The facts and, for a file in benchmarks/ of a checkout, the hash of six exact fingerprints."""
    script = ROOT / "benchmarks" / "fingerprint.py"
    if not (script.is_file() and folder.resolve().is_relative_to(script.parent)):
        return facts() | {NUMERICS: None}
    done = subprocess.run([sys.executable, script, "--numerics"], stdout=subprocess.PIPE, text=True, check=True)
    return facts() | {NUMERICS: done.stdout.split()[-1]}


def origin(results) -> str:
    """Origin of results as a sentence: commits, dates and processors, and of how many no commit is kept."""
    heads = [result.get("machine") or {} for result in results]
    runs = sorted({(h["commit"], h["date"], h["processor"]) for h in heads if isinstance(h, dict) and h.get("commit")})
    texts = [f"commit {commit}, {day}, {processor}" for commit, day, processor in runs]
    if without := sum(not (isinstance(h, dict) and h.get("commit")) for h in heads):
        texts.append(f"no commit is kept of {without} of {len(heads)} results")
    return f"*Made with: {'; '.join(texts)}.*"


def between(text: str, name: str, block: str) -> str:
    """A page with this block between the marks of a command."""
    begin, end = (f"<!-- {word} {name} -->" for word in ("written by", "end of"))
    before, rest = text.split(begin)
    return f"{before}{begin}\n\n{block}\n\n{end}{rest.split(end)[1]}"
