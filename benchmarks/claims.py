"""Numbers in sentences of the pages, from committed results: written by one command, compared by a test.

    python benchmarks/claims.py           # fills in every number before a mark, <!--name-->, and docs/validation.md
    python benchmarks/claims.py results   # lists results of other numerics, or that do not say of which they are

A number that a sentence takes from a result stands before a mark, an HTML comment with the name that `claims` gives it.
Numbers of repeated runs are means, and of several rows the worst.
"""

import json
import re
import sys
from itertools import product

import numpy as np
import points

from taichi_mps.validation import standing, table
from taichi_mps.validation.slumps import MILESTONES, inertial

PAGES = [points.ROOT / "README.md", *sorted(points.DOCS.rglob("*.md"))]
MARK = re.compile(r"([-+]?\d[\d,.]*(?:e-?\d+)?|\?)<!--([\w.-]+)-->")
ANY_MARK = re.compile(r"<!--[\w.-]+-->")
SOFT = {"slump at rest": 1.5, "slump flow at rest": 1.0, "T300": 4.0, "T400": 4.0, "T500": 6.0}  # targets [mm], [%]


# ---- results -------------------------------------------------------------------------------------------------------
def cones(key, model="full", spacing=0.01, least=0.0, most=np.inf) -> list[float]:
    """A number of the rows of a model at a spacing, of the mixes of yield stresses from ``least`` to ``most`` [Pa]."""
    mixes = [points.load(path.stem) for path in sorted(points.RESULTS.glob("models_*.json"))]
    rows = [row for mix in mixes if least <= mix["yield_value"] <= most for row in mix["rows"]]
    return [row[key] for row in rows if (row["model"], row["spacing"]) == (model, spacing)]


def worst(values) -> float:
    return max(map(abs, values))


def number(row: str, part: str) -> dict:
    """The first number of a row of the validation table whose quantity has this part."""
    return next(item for item in points.load(f"validate_{row}")["numbers"] if part in item["quantity"])


def percent(row: str, part: str) -> float:
    return 100.0 * number(row, part)["value"]


def peer(case: str, label: str) -> dict:
    return next(row for row in points.load(f"peers_{case}")["rows"] if row["label"] == label)


def soft(file: str) -> dict[str, list[float]]:
    """Columns of benchmarks/results/soft_<file>.md, without scatter; nan where there is nothing."""
    lines = (points.RESULTS / f"soft_{file}.md").read_text(encoding="utf-8").splitlines()
    head, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines if line.startswith("|")]
    found = [[float(text) if (text := cell.split()[0]) != "-" else np.nan for cell in row[1:]] for row in rows]
    return {name: [row[k] for row in found] for k, name in enumerate(head[1:])}


def steps() -> list[list[float]]:
    """Rows of the first table of docs/speed.md that benchmarks/step.py printed."""
    text = (points.DOCS / "speed.md").read_text(encoding="utf-8").split("| particles | threads |")[1].split("\n\n")[0]
    return [[float(cell.replace(",", "")) for cell in line.split("|")[1:-1]] for line in text.splitlines()[2:]]


def off(result: dict, tau_y: float, eta: float) -> float:
    """Largest error of the slump of a case of the paper at the milestones and at 5 s [m]."""
    times, slumps, _ = inertial(tau_y, eta)
    at = (*MILESTONES, 2.0, 5.0)
    return worst(np.interp(at, result["time_s"], result["slump_m"]) - np.interp(at, times, slumps))


# ---- numbers -------------------------------------------------------------------------------------------------------
def claims() -> dict[str, str]:
    """Text of each number by its name."""
    return of_cones() | of_peers() | of_the_paper() | of_validation() | of_speed()


def of_cones() -> dict[str, str]:
    """Worst errors and costs of the models of the cone, over the mixes; those of 80 Pa on, where a name ends so."""
    whole, rings = np.array(cones("slump_error_m")), {"model": "axisymmetric"}
    parts = np.array([cones("slump_error_m", model) - whole for model in ("half", "quarter")])
    ratio = np.array(cones("cpu_seconds")) / cones("cpu_seconds", **rings)
    found = {
        "full-slump": 1e3 * worst(cones("worst_slump_error_m")),
        "full-flow": 100 * worst(cones("spread_error")),
        "full-flow80": 100 * worst(cones("spread_error", least=80)),
        "full-volume": 100 * worst(cones("worst_volume_error")),
        "rings-slump": 1e3 * worst(cones("worst_slump_error_m", **rings)),
        "rings-slump80": 1e3 * worst(cones("worst_slump_error_m", **rings, least=80)),
        "rings5-slump": 1e3 * worst(cones("worst_slump_error_m", **rings, spacing=0.005)),
        "flow40": 100 * worst(cones("spread_error", most=40)),
        "parts": 1e3 * worst(parts.ravel()),
    }
    costs = {"rings-less": ratio.min(), "rings-more": ratio.max()}
    for name, model in (("full", {}), ("rings", rings)):
        spent = cones("cpu_seconds", **model)
        costs |= {f"{name}-least-s": min(spent), f"{name}-most-s": max(spent)}
    return {k: f"{v:.1f}" for k, v in found.items()} | {k: f"{v:.2g}" for k, v in costs.items()}


def of_peers() -> dict[str, str]:
    """Errors and costs of the comparison, ours and theirs, and how many times as long they take."""
    ours, newton, foam = (
        "taichi_mps, implicit",
        "Newton, voxel 1.5 l0, dt 5 ms",
        "interFoam, creep rate 0.02 1/s, dt <= ",
    )
    found = {}
    for case, mine, label, peers_name in (
        ("full_500Pa_10mm", "full500", newton, "newton500"),
        ("full_100Pa_10mm", "full100", newton, "newton100"),
        ("full_500Pa_15mm", "full15", newton, "newton15"),
        ("axisymmetric_500Pa_10mm", "rings500", f"{foam}0.5 ms", "foam500"),
        ("axisymmetric_100Pa_10mm", "rings100", f"{foam}0.5 ms", "foam100"),
        ("axisymmetric_500Pa_5mm", "rings5", f"{foam}1 ms", "foam5"),
    ):
        rows = {mine: peer(f"slump_{case}", ours), peers_name: peer(f"slump_{case}", label)}
        found |= {name: f"{1e3 * abs(row['worst_slump_error_m']):.1f}" for name, row in rows.items()}
        found |= {f"{name}-s": f"{row['cpu_seconds']:.1f}" for name, row in rows.items()}
        found[f"{peers_name}-times"] = f"{rows[peers_name]['cpu_seconds'] / rows[mine]['cpu_seconds']:.2g}"
    for name, label in (("dam", ours), ("pysph", "PySPH, WCSPH")):
        row = peer("dam_break", label)
        found[name] = f"{100 * row['front_error']:.1f}"
        found[f"{name}-s"] = f"{row['cpu_seconds'] / row['simulated_seconds']:.1f}"
    found["pysph-times"] = f"{float(found['pysph-s']) / float(found['dam-s']):.1f}"
    files = [points.load(path.stem)["rows"] for path in sorted(points.RESULTS.glob("peers_*.json"))]
    mine = [row for rows in files for row in rows if row["peer"] == "taichi_mps" and "failed" not in row]
    extra = [row["process_cpu_seconds"] - row["cpu_seconds"] for row in mine]
    return found | {"loading-least": f"{min(extra):.0f}", "loading-most": f"{max(extra):.0f}"}


def of_the_paper() -> dict[str, str]:
    """The paper's cases: where its scheme ends, beside finite elements of its law, and what it costs; [cm], [s]."""
    from paper_cases import PAPER, history

    mine, theirs = (
        {k: points.load(f"paper_{scheme}-{k}") for k in (1, 2, 3, 5)} for scheme in ("implicit", "semi-implicit")
    )
    spent, costs = ({k: found["summary"]["cpu_seconds"] for k, found in runs.items()} for runs in (mine, theirs))
    times = {k: costs[k] / spent[k] for k in spent}
    found = {f"implicit{k}-s": f"{spent[k]:.0f}" for k in spent} | {f"paper{k}-s": f"{costs[k]:.0f}" for k in costs}
    found |= {f"paper{k}-times": f"{times[k]:.0f}" for k in times}
    for name, values in (("implicit", spent), ("paper", costs)):
        found |= {f"{name}-least-s": f"{min(values.values()):.0f}", f"{name}-most-s": f"{max(values.values()):.0f}"}
    found |= {"paper-least-times": f"{min(times.values()):.0f}", "paper-most-times": f"{max(times.values()):.0f}"}
    ends = {k: (result["time_s"][-1], result["slump_m"][-1]) for k, result in theirs.items()}
    exact = np.interp(ends[3][0], *history(*PAPER[3]))
    return found | {
        "paper-implicit": f"{1e3 * max(off(mine[k], *PAPER[k]) for k in mine):.1f}",
        **{f"paper{k}": f"{100 * ends[k][1]:.1f}" for k in (1, 3, 5)},
        **{f"paper{k}-t": f"{ends[k][0]:.2f}" for k in (2, 3)},
        "paper3-exact": f"{100 * exact:.1f}",
        "paper3-off": f"{1e3 * (ends[3][1] - exact):.0f}",
        "paper3-steps": f"{round(5.0 / theirs[3]['dt_s'][1], -4):,.0f}",
        **{f"literal{k}-t": f"{points.load(f'paper_literal-{k}')['summary']['simulated_seconds']:.2g}" for k in (1, 3)},
        "rest5-t": f"{mine[5]['time_s'][-1]:.0f}",
        "law3": f"{1e3 * (np.interp(5.0, *history(*PAPER[3])) - inertial(*PAPER[3])[1][-1]):.0f}",
    }


def of_validation() -> dict[str, str]:
    results = {scheme: table.read_results(points.RESULTS, scheme) for scheme in ("implicit", "semi-implicit")}
    found = {}
    for name, kept in zip(("", "semi-"), results.values(), strict=True):
        met = [item["met"] for result in kept.values() for item in result["numbers"]]
        found |= {f"{name}met": f"{sum(met)}", f"{name}numbers": f"{len(met)}"}
    found["cases"] = f"{len(results['implicit'])}"
    found["calibration"] = f"{len(table.CHOSEN_ON.keys() & results['implicit'].keys())}"
    found |= {
        "film105": f"{abs(percent('film_at_yield', '1.05')):.1f}",
        "time500": f"{number('spread_time', '500')['value']:.1f}",
        "time500-rings5": f"{abs(number('spread_time_fine', '500')['value']):.1f}",
        "vortices": f"{abs(percent('taylor_green', 'root')):.1f}",
        "cavity100": f"{abs(percent('cavity_100_fine', 'lowest')):.1f}",
        "cavity400": f"{abs(percent('cavity_400_fine', 'lowest')):.1f}",
        "front": f"{percent('dam_break_front', 'gate'):.1f}",
        "front-no-delay": f"{percent('dam_break_front', 'no delay'):.0f}",
        "sensor160": f"{abs(percent('dam_break_pressure', 'plateau (t* 3 to 5) at 160')):.0f}",
        "sensor": f"{abs(percent('dam_break_pressure', 'sensor')):.1f}",
        "pool": f"{max(percent(f'still_pool_{fluid}', 'pressure') for fluid in ('water', 'concrete')):.1f}",
    }
    flow = [percent(f"pipe_{law}", f"flow rate, from {fill}")
            for law, fill in product(("newtonian", "bingham_02", "bingham_05"), ("rings", "a cut"))]  # fmt: skip
    found |= {"pipe-slow": f"{-min(flow):.1f}", "pipe-fast": f"{max(flow):.1f}"}
    cavity = {bn: abs(percent("cavity_bingham", f"function, largest, Bn = {bn}")) for bn in (2, 5, 10, 20, 50)}
    found |= {f"cavity-bn{bn}": f"{cavity[bn]:.1f}" for bn in (20, 50)}
    found["cavity-soft"] = f"{max(cavity[bn] for bn in (2, 5, 10)):.1f}"
    orders = [order(row) for row in ("film_newtonian", "film_bingham_02", "film_bingham_05", "film_bi_viscosity")]
    found |= {"film-order-least": f"{min(orders):.2f}", "film-order-most": f"{max(orders):.2f}"}
    found["channel-order"] = f"{order('channel_bingham'):.2f}"
    for tau_y, share in standing.STATIC_LIMITS.items():
        known = inertial(tau_y)
        found |= {
            f"arrested{tau_y:g}-slump": f"{1e3 * known[1][-1]:.1f}",
            f"arrested{tau_y:g}-flow": f"{1e3 * known[2][-1]:.1f}",
            f"arrested{tau_y:g}-share": f"{share:.2f}",
        }
    return found


def order(row: str) -> float:
    """Order of convergence that a row tells in its quantity."""
    return float(re.search(r"order of convergence \(([\d.]+)", number(row, "order")["quantity"])[1])


def of_speed() -> dict[str, str]:
    cone, measured = points.read("speed_accuracy_cone"), steps()
    found = {f"cone{mm}": f"{cone[f'cone implicit {1e-3 * mm:g} x1']['error']:.1f}" for mm in (25, 20, 12.5)}
    speedup = [row[6] for row in measured if row[1] == 2]
    found |= {"threads-least": f"{min(speedup):.1f}", "threads-most": f"{max(speedup):.1f}"}
    return found | {"iterations-more": f"{100 * (measured[-1][3] / measured[0][3] - 1):.0f}"}


# ---- what misses ---------------------------------------------------------------------------------------------------
def accuracy_rows() -> list[tuple[str, str, list[dict]]]:
    """Rows of the table of docs/accuracy.md: case, reference, numbers with value, target and unit."""

    def cone(tau, part):
        return number(f"slump_{tau}", part)

    def of_soft(file, key):
        values, unit = soft(file)[key], "mm" if key == "slump at rest" else "%"
        known = worst(value for value in values if np.isfinite(value))
        return {"quantity": key, "value": known, "target": SOFT[key], "unit": unit}

    closed, inertia = "closed form", "finite elements with inertia"
    across, six = "at 20 across", "worst of six cones of 40 to 1000 Pa, quarter"
    rows = [
        (f"Bingham film, Bn 0.2 and 0.5, L2, {across}", closed, [number(f"film_bingham_0{k}", "L2") for k in (2, 5)]),
        (f"Bingham channel, Bn 0.3, L2, {across}", closed, [number("channel_bingham", "L2")]),
        ("film at 0.95 of its yield stress, speed after 10 s", "stands", [number("film_at_yield", "10 s at 0.95")]),
        ("film at 1.05 of its yield stress, speed, at 40 across", closed, [number("film_at_yield", "1.05")]),
        (f"pipe, plug of R/2, flow rate, {across}", closed,
         [number("pipe_bingham_05", f"rate, from {fill}") for fill in ("rings", "a cut")]),
        ("cone 100, 300, 500, 1000 Pa, 10 mm, worst slump to 1 s", inertia,
         [cone(tau, "worst") for tau in (100, 300, 500, 1000)]),
        ("the same, slump flow at the end", inertia, [cone(tau, "slump flow") for tau in (100, 300, 500, 1000)]),
        ("the same, volume at all times", "exact", [cone(tau, "all times") for tau in (100, 300, 500, 1000)]),
        ("time to a slump flow of 400, 500 mm, 50 Pa, 1000 Pa s", "finite elements without inertia",
         [number("spread_time", f"{mm}") for mm in (400, 500)]),
        ("still pools of water, concrete, pressure over 100 s", "hydrostatic",
         [number(f"still_pool_{fluid}", "pressure") for fluid in ("water", "concrete")]),
    ]  # fmt: skip
    for mm, key in product((5, 10), SOFT):
        rows.append((f"{six}, {mm} mm, {key}", inertia, [of_soft(f"quarter_{mm}mm", key)]))
    front = [number("dam_break_front", part) for part in ("gate", "no delay")]
    return [*rows, ("dam break, front, with and without the gate's delay", "Martin and Moyce (1952)", front)]


def told(item: dict, key: str) -> str:
    """A number with its unit, shares in per cent."""
    value, unit = (100.0 * item[key], "%") if item["unit"] == "-" else (item[key], item["unit"])
    return f"{abs(value):.2g} {unit}"


def missed(item: dict) -> bool:
    return not abs(item["value"]) <= item["target"]


def accuracy() -> str:
    """Table of docs/accuracy.md, and below all that misses its target, of this table and of the validation table."""
    kept, lines = table.read_results(points.RESULTS, "implicit"), []
    misses = [(result["case"], item) for result in kept.values() for item in result["numbers"] if missed(item)]
    for case, reference, numbers in accuracy_rows():
        errors = [f"**{told(item, 'value')}**" if missed(item) else told(item, "value") for item in numbers]
        lines.append([case, reference, ", ".join(errors), told(numbers[0], "target")])
        told_before = [item for _, item in misses]
        misses += [(case, item) for item in numbers if missed(item) and item not in told_before]
    below = []
    for case, item in misses:
        what = case if case.endswith(item["quantity"]) else f"{case}: {item['quantity']}"
        below.append(f"- {what}, {table.written(item, 'value')} (target {table.written(item, 'target')})")
    head = f"**What misses its target**, of this table and of [all cases](validation.md), {len(misses)} numbers:"
    return "\n\n".join([points.table(["case", "reference", "error", "target"], lines), head, "\n".join(below)])


def brackets() -> str:
    """The critical yield stresses of the validation table, as a clause each: what was found, in which bracket."""
    found = []
    for row in ("plane", "cylinder", "cone"):
        text = number(f"column_{row}", "critical")["quantity"]
        here, low, high = re.search(r"gH?.*?\) ([\d.]+) from the middle of ([\d.]+) to ([\d.]+)", text).groups()
        inside = "in" if number(f"column_{row}", "outside")["value"] == 0.0 else "**outside**"
        found.append(f"{row} {here} {inside} {low} to {high}")
    return f"Critical yield stress over rho g H, in the bracket of the finite elements: {'; '.join(found)}."


# ---- pages ---------------------------------------------------------------------------------------------------------
def filled(page, known: dict[str, str]) -> str:
    """Text of a page with all its numbers as they are known; an unknown mark, or one without a number, is an error."""
    text = page.read_text(encoding="utf-8")
    names = [mark[4:-3] for mark in ANY_MARK.findall(text)]
    if wrong := [name for name in names if name not in known] or len(names) - len(MARK.findall(text)):
        raise SystemExit(f"{page}: a mark is unknown, or has no number before it: {wrong}")
    text = MARK.sub(lambda mark: f"{known[mark[2]]}<!--{mark[2]}-->", text)
    if page.name == "accuracy.md":
        text = between(text, "benchmarks/claims.py", f"{accuracy()}\n\n{brackets()}")
    if page.name == "validation.md":
        kept = [table.read_results(points.RESULTS, scheme) for scheme in ("implicit", "semi-implicit")]
        text = between(text, "taichi-mps validate", table.markdown(*kept))
    return text


def between(text: str, name: str, block: str) -> str:
    """The text with this block between the marks of a command."""
    begin, end = f"<!-- written by {name} -->", f"<!-- end of {name} -->"
    before, rest = text.split(begin)
    return f"{before}{begin}\n\n{block}\n\n{end}{rest.split(end)[1]}"


def of_other_numerics(numerics: str) -> list[str]:
    """Files of results/ that do not say that they were made with these numerics."""
    found = []
    for path in sorted(points.RESULTS.glob("*.*")):
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".json":
            result = json.loads(text)
            parts = [result, *result.get("points", {}).values()] if "machine" in result else [*result.values()]
            heads = [part.get("machine") if isinstance(part, dict) else None for part in parts]
            same = all(isinstance(head, dict) and head.get("fingerprint") == numerics for head in heads)
        else:
            same = f"fingerprint {numerics}" in text
        found += [path.name] * (not same)
    return found


def main() -> None:
    if sys.argv[1:] == ["results"]:
        import fingerprint

        for name in of_other_numerics(fingerprint.numerics()):
            print(f"warning: {name}: not known to be of the present numerics")
        return
    known = claims()
    for page in PAGES:
        page.write_text(filled(page, known), encoding="utf-8")


if __name__ == "__main__":
    main() if sys.argv[1:] in ([], ["results"]) else sys.exit(__doc__)
