"""What is known of a run before it starts, in lines: size, memory, time, accuracy, and bars too thin for its
particles."""

from ..problem import accuracy, catalogue
from ..runtime.memory import size
from ..simulation.forecast import cost_of, memory_of, pairs_of, particles_of
from ..simulation.summary import described
from .sentences import certainty, in_time, thin_solids


def forecast(problem, precision: str) -> list[str]:
    """Lines for a reader."""
    scene, facts = problem.scene, described(problem)
    part = {1: ", half of the body", 2: ", a quarter of the body"}.get(len(scene.mirrors), "")
    part = f", model {scene.parameters['model']}" if "model" in scene.parameters else part
    what = f"{particles_of(problem):,} particles of {1e3 * scene.spacing:.3g} mm{part}"
    needed = size(memory_of(problem, pairs_of(scene), precision))
    told = [f"{what}; about {needed} of memory.", processor_time(problem, accuracy.of_run(facts))]
    return [*told, certainty(facts), *thin_solids(facts)]


def processor_time(problem, known) -> str:
    """By the measured slumps, by the steps of a pour and what they cost, or by what the scene says of itself."""
    if known and known[2]:
        seconds = known[2].cpu_seconds
        return f"About {in_time(seconds)} of processor time for the flow, and some to make the program ready."
    scene, cost = problem.scene, cost_of(problem)
    if cost:
        poured = 1e3 * sum(inlet.volume for inlet in scene.inlets)
        return (
            f"Pours {poured:.3g} l; to {scene.until:.3g} s at most some {float(f'{cost.steps:.2g}'):,.0f} steps and "
            f"{in_time(cost.cpu_seconds)} of processor time with one thread, by what such pours took on the machine "
            "where they were measured, and some to make the program ready."
        )
    told = catalogue.run_time(scene.name) if scene.name in catalogue.names() else ""
    told = told.replace("spacing", "particle size").replace("`", "")
    return f"Of this test is known: {told}" if told else "How long it takes is not known."
