"""Cost of a slider of the page: time of 50 moves of the preview, from 100 Pa on, and its memory.

python benchmarks/page_preview.py            # writes benchmarks/results/page_preview.md
python benchmarks/page_preview.py --print

Asks the resident process as the server does. Seconds from the request to the first picture and to the result, by the
clock and of the processor, and the resident memory of the process after each ten moves. The mixes are spread evenly
over the logarithms of 100 to 2000 Pa and 5 to 200 Pa s (Halton points).
"""

import argparse
import asyncio
import os
import re
import statistics
import time
from pathlib import Path

import points

from taichi_mps.app.resident import Resident

MOVES = 50
YIELD, VISCOSITY = (100.0, 2000.0), (5.0, 200.0)
RESULT = Path(__file__).parent / "results" / "page_preview.md"


def halton(k: int, base: int) -> float:
    """The k-th point of the sequence, from 0 to 1."""
    found, part = 0.0, 1.0 / base
    while k:
        k, digit = divmod(k, base)
        found, part = found + digit * part, part / base
    return found


def mixes() -> list[dict[str, str]]:
    """The mixes of the moves, as texts of the form."""

    def between(ends, part):
        return f"{ends[0] * (ends[1] / ends[0]) ** part:.3g}"

    return [
        {"yield_value": between(YIELD, halton(k, 2)), "plastic_viscosity": between(VISCOSITY, halton(k, 3))}
        for k in range(1, MOVES + 1)
    ]


def spent(process: int) -> tuple[float, float]:
    """Processor time [s] and resident memory [MB] of a process."""
    cells = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    memory = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{process}/status").read_text())[1]
    return 0.01 * (int(cells[11]) + int(cells[12])), 1e-3 * int(memory)


async def move(resident: Resident, values: dict) -> dict:
    """One move: seconds to the first picture and to the result, of the processor, and what was found."""
    begun, cpu, first, found = time.perf_counter(), None, None, {}
    if resident.alive:
        cpu = spent(resident.process.pid)[0]
    async for part in resident.ask({"test": "slump", "values": values}):
        if "x" in part and first is None:
            first = time.perf_counter() - begun
        found = part.get("result", found)
    after, memory = spent(resident.process.pid)
    return {
        "first": first,
        "wall": time.perf_counter() - begun,
        "cpu": after - (cpu or 0.0),
        "memory": memory,
        "slump": found["m"]["slump_m"][0],
    }


async def measured() -> tuple[dict, list[dict]]:
    """The first answer, which waits for the kernels, and the moves."""
    resident = Resident("preview")
    try:
        first = await move(resident, {"yield_value": "500"})
        return first, [await move(resident, values) for values in mixes()]
    finally:
        await resident.close()


def table(first: dict, moves: list[dict]) -> str:
    """Table of the measured times and memory as Markdown."""
    lines = ["| | median | worst |", "|---|---|---|"]
    for key, words in {
        "first": "first picture, by the clock",
        "wall": "result, by the clock",
        "cpu": "processor",
    }.items():
        values = [it[key] for it in moves]
        lines.append(f"| {words} [s] | {statistics.median(values):.2f} | {max(values):.2f} |")
    memory = ", ".join(f"{it['memory']:.0f}" for it in [first, *moves[9::10]])
    return "\n".join(
        [
            "# Preview of the page",
            "",
            f"`python benchmarks/page_preview.py` ({points.stamp()}): {MOVES} moves of the sliders over {YIELD[0]:g} "
            f"to {YIELD[1]:g} Pa and {VISCOSITY[0]:g} to {VISCOSITY[1]:g} Pa s, rings of 10 mm, to rest.",
            "",
            *lines,
            "",
            f"With {os.cpu_count()} cores and {os.getloadavg()[1]:.0f} programs at work in the last five minutes.",
            "",
            f"The first answer, with kernels that this machine has compiled before: {first['wall']:.1f} s. Resident "
            f"memory before, and after each ten moves: {memory} MB.",
            "",
        ]
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--print", action="store_true", help="write no file")
    text = table(*asyncio.run(measured()))
    print(text)
    if not parser.parse_args().print:
        RESULT.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
