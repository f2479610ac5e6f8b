"""PySPH on the dam break of water, in its own environment.

    python benchmarks/peers/pysph_dam.py install      # needs a C++ compiler; a virtual environment

Run by compare.py as `python pysph_dam.py CASE.json OUT.npz`. Schemes and their numbers are those of PySPH's own example
dam_break_2d (sound speed 10 sqrt(2 g H), alpha 0.1, h = 1.3 l0, its time steps), at the size and spacing of the case;
four layers of wall particles as there. Its compiled loops come from its cache; what compiles is not counted.
"""

import resource
import tempfile

import numpy as np
from environments import main

NEEDS = ("pysph==1.0b2", "setuptools<81", "numpy")


def simulate(case: dict) -> dict:
    """Positions (n, 2) [m] at the case's times, and what the run cost."""
    from pysph.base.utils import get_particle_array
    from pysph.examples import dam_break_2d as example
    from pysph.tools.geometry import get_2d_block, get_2d_tank

    a, dx = case["width"], case["spacing"]
    example.vref = np.sqrt(2 * 9.81 * 2 * a)
    example.co = 10.0 * example.vref
    example.dx, example.hdx = dx, 1.3
    example.h, example.m = 1.3 * dx, dx**2 * case["density"]
    frames, clock = [], {}

    class Dam(example.DamBreak2D):
        def create_particles(self):
            x, y = get_2d_block(dx=dx, length=a - dx, height=2 * a - dx, center=[0.5 * a, a])
            xt, yt = get_2d_tank(dx=dx, length=4 * a + dx, height=4 * a, base_center=[2 * a, -0.5 * dx], num_layers=4)
            x = x + case["aside"]
            h, m, rho = example.h, example.m, case["density"]
            fluid = get_particle_array(name="fluid", x=x, y=y, h=h, m=m, rho=rho)
            boundary = get_particle_array(name="boundary", x=xt, y=yt, h=h, m=m, rho=rho)
            self.scheme.setup_properties([fluid, boundary])
            if case["settings"]["scheme"] == "iisph":
                fluid.x += dx / 4  # as in the example: nearer to the wall it is pushed away
            self.kernel_corrections(fluid, boundary)
            return [fluid, boundary]

        def configure_scheme(self):
            configure = self.scheme.configure_solver  # a second call would forget what the first one set
            mine = {"tf": case["until"], "output_at_times": case["times"], "pfreq": 10**9}
            self.scheme.configure_solver = lambda **theirs: configure(**(theirs | mine))
            super().configure_scheme()

        def post_step(self, solver):
            now = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
            clock.setdefault("start", now)
            clock.update(end=now, steps=clock.get("steps", -1) + 1)
            if len(frames) < len(case["times"]) and solver.t >= case["times"][len(frames)] - 1e-9:
                fluid = self.particles[0]
                frames.append((solver.t, np.column_stack([fluid.x, fluid.y])[: fluid.get_number_of_particles(True)]))

        def post_process(self, info):
            pass

    with tempfile.TemporaryDirectory() as folder:
        Dam(fname="dam").run(["--scheme", case["settings"]["scheme"], "-d", folder, "--disable-output"])
    return {
        "t": np.array([t for t, _ in frames]),
        "x": np.array([x for _, x in frames]),
        "steps": clock["steps"],
        "cpu_seconds": clock["end"] - clock["start"],
        "elements": frames[0][1].shape[0],
    }


if __name__ == "__main__":
    main("pysph", NEEDS, simulate)
