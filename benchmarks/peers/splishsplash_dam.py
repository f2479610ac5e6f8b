"""SPlisHSPlasH on the dam break of water, in its own environment.

    python benchmarks/peers/splishsplash_dam.py install       # a virtual environment

Run by compare.py as `python splishsplash_dam.py CASE.json OUT.npz`. Scene and numbers are those of its own
DamBreakModel_2D.json (volume maps as walls, CFL factor 1, standard viscosity), at the size and spacing of the case; the
artificial vorticity is left out. Its module ends with a segmentation fault at import unless the system's libGLdispatch
is loaded first, so this file starts itself again with LD_PRELOAD.
"""

import json
import os
import resource
import sys
import tempfile
from pathlib import Path

import numpy as np
from environments import main

NEEDS = ("pysplishsplash==2.19.0", "numpy")
PRELOAD = "libGLdispatch.so.0"
METHODS = {"WCSPH": 0, "PCISPH": 1, "PBF": 2, "IISPH": 3, "DFSPH": 4}


def scene(case: dict, models: Path) -> dict:
    """The scene file; the 2-D water column stands in the left corner of the tank at x = 0, y = 0."""
    a, l0, settings = case["width"], case["spacing"], case["settings"]
    tank = 4 * a
    return {
        "Configuration": {
            "pause": False,
            "sim2D": True,
            "particleRadius": 0.5 * l0,
            "simulationMethod": METHODS[settings["method"]],
            "gravitation": [0, -9.81, 0],
            "cflMethod": 1,
            "cflFactor": settings.get("cfl", 1.0),
            "cflMaxTimeStepSize": settings.get("max_dt", 0.005),
            "boundaryHandlingMethod": 2,
            "maxError": settings.get("error", 0.1),
            "DFSPH": {
                "minIterations": 2,
                "maxIterations": 100,
                "maxError": settings.get("error", 0.1),
                "maxIterationsV": 100,
                "maxErrorV": settings.get("error", 0.1),
                "enableDivergenceSolver": True,
            },
            "WCSPH": {"stiffness": settings.get("stiffness", 50000.0), "exponent": 7.0},
        },
        "Materials": [
            {
                "id": "Fluid",
                "density0": case["density"],
                "viscosityMethod": 1,
                "Standard viscosity": {"viscosity": settings.get("viscosity", 0.01)},
            }
        ],
        "RigidBodies": [
            {
                "geometryFile": str(models / "UnitBox.obj"),
                "translation": [0.5 * tank, 0.5 * tank, 0],
                "scale": [tank, tank, 1],
                "isDynamic": False,
                "isWall": True,
                "mapInvert": True,
                "mapThickness": 0.0,
                "mapResolution": [30, 30, 20],
            }
        ],
        "FluidBlocks": [
            {
                "denseMode": 0,
                "start": [0, 0, -1],
                "end": [a + l0, 2 * a + l0, 1],
                "translation": [0.5 * l0 + case["aside"], 0.5 * l0, 0],
            }
        ],
    }


def simulate(case: dict) -> dict:
    """Positions (n, 2) [m] at the case's times, and what the run cost."""
    import pysplishsplash as sph

    frames, clock = [], {}

    def positions():
        fluid = sph.Simulation.getCurrent().getFluidModel(0)
        return np.array([fluid.getPosition(i)[:2] for i in range(fluid.numActiveParticles())])

    def watch():
        spent = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
        clock.setdefault("start", spent)  # after the first step: before it the maps of the walls are computed
        clock.update(end=spent, steps=clock.get("steps", -1) + 1)
        now = sph.TimeManager.getCurrent().getTime()
        if len(frames) < len(case["times"]) and now >= case["times"][len(frames)]:
            frames.append((now, positions()))

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.json"
        file.write_text(json.dumps(scene(case, Path(sys.prefix) / "bin/data/models")), encoding="utf-8")
        base = sph.Exec.SimulatorBase()
        base.init(
            sceneFile=str(file),
            useGui=False,
            outputDir=folder,
            initialPause=False,
            useCache=False,
            stopAt=case["until"] + 1e-6,
        )
        base.setTimeStepCB(watch)
        base.initSimulation()
        first = positions()
        base.runSimulation()
        base.cleanup()
    return {
        "t": np.array([t for t, _ in frames]),
        "x": np.array([x for _, x in frames]) - first.min(0) + 0.5 * case["spacing"],
        "steps": clock["steps"],
        "cpu_seconds": clock["end"] - clock["start"],
        "elements": len(first),
    }


if __name__ == "__main__":
    if sys.argv[1:] != ["install"] and PRELOAD not in os.environ.get("LD_PRELOAD", ""):
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | {"LD_PRELOAD": PRELOAD})
    main("splishsplash", NEEDS, simulate)
