"""The program that keeps cheap models of tests compiled, in rings or a plane, and runs a mix through them at once.

Another mix is other entries of the same kernels, so only the first of a test waits for them. Run by resident.py.
"""

import base64
import math
import warnings
from dataclasses import replace
from functools import partial

import numpy as np

from ..problem import accuracy, catalogue
from ..problem.problem import Problem
from ..problem.scene import Scene
from ..simulation.frame import Frame
from ..simulation.reuse import begin
from ..simulation.simulation import Simulation
from ..simulation.summary import described
from ..units import SceneError, plain
from .form import CHEAP
from .resident import answer_all
from .results import numbers

FINE, COARSE = 1.0 / 30.0, 1.0 / 15.0  # particle size of a cone over its height
SOFT = 100.0 / (2300.0 * 9.81 * 0.3)  # yield stress over rho g H below which a cone is first shown by coarse ones
ROOM = 3.0  # least radius of the domain of a cone over its height
FIRST, EACH, LATER = 0.02, 1.0 / 30.0, 1.04  # [s] of flow, when pictures are due; ratio of their times later on
MOST_KEPT = 12  # Simulations: two of each cone, and of some domains


def models(test: str, values: dict) -> list[Scene]:
    """The cheap models of a test, the coarsest first, by texts of its keywords. The domain of a cone is as for another
    mix, up to a factor of two, since another domain is another program."""
    parameters = catalogue.load(test).parameters
    given = {key: text for key, text in values.items() if key in parameters.model_fields and key not in CHEAP[test]}
    given |= {key: text for key, text in CHEAP[test].items() if text is not None}
    if "model" not in CHEAP[test]:
        return [catalogue.build(test, **given)]
    valid, found = parameters(**given), []
    soft = (valid.yield_value or 0.0) < SOFT * valid.density * accuracy.GRAVITY * valid.height
    for part in (COARSE, FINE) if soft else (FINE,):
        scene = catalogue.build(test, **given, spacing=part * valid.height)
        low, (reach, top) = scene.domain
        reach = ROOM * valid.height * 2.0 ** max(0, math.ceil(math.log2(reach / (ROOM * valid.height))))
        found.append(replace(scene, domain=(low, (reach, top))))
    return found


class Film:
    """The section of a Simulation as it moves, told at times that lie further apart as it slows down."""

    def __init__(self, sim: Simulation, tell, cancelled):
        self.sim, self.tell, self.cancelled, self.course = sim, tell, cancelled, []
        self.unit = float(np.abs(sim.scene.domain).max()) / 32000.0  # [m] of positions as whole numbers of 16 bits
        self.due = 0.0

    def run(self) -> str:
        """To the end; why it ended, as a summary has it."""
        self.tell(stage=self.stage())
        self.show()
        self.due = FIRST
        self.sim.each_step(self.look)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                ended = self.sim.run()
            except (SceneError, ArithmeticError, RuntimeError) as error:  # a mix that the cheap model cannot compute
                return getattr(error, "stopped_by", "diverged")
        if not self.cancelled():
            self.show()
        return ended

    def look(self, sim: Simulation) -> None:
        """After a step: stop, or tell what is due."""
        if self.cancelled():
            sim.interrupt()
        elif sim.time >= self.due and sim.taken_by_all:
            self.show()

    def show(self) -> None:
        """Tell the time, the measures, and the positions and sizes of the particles now."""
        body, time = self.sim.snapshot(), self.sim.time
        measures = Frame(self.sim.scene, body, self.sim.report).measures()
        self.course.append({"time_s": time, **measures})
        rows = np.round(np.column_stack([body.x, body.size]) / self.unit).astype("<i2")
        self.tell(t=time, m=numbers(measures), x=base64.b64encode(rows.tobytes()).decode())
        self.due = max(time + EACH, LATER * time)

    def stage(self) -> dict:
        """Fixed lines of the picture [m], and the names of the measures."""
        scene = self.sim.scene
        return {
            "rings": scene.axisymmetric,
            "unit": self.unit,
            "spacing": scene.spacing,
            "low": scene.domain[0],
            "high": scene.domain[1],
            "height": scene.parameters.get("height"),
            "periodic": any(scene.periodic),
            "tilt": scene.parameters.get("angle", 0.0),
            "mould": [line[:, [0, -1]].tolist() for line in scene.outline[:2]] if scene.axisymmetric else [],
        }

    def result(self) -> dict:
        """Result of a preview, with its expected error from the measured errors of such models."""
        scene, measures = self.sim.scene, {k: v for k, v in self.course[-1].items() if k != "time_s"}
        if scene.over_time:
            measures |= scene.over_time(
                {key: np.array([row.get(key, math.nan) for row in self.course]) for key in self.course[0]}
            )
        _, height, error = accuracy.of_run(described(self.sim.problem)) or (None, None, None)
        errors = {"slump_m": height * error.slump, "spread_m": 2.0 * height * error.reach} if error else {}
        return {"m": numbers(measures), "errors": errors, "time": self.sim.time, "spacing": scene.spacing}


def preview(request: dict, tell, cancelled) -> None:
    """Tell the section of a test of a mix as it moves, then its measures."""
    try:
        scenes = models(request["test"], request["values"])
        for scene in scenes:
            Problem(scene)
    except (SceneError, ImportError) as error:
        tell(wrong=plain(error))
        return
    for scene in scenes:
        film = Film(begin(scene, partial(tell, preparing=True), MOST_KEPT), tell, cancelled)
        ended = film.run()
        if not cancelled():
            tell(result=film.result() | {"ended": ended, "last": scene is scenes[-1]})


if __name__ == "__main__":
    answer_all(preview)
