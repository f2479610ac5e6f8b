"""What is known of a run before it starts: size, memory, time, accuracy, and bars too thin for its particles."""

from ..memory import size
from ..problem import catalogue
from ..problem.accuracy import expected_of
from ..simulation.cost_estimate import estimate_cost, size_of
from ..simulation.memory_estimate import estimate, particles_of
from ..simulation.pouring import Pouring
from ..simulation.simulation import pairs_of
from .sentences import certainty, thin_solids


def forecast(problem, precision: str = "f32") -> list[str]:
    """Lines for a reader."""
    scene = problem.scene
    to_come = sum(Pouring(scene, inlet).to_come for inlet in scene.inlets)
    needed = estimate(problem, to_come, pairs_of(scene), precision=precision)
    like_a_summary = {"scene": scene.name, "parameters": dict(scene.parameters), "scheme": problem.scheme}
    like_a_summary["materials"] = [material.facts() for material in problem.materials]
    like_a_summary["thin_solids_m"] = problem.thin_solids
    model = f", model {scene.parameters['model']}" if "model" in scene.parameters else ""
    part = {1: ", half of the body", 2: ", a quarter of the body"}.get(len(scene.mirrors), "") if not model else ""
    count = particles_of(problem, to_come)
    return [
        f"{count:,} particles of {1e3 * scene.spacing:.3g} mm{model}{part}; about {size(needed)} of memory.",
        processor_time(problem, expected_of(like_a_summary)),
        certainty(like_a_summary),
        *thin_solids(like_a_summary),
    ]


def processor_time(problem, known) -> str:
    """By the measured slumps, by the steps of a pour and what they cost, or by what the scene says of itself."""
    if known:
        return f"About {known.cpu_seconds:.2g} s of processor time for the flow, and some to make the program ready."
    scene, cost = problem.scene, estimate_cost(problem)
    if cost:
        poured = 1e3 * sum(inlet.volume for inlet in scene.inlets)
        steps = float(f"{cost.steps:.2g}")
        return (
            f"Pours {poured:.3g} l; to {cost.ends:.3g} s at most some {steps:,.0f} steps and {size_of(cost)} of "
            "processor time with one thread, by what such pours took on the machine where they were measured, and some "
            "to make the program ready."
        )
    told = catalogue.run_time(scene.name) if scene.name in catalogue.names() else ""
    told = told.replace("spacing", "particle size").replace("`", "")
    return f"Of this test is known: {told}" if told else "How long it takes is not known."
