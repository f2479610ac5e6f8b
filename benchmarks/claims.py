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

from validation import provenance, standing, table
from validation.slumps import MILESTONES, inertial

PAGES = [points.ROOT / "README.md", *sorted(points.DOCS.rglob("*.md"))]
MARK = re.compile(r"([-+]?\d[\d,.]*(?:e-?\d+)?|\?)<!--([\w.-]+)-->")
# hashes of former numerics, and what alone differs since; all of it concerns the scheme implicit
FORMER = {"4a901d90d7e79bf6": "for the first steps of viscous flows by the implicit scheme (steps.md, (I14))"}
OTHER_SCHEME = re.compile("semi-implicit|literal")  # in the name of a result of the other scheme alone
ANY_MARK = re.compile(r"<!--[\w.-]+-->")
FOAM, NEWTON, OURS = "interFoam, creep rate 0.02 1/s, dt <= ", "Newton, voxel 1.5 l0, dt 5 ms", "taichi_mps, implicit"
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
    spent = {"full": cones("cpu_seconds"), "rings": cones("cpu_seconds", **rings)}
    ratio = np.divide(*spent.values())
    costs = {f"{name}-least-s": min(each) for name, each in spent.items()}
    costs |= {f"{name}-most-s": max(each) for name, each in spent.items()}
    costs |= {"rings-less": ratio.min(), "rings-more": ratio.max()}
    return {k: f"{v:.1f}" for k, v in found.items()} | {k: f"{v:.2g}" for k, v in costs.items()}


def of_peers() -> dict[str, str]:
    """Errors and costs of the comparison, ours and theirs, and how many times as long they take."""
    found = {}
    for case, mine, label, peers_name in (
        ("full_500Pa_10mm", "full500", NEWTON, "newton500"),
        ("full_100Pa_10mm", "full100", NEWTON, "newton100"),
        ("full_500Pa_15mm", "full15", NEWTON, "newton15"),
        ("axisymmetric_500Pa_10mm", "rings500", f"{FOAM}0.5 ms", "foam500"),
        ("axisymmetric_100Pa_10mm", "rings100", f"{FOAM}0.5 ms", "foam100"),
        ("axisymmetric_500Pa_10mm", "rings500", f"{FOAM}1 ms", "foam1ms"),
        ("axisymmetric_500Pa_5mm", "rings5", f"{FOAM}1 ms", "foam5"),
    ):
        rows = {mine: peer(f"slump_{case}", OURS), peers_name: peer(f"slump_{case}", label)}
        found |= {name: f"{1e3 * abs(row['worst_slump_error_m']):.1f}" for name, row in rows.items()}
        found |= {f"{name}-s": f"{row['cpu_seconds']:.1f}" for name, row in rows.items()}
        found[f"{peers_name}-times"] = f"{rows[peers_name]['cpu_seconds'] / rows[mine]['cpu_seconds']:.2g}"
    for name, label in (("dam", OURS), ("pysph", "PySPH, WCSPH")):
        row = peer("dam_break", label)
        found[name] = f"{100 * row['front_error']:.1f}"
        found[f"{name}-s"] = f"{row['cpu_seconds'] / row['simulated_seconds']:.1f}"
    found["pysph-times"] = f"{float(found['pysph-s']) / float(found['dam-s']):.1f}"
    every = [row for path in points.RESULTS.glob("peers_*.json") for row in points.load(path.stem)["rows"]]
    mine = [row for row in every if row["peer"] == "taichi_mps" and "failed" not in row]
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
    """Numbers of the validation table, and how many of them and of its cases there are."""
    kept, theirs = (table.read_results(points.RESULTS, scheme) for scheme in ("implicit", "semi-implicit"))
    met, theirs = ([item["met"] for row in rows.values() for item in row["numbers"]] for rows in (kept, theirs))
    fills = product(("newtonian", "bingham_02", "bingham_05"), ("rings", "a cut"))
    flow = [percent(f"pipe_{law}", f"flow rate, from {fill}") for law, fill in fills]
    cavity = {bn: abs(percent("cavity_bingham", f"function, largest, Bn = {bn}")) for bn in (2, 5, 10, 20, 50)}
    orders = [order(row) for row in ("film_newtonian", "film_bingham_02", "film_bingham_05", "film_bi_viscosity")]
    arrested = {f"arrested{tau:g}": (*inertial(tau), share) for tau, share in standing.STATIC_LIMITS.items()}
    return {
        "met": f"{sum(met)}",
        "numbers": f"{len(met)}",
        "cases": f"{len(kept)}",
        "semi-met": f"{sum(theirs)}",
        "semi-numbers": f"{len(theirs)}",
        "calibration": f"{len(table.CHOSEN_ON.keys() & kept.keys())}",
        "film105": f"{abs(percent('film_at_yield', '1.05')):.1f}",
        "time500": f"{number('spread_time', '50 cm')['value']:.1f}",
        "time500-rings5": f"{abs(number('spread_time_fine', '50 cm')['value']):.1f}",
        "vortices": f"{abs(percent('taylor_green', 'root')):.1f}",
        "cavity100": f"{abs(percent('cavity_100_fine', 'lowest')):.1f}",
        "cavity400": f"{abs(percent('cavity_400_fine', 'lowest')):.1f}",
        "cavity-soft": f"{max(cavity[bn] for bn in (2, 5, 10)):.1f}",
        "cavity-bn20": f"{cavity[20]:.1f}",
        "cavity-bn50": f"{cavity[50]:.1f}",
        "front": f"{percent('dam_break_front', 'gate'):.1f}",
        "front-no-delay": f"{percent('dam_break_front', 'no delay'):.0f}",
        "sensor160": f"{abs(percent('dam_break_pressure', 'plateau (t* 3 to 5) at 160')):.0f}",
        "sensor": f"{abs(percent('dam_break_pressure', 'sensor')):.1f}",
        "pool": f"{max(percent(f'still_pool_{fluid}', 'pressure') for fluid in ('water', 'concrete')):.1f}",
        "pipe-slow": f"{-min(flow):.1f}",
        "pipe-fast": f"{max(flow):.1f}",
        "film-order-least": f"{min(orders):.2f}",
        "film-order-most": f"{max(orders):.2f}",
        "channel-order": f"{order('channel_bingham'):.2f}",
        **{f"{name}-slump": f"{1e3 * slumps[-1]:.1f}" for name, (_, slumps, _, _) in arrested.items()},
        **{f"{name}-flow": f"{1e3 * flows[-1]:.1f}" for name, (_, _, flows, _) in arrested.items()},
        **{f"{name}-share": f"{share:.2f}" for name, (*_, share) in arrested.items()},
    }


def order(row: str) -> float:
    """Order of convergence that a row tells in its quantity."""
    return float(re.search(r"order of convergence \(([\d.]+)", number(row, "order")["quantity"])[1])


def of_speed() -> dict[str, str]:
    """Claims of docs/speed.md on spacings, threads and iterations, and of what grains cost."""
    cone, measured = points.read("speed_accuracy_cone"), steps()
    speedup = [row[6] for row in measured if row[1] == 2]
    return {
        **{f"cone{mm}": f"{cone[f'cone implicit {1e-3 * mm:g} x1']['error']:.1f}" for mm in (25, 20, 12.5, 10)},
        **{f"grains{a['side']}": f"{b['iterations'] / a['iterations']:.2f}" for a, b in points.load("grains")["pairs"]},
        "threads-least": f"{min(speedup):.1f}",
        "threads-most": f"{max(speedup):.1f}",
        "iterations-more": f"{100 * (measured[-1][3] / measured[0][3] - 1):.0f}",
    }


# ---- what misses ---------------------------------------------------------------------------------------------------
def worst_of_soft(file: str, key: str) -> dict:
    """The worst of a column of the soft mixes, as a number of the validation table."""
    values, unit = soft(file)[key], "mm" if key == "slump at rest" else "%"
    return {"quantity": key, "value": np.nanmax(np.abs(values)), "target": SOFT[key], "unit": unit}


def accuracy_rows() -> list[tuple[str, str, list[dict]]]:
    """Rows of the table of docs/accuracy.md: case, reference, numbers with value, target and unit."""
    inertia, cone = "finite elements with inertia", ("slump_100", "slump_300", "slump_500", "slump_1000")
    across, six = "at 20 across", "worst of six cones of 40 to 1000 Pa, quarter"
    found = [
        (f"Bingham film, Bn 0.2 and 0.5, {across}", "closed form", ("film_bingham_02", "film_bingham_05"), "L2"),
        (f"Bingham channel, Bn 0.3, {across}", "closed form", ("channel_bingham",), "L2"),
        ("film at 0.95 of its yield stress, speed after 10 s", "stands", ("film_at_yield",), "10 s at 0.95"),
        ("film at 1.05 of its yield stress, speed, at 40 across", "closed form", ("film_at_yield",), "1.05"),
        (f"pipe, plug of R/2, flow rate, rings, {across}", "closed form", ("pipe_bingham_05",), "rate, from rings"),
        (f"pipe, plug of R/2, flow rate, lattice, {across}", "closed form", ("pipe_bingham_05",), "rate, from a cut"),
        ("cone 100, 300, 500, 1000 Pa, 10 mm, worst slump to 1 s", inertia, cone, "worst"),
        ("the same, slump flow at the end", inertia, cone, "slump flow"),
        ("the same, volume at all times", "exact", cone, "all times"),
        (
            "time to a slump flow of 40 cm, 50 Pa, 1000 Pa s",
            "finite elements without inertia",
            ("spread_time",),
            "40 cm",
        ),
        ("time to a slump flow of 50 cm", "finite elements without inertia", ("spread_time",), "50 cm"),
        ("still pools, pressure", "hydrostatic", ("still_pool_water", "still_pool_concrete"), "pressure"),
        ("dam break, front, the gate's delay counted", "Martin and Moyce (1952)", ("dam_break_front",), "gate"),
        ("dam break, front, without", "Martin and Moyce (1952)", ("dam_break_front",), "no delay"),
    ]
    return [(case, reference, [number(row, part) for row in names]) for case, reference, names, part in found] + [
        (f"{six}, {mm} mm, {key}", inertia, [worst_of_soft(f"quarter_{mm}mm", key)])
        for mm, key in product((5, 10), SOFT)
    ]


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
        misses += [(case, item) for item in numbers if missed(item) and "met" not in item]
    below = [
        f"- {case.removesuffix(item['quantity']).rstrip(', ')}: {item['quantity']}, {table.written(item, 'value')} "
        f"(target {table.written(item, 'target')})"
        for case, item in misses
    ]
    below += [f"- {result['case']}: {result['error']}" for result in kept.values() if result["error"]]
    head = f"**What misses its target**, of this table and of [all cases](validation.md), {len(below)} lines:"
    return "\n\n".join([points.table(["case", "reference", "error", "target"], lines), head, "\n".join(below)])


def brackets() -> str:
    """The critical yield stresses of the validation table with their brackets, a sentence."""
    texts = [number(f"column_{row}", "critical")["quantity"] for row in ("plane", "cylinder", "cone")]
    texts = [text.replace(" from the middle of", ", bracket").removesuffix(", relative") for text in texts]
    return f"Columns stand, in the plane, as cylinder and cone, where the finite elements do: {'; '.join(texts)}."


# ---- pages ---------------------------------------------------------------------------------------------------------
def filled(page, known: dict[str, str]) -> str:
    """Text of a page with all its numbers as they are known; an unknown mark, or one without a number, is an error."""
    text = page.read_text(encoding="utf-8")
    names = [mark[4:-3] for mark in ANY_MARK.findall(text)]
    if wrong := [name for name in names if name not in known] or len(names) - len(MARK.findall(text)):
        raise SystemExit(f"{page}: a mark is unknown, or has no number before it: {wrong}")
    text = MARK.sub(lambda mark: f"{known[mark[2]]}<!--{mark[2]}-->", text)
    if page.name == "accuracy.md":
        text = provenance.between(text, "benchmarks/claims.py", f"{accuracy()}\n\n{brackets()}")
    if page.name == "validation.md":
        kept = [table.read_results(points.RESULTS, scheme) for scheme in ("implicit", "semi-implicit")]
        text = provenance.between(text, table.COMMAND, table.markdown(*kept))
    return text


def of_other_numerics(*numerics: str) -> list[str]:
    """Files of results/ that do not say that they were made with one of these numerics, or with "none" of the engine's.
    A table that is drawn from others says so, "Made with:": those others are asked."""
    found, known = [], (*numerics, "none")
    for path in sorted(points.RESULTS.glob("*.*")):
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".json":
            result = json.loads(text)
            parts = [result, *result.get("points", {}).values()] if "machine" in result else [*result.values()]
            heads = [part.get("machine") if isinstance(part, dict) else None for part in parts]
            same = all(isinstance(head, dict) and head.get("fingerprint") in known for head in heads)
        else:
            same = "*Made with: " in text or any(f"fingerprint {each}" in text for each in known)
        found += [path.name] * (not same)
    return found


def main() -> None:
    if sys.argv[1:] == ["results"]:
        import fingerprint

        now = fingerprint.numerics()
        others = of_other_numerics(now, *FORMER)
        for name in of_other_numerics(now):
            if name not in others and OTHER_SCHEME.search(name):
                continue
            differs = " but " + " or ".join(FORMER.values()) if name not in others else ""
            print(f"warning: {name}: not known to be of the present numerics{differs}")
        return
    known = claims()
    for page in PAGES:
        page.write_text(filled(page, known), encoding="utf-8")


if __name__ == "__main__":
    main() if sys.argv[1:] in ([], ["results"]) else sys.exit(__doc__)
