"""For which systems and Pythons the kernel languages have wheels, asked of the package index: writes the table of
docs/install.md.

python benchmarks/wheels.py            # a minute; needs pip 22.2 and the network
"""

import json
import subprocess
import sys
import tempfile
from datetime import date

import points

LANGUAGES = "taichi==1.7.4", "quadrants>=1.3.3,<2"
PYTHONS = "3.10", "3.11", "3.12", "3.13", "3.14"
GLIBC = range(17, 42)
SYSTEMS = {  # as pip names them
    "Linux x86-64": [f"manylinux_2_{minor}_x86_64" for minor in GLIBC],
    "Linux arm64": [f"manylinux_2_{minor}_aarch64" for minor in GLIBC],
    "macOS arm64": ["macosx_15_0_arm64"],
    "macOS x86-64": ["macosx_15_0_x86_64"],
    "Windows x86-64": ["win_amd64"],
    "Windows arm64": ["win_arm64"],
}


def wheel(package: str, tags: list[str], python: str) -> tuple[str, str] | None:
    """Version and system of the newest wheel of a package that pip finds; None without one."""
    wanted = [word for tag in tags for word in ("--platform", tag)] + ["--python-version", python]
    settings = "--dry-run --quiet --ignore-installed --ignore-requires-python --no-deps --only-binary=:all: --report=-"
    with tempfile.TemporaryDirectory() as folder:
        words = "-m", "pip", "install", package, *settings.split(), *wanted, "--target", folder
        done = subprocess.run([sys.executable, *words], capture_output=True, text=True)
    if done.returncode:
        if "No matching distribution found" not in done.stderr:
            raise RuntimeError(done.stderr)
        return None
    url = json.loads(done.stdout)["install"][0]["download_info"]["url"]
    _, version, _, _, system = url.rsplit("/", 1)[1].removesuffix(".whl").split("-")
    return version, system.split(".")[0]


def main() -> None:
    rows = []
    for system, tags in SYSTEMS.items():
        cells, built = [], {}
        for package in LANGUAGES:
            found = {python: got for python in PYTHONS if (got := wheel(package, tags, python))}
            versions = {version: [p for p in found if found[p][0] == version] for version, _ in found.values()}
            cells.append("; ".join(f"{v}: {pythons[0]} to {pythons[-1]}" for v, pythons in versions.items()) or "none")
            built |= dict.fromkeys(tag for _, tag in found.values())
        rows.append((system, *cells, ", ".join(built) or "-"))
    head = "system", *(f"{package}, for Python" for package in LANGUAGES), "built for"
    points.put("install.md", "wheels", f"{points.table(head, rows)}\n\n*Asked on {date.today()}.*")


if __name__ == "__main__":
    main()
