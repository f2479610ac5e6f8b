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
import time
from pathlib import Path

import numpy as np
import points
from scipy.stats import qmc

from taichi_mps.app.resident import Resident

MOVES = 50
YIELD, VISCOSITY = (100.0, 2000.0), (5.0, 200.0)


def mixes() -> list[dict[str, str]]:
    """The mixes of the moves, as texts of the form."""
    low, high = np.log([YIELD, VISCOSITY]).T
    parts = qmc.Halton(2, scramble=False).random(MOVES + 1)[1:]
    named = "yield_value", "plastic_viscosity"
    return [
        {name: f"{x:.3g}" for name, x in zip(named, mix, strict=True)} for mix in np.exp(low + (high - low) * parts)
    ]


def spent(process: int) -> tuple[float, float]:
    """Processor time [s] and resident memory [MB] of a process."""
    cells = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    memory = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{process}/status").read_text())[1]
    return 0.01 * (int(cells[11]) + int(cells[12])), 1e-3 * int(memory)


async def move(resident: Resident, values: dict) -> dict:
    """One move: seconds to the first picture and to the result, of the processor, and what was found."""
    begun, first, found = time.perf_counter(), None, {}
    cpu = spent(resident.process.pid)[0] if resident.alive else 0.0
    async for part in resident.ask({"test": "slump", "values": values}):
        if "x" in part and first is None:
            first = time.perf_counter() - begun
        found = part.get("result", found)
    after, memory = spent(resident.process.pid)
    return {
        "first": first,
        "wall": time.perf_counter() - begun,
        "cpu": after - cpu,
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
    told = {"first": "first picture, by the clock [s]", "wall": "result, by the clock [s]", "cpu": "processor [s]"}
    values = {words: [it[key] for it in moves] for key, words in told.items()}
    lines = [[words, f"{np.median(each):.2f}", f"{max(each):.2f}"] for words, each in values.items()]
    memory = ", ".join(f"{it['memory']:.0f}" for it in [first, *moves[9::10]])
    return "\n".join(
        [
            "# Preview of the page",
            "",
            f"`python benchmarks/page_preview.py` ({points.stamp()}): {MOVES} moves of the sliders over {YIELD[0]:g} "
            f"to {YIELD[1]:g} Pa and {VISCOSITY[0]:g} to {VISCOSITY[1]:g} Pa s, rings of 10 mm, to rest.",
            "",
            points.table(["", "median", "worst"], lines),
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
        (points.RESULTS / "page_preview.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
