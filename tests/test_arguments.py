"""Every argument of the public Python API, given some 70 kinds of nonsense, is accepted as valid or refused in one line
that names it.
    python -m pytest -n0 -m "slow or long" tests/test_arguments.py   # more of them, and for an hour all

A call may end in a SceneError that names the argument, in the TypeError of Python's own call signature, or in a result
of finite numbers; then the argument must have been of the kind of the valid one. No call may hang.
"""

import contextlib
import dataclasses
import io
import math
import os
import random
import re
import signal
import time
import warnings
from datetime import date
from decimal import Decimal
from fractions import Fraction
from functools import partial
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

import taichi_mps as mps
from taichi_mps.engine.problem.problem import Problem
from taichi_mps.engine.simulation import simulation
from taichi_mps.io import checkpoint, history, run_folder, vtkhdf, vtu
from taichi_mps.study import calibrate, chart, emulator, measured_mixes, require, sweep
from taichi_mps.units import in_unit
from taichi_mps.viz import render
from tests.support.recorded import recorded
from tests.support.scenes import hose, parts

LONGEST = 600  # [s] of a call on a busy machine: the refined slump of calibrate takes 6 s of a quiet one
NAN, INF = math.nan, math.inf

VALUES = {
    "None": None,
    "True": True,
    "False": False,
    "nan": NAN,
    "inf": INF,
    "-inf": -INF,
    "-0.0": -0.0,
    "0": 0,
    "-1": -1,
    "2": 2,
    "3.7": 3.7,
    "1e300": 1e300,
    "-1e300": -1e300,
    "1e-300": 1e-300,
    "10**400": 10**400,
    "2**63": 2**63,
    "''": "",
    "'abc'": "abc",
    "'1'": "1",
    "'nan'": "nan",
    "'-1'": "-1",
    "'1e400'": "1e400",
    "'3 furlong'": "3 furlong",
    "'a\\nb'": "a\nb",
    "'\\0'": "\0",
    "b'1'": b"1",
    "()": (),
    "[]": [],
    "(0.1,)": (0.1,),
    "(0.1, 0.2)": (0.1, 0.2),
    "[0.1, 0.2, 0.3]": [0.1, 0.2, 0.3],
    "7 numbers": (0.1,) * 7,
    "a place": [[0.1, 0.2]],
    "a place in 3-D": [[0.1, 0.2, 0.3]],
    "ragged": [[1.0, 2.0], [1.0]],
    "(nan, 0.1)": (NAN, 0.1),
    "(inf, 0.1)": (INF, 0.1),
    "(10**400, 1)": (10**400, 1),
    "('a', 'b')": ("a", "b"),
    "(None, None)": (None, None),
    "(True, False)": (True, False),
    "[[nan, nan]]": [[NAN, NAN]],
    "1j": 1j,
    "float64 nan": np.float64(NAN),
    "float32": np.float32(0.5),
    "int64": np.int64(-3),
    "empty array": np.zeros(0),
    "(0, 2) array": np.zeros((0, 2)),
    "(2, 3, 4) array": np.zeros((2, 3, 4)),
    "0-d array": np.array(0.2),
    "(1,) array": np.array([0.2]),
    "text array": np.array(["x", "y"]),
    "object array": np.array([None, 1.0], object),
    "complex array": np.array([1j, 2.0]),
    "masked": np.ma.masked,
    "date": date(2026, 1, 1),
    "Decimal nan": Decimal("nan"),
    "Fraction": Fraction(1, 3),
    "{}": {},
    "{'a': 1}": {"a": 1},
    "{1, 2}": {1, 2},
    "object": object(),
    "len": len,
    "lambda": lambda: None,
    "int": int,
    "path": Path("nowhere/here"),
    "generator": (k for k in range(2)),
    "range": range(3),
    "module": math,
}


# ---- what is called ---------------------------------------------------------------------------------------------
def law(rate, structure):
    return 40.0 + 20.0 * rate


class Bench:
    """What the calls need: one small simulation, a run folder, snapshots."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.scene = mps.Scene(**parts(measure=mps.measure.front, until=0.05))
        self.sim = mps.Simulation(self.scene)
        self.sim.step()
        self.plane, self.box = self.scene.walls[0], mps.Box((0.0, 0.0), (0.4, 0.3))
        self.cone = mps.Cone(0.1, 0.05, 0.3)
        self.flat = mps.measure.still(self.scene.fluid, 0.1)
        self.body = mps.measure.still(mps.fill(self.cone, 0.03), 0.03)
        self.cylinder = mps.Cylinder((0.0, 0.0, 0.0), 0.3, (0.0, 0.0, 1.0), length=1.0)
        self.square = [(0.0, 0.0), (0.2, 0.0), (0.2, 0.2), (0.0, 0.2)]
        self.solid = mps.Solid.prism(self.square, 0.05, 0.2)
        self.inlet, self.cavity = hose(), mps.Cavity((0.0, 0.0), (0.5, 0.5), self.scene.walls, 0.1)
        self.run, *_ = recorded(folder / "run", 2, "time", self.scene)
        self.problem, self.state = self.sim.problem, self.sim.state()
        self.picture = folder / "frame_00000.png"
        render.save(np.full((20, 30, 3), 200, np.uint8), self.picture)
        self.mesh = mps.write_bars(folder / "bars.stl", [[(0.0, 0.0, 0.0), (0.0, 0.0, 0.2)]], 0.03)
        self.rows = emulator.read(emulator.TABLES / "slump.csv")
        self.emulator = emulator.emulator_of()
        checkpoint.save(self.sim, folder / "checkpoint.h5")

    def init(self, **keywords):
        """``init`` without what it starts, so that the simulation stays."""
        before = mps.backend._session
        try:
            with patch.object(mps.backend.ti, "init"):
                return mps.init(**keywords)
        finally:
            mps.backend._session = before

    def ran(self, until):
        self.sim._schedules.clear()  # of what ``every`` and ``each_step`` were given
        self.sim._each_step[:] = [lambda sim: sim.interrupt()]
        return self.sim.run(until)

    def made(self, **keywords):
        with patch.object(simulation.Simulation, "_build"):
            mps.Simulation(**keywords)

    def targets(self) -> dict:
        """Name -> (function, its sound keyword arguments)."""
        m, s, body, x = mps.measure, self.flat, self.body, self.scene.fluid
        xz = {"low": (0.0, 0.0), "high": (0.5, 0.4)}
        plane = {
            "point": (0.0, 0.0),
            "normal": (0.0, 1.0),
            "velocity": (0.1, 0.0),
            "slip": False,
            "loose": False,
            "mirror": False,
            "friction": mps.Friction(yield_value=1.0),
            "name": "floor",
        }
        cylinder = {
            "point": (0.0, 0.0, 0.0),
            "radius": 0.3,
            "axis": (0.0, 0.0, 1.0),
            "inside": True,
            "angular_velocity": 1.0,
            "velocity": 0.1,
            "slip": False,
            "slope": 0.1,
            "length": 1.0,
            "loose": False,
            "thin": False,
            "friction": None,
            "name": "pipe",
        }
        solid = {
            "values": self.solid.values,
            "low": (0.0, 0.0),
            "cell": 0.05,
            "velocity": (0.1, 0.0),
            "slip": False,
            "loose": False,
            "friction": None,
            "name": "block",
            "angular_velocity": 1.0,
            "pivot": (0.0, 0.0),
            "axis": None,
        }
        inlet = {
            "centre": (0.2, 0.3, 1.5),
            "direction": (0.0, 0.0, -1.0),
            "radius": 0.3,
            "rate": 0.1,
            "volume": 0.3,
            "start": 0.0,
            "material": mps.Bingham(),
            "path": ((0.0, 0, 0, 0), (1.0, 1, 0, 0)),
            "height": 0.2,
        }
        scene = parts() | {"wall_particles": None, "velocity": 0.0 * x, "gravity": (0.0, -9.81), "until": 1.0}
        scene |= {"periodic": (False, False), "axisymmetric": False, "stop_at_rest": False, "inlets": ()}
        scene |= {"cavity": None, "measure": m.front, "check": None, "over_time": None, "enlarged_by": ""}
        scene |= {"wall_loads": False, "outline": (x,), "parameters": {}}
        snapshot = {field.name: getattr(s, field.name) for field in dataclasses.fields(s)}
        bingham = {name: field.default for name, field in mps.Bingham.model_fields.items()}
        hb = {
            "density": 2300.0,
            "yield_value": 300.0,
            "consistency": 50.0,
            "flow_index": 0.8,
            "structuration": 0.1,
            "destructuration": 0.01,
            "age": 60.0,
        }
        curve = {"density": 2300.0, "yield_value": 40.0, "typical_slope": 50.0, "shear_stress": law, "growth": law}
        channel = {
            "area": 0.02,
            "density": 2300.0,
            "yield_value": 50.0,
            "width": 0.2,
            "length": 1.0,
            "normal_stress": False,
            "gravity": 9.81,
            "points": 20,
        }
        flow = {"volume": 0.005, "height": 0.3, "density": 2300.0, "yield_value": 50.0, "plastic_viscosity": 50.0}
        cone = {"material": mps.Bingham(), "spacing": 0.05, "until": 1.0, "model": "axisymmetric"}
        study = {"scene": "slump", "yield_value": "500:1000:2", "model": "axisymmetric", "spacing": 0.02}
        slump = {name: field.default for name, field in calibrate.Measurements.model_fields.items()} | {"slump": 0.2}
        wanted = {name: field.default for name, field in require.Wanted.model_fields.items()}
        return {
            "main": (mps.main, {"argv": ["scenes"]}),
            "Box": (mps.Box, {**xz}),
            "Box.contains": (self.box.contains, {"x": x}),
            "Cone": (mps.Cone, {"base_radius": 0.1, "top_radius": 0.05, "height": 0.3}),
            "Cone.contains": (self.cone.contains, {"x": body.x}),
            "fill": (mps.fill, {"solid": self.box, "spacing": 0.1, "mirrors": ()}),
            "fill_rings": (mps.fill_rings, {"solid": self.cone, "spacing": 0.02}),
            "lattice": (mps.lattice, {**xz, "spacing": 0.1, "offset": 0.5}),
            "rings": (mps.rings, {"inner_radius": 0.0, "outer_radius": 0.5, "spacing": 0.1}),
            "shell": (mps.shell, {**xz, "spacing": 0.1, "layers": 3}),
            "Solid": (mps.Solid, solid),
            "Solid.of": (mps.Solid.of, {"distance": lambda x: x[:, 0] - 0.2, **xz, "cell": 0.1, "slip": False}),
            "Solid.prism": (mps.Solid.prism, {"corners": self.square, "cell": 0.05, "reach": 0.2, "along": (0.0, 0.3)}),
            "Solid.bars": (
                mps.Solid.bars,
                {"places": [(0.0, 0.0)], "radius": 0.1, "upright": (0.0, 0.2), "cell": 0.05, "reach": 0.1},
            ),
            "Solid.from_mesh": (
                mps.Solid.from_mesh,
                {"path": self.mesh, "cell": 0.04, "reach": 0.05, "inside": False, "scale": 1.0},
            ),
            "Solid.section": (self.solid.section, {"y": 0.0, "time": 0.0}),
            "Solid.distance": (self.solid.distance, {"x": x, "time": 0.0}),
            "polygon_distance": (mps.polygon_distance, {"x": x, "corners": self.square}),
            "write_bars": (
                mps.write_bars,
                {"path": "b.stl", "ends": [[(0.0, 0.0, 0.0), (0.0, 0.0, 0.2)]], "radius": 0.03, "sides": 12},
            ),
            "Plane": (mps.Plane, plane),
            "Plane.distance": (self.plane.distance, {"x": x, "time": 0.0}),
            "Cylinder": (mps.Cylinder, cylinder),
            "Cylinder.distance": (self.cylinder.distance, {"x": body.x, "time": 0.0}),
            "Friction": (mps.Friction, {"yield_value": 1.0, "viscous_constant": 1.0}),
            "box_planes": (mps.box_planes, {**xz, "slip": False, "friction": None}),
            "behind": (mps.behind, {"walls": self.scene.walls, "x": x, "thick": 0.2}),
            "Cavity": (mps.Cavity, {**xz, "walls": self.scene.walls, "spacing": 0.1}),
            "Cavity.filled": (self.cavity.filled, {"s": s}),
            "Cavity.report": (self.cavity.report, {"s": s}),
            "Cavity.by_height": (self.cavity.by_height, {"s": s}),
            "slump_cone": (mps.slump_cone, cone),
            "Inlet": (mps.Inlet, inlet),
            "Inlet.layer": (self.inlet.layer, {"spacing": 0.1}),
            "Inlet.speed": (self.inlet.speed, {"spacing": 0.1}),
            "Inlet.velocity": (self.inlet.velocity, {"spacing": 0.1, "time": 0.0}),
            "Inlet.displacement": (self.inlet.displacement, {"time": 0.0}),
            "Inlet.layers": (self.inlet.layers, {"spacing": 0.1}),
            "Bingham": (mps.Bingham, bingham),
            "Bingham.flows": (mps.Bingham().flows, {"rate": 1.0}),
            "Bingham.within": (mps.Bingham(critical_strain_rate="rational").within, {"time": 1.0}),
            "Concrete": (
                mps.Concrete,
                bingham | {"flow_index": 1.0, "structuration": 0.0, "destructuration": 0.005, "age": 0.0},
            ),
            "HerschelBulkley": (mps.HerschelBulkley, hb),
            "FlowCurve": (mps.FlowCurve, curve),
            "Newtonian": (mps.Newtonian, {"density": 1000.0, "viscosity": 0.001}),
            "rational_critical_strain_rate": (
                mps.rational_critical_strain_rate,
                {"plastic_viscosity": 50.0, "yield_value": 300.0, "time": 5.0, "error": 0.01},
            ),
            "Implicit": (mps.Implicit, dict(mps.Implicit())),
            "SemiImplicit": (mps.SemiImplicit, dict(mps.SemiImplicit())),
            "Scene": (mps.Scene, scene),
            "Scene.unfold": (self.scene.unfold, {"snapshot": s}),
            "Scene.volumes_at": (self.scene.volumes_at, {"x": x}),
            "Problem": (Problem, {"scene": self.scene, "numerics": mps.Implicit()}),
            "init": (self.init, {"arch": "cpu", "precision": "f64", "threads": 1, "debug": False}),
            "checked": (mps.checked, {"function": law}),
            "Simulation": (self.made, {"scene": self.scene, "numerics": mps.Implicit(), "profile": False}),
            "Simulation.step": (self.sim.step, {"until": None}),
            "Simulation.run": (self.ran, {"until": 1.0}),
            "Simulation.every": (self.sim.every, {"interval": 0.01, "callback": len}),
            "Simulation.each_step": (self.sim.each_step, {"callback": lambda sim: None}),
            "Simulation.load": (self.sim.load, {"state": self.state}),
            "Simulation.restart": (self.sim.restart, {"problem": self.problem, "state": self.state}),
            "Snapshot": (mps.measure.Snapshot, snapshot),
            "measure.still": (m.still, {"x": x, "spacing": 0.1}),
            "measure.embed": (m.embed, {"x": x}),
            "measure.reflected": (m.reflected, {"vectors": x, "normal": (1.0, 0.0), "point": (0.0, 0.0)}),
            "measure.mirrored": (m.mirrored, {"s": s, "point": (0.0, 0.0), "normal": (1.0, 0.0)}),
            "measure.revolved": (m.revolved, {"s": s}),
            "measure.surface": (m.surface, {"s": s, "points": [[0.2]]}),
            "measure.over": (m.over, {"s": s, "low": (0.1,), "high": (0.3,)}),
            "measure.top_height": (m.top_height, {"s": body, "radius": 0.05}),
            "measure.level": (m.level, {"s": s, "low": (0.1,), "high": (0.3,)}),
            "measure.standing_level": (m.standing_level, {"s": s, "low": (0.1,), "high": (0.3,)}),
            "measure.spread": (m.spread, {"s": body}),
            "measure.slump": (m.slump, {"s": body, "height": 0.3, "axis_radius": 0.03}),
            "measure.front": (m.front, {"s": s}),
            "measure.depth": (m.depth, {"s": s, "where": s.x[:, 0] > 0.1, "area": 0.5}),
            "measure.by_height": (m.by_height, {"s": s, "values": s.p, "edges": [0.0, 0.2, 0.4]}),
            "measure.clearance": (m.clearance, {"s": s, "walls": self.scene.walls}),
            "measure.time_of": (m.time_of, {"time": [0.0, 1.0, 2.0], "values": [0.0, 0.5, 2.0], "level": 1.0}),
            "spread_at_rest": (
                mps.rest_shapes.spread_at_rest,
                {"volume": 0.005, "density": 2300.0, "yield_value": 100.0, "gravity": 9.81},
            ),
            "channel_at_rest": (mps.rest_shapes.channel_at_rest, channel),
            "radius_of_flow": (mps.rest_shapes.radius_of_flow, flow | {"time": 5.0, "gravity": 9.81}),
            "root": (mps.rest_shapes.root, {"function": lambda x: x - 0.1, "low": 0.0}),
            "catalogue.build": (partial(mps.catalogue.build, "film"), {"spacing": 0.02}),
            "catalogue.load": (mps.catalogue.load, {"name": "film"}),
            "checkpoint.save": (checkpoint.save, {"sim": self.sim, "path": "checkpoint.h5"}),
            "checkpoint.restore": (checkpoint.restore, {"path": self.folder / "checkpoint.h5", "scene": self.scene}),
            "RunFolder": (run_folder.RunFolder, {"path": "run"}),
            "RunFolder.create": (run_folder.RunFolder("other").create, {"overwrite": True}),
            "RunFolder.write_summary": (self.run.write_summary, {"summary": {"a": 1}}),
            "read_history": (history.read_history, {"path": self.run.history}),
            "Trajectory": (vtkhdf.Trajectory, {"path": self.run.trajectory}),
            "Trajectory.replay": (
                lambda **k: list(vtkhdf.Trajectory(self.run.trajectory).replay(**k)),
                {"scene_file": None, "scene": self.scene, "chosen": None},
            ),
            "vtu": (
                vtu.vtu,
                {
                    "outputs": list(vtkhdf.Trajectory(self.run.trajectory).replay(scene=self.scene)),
                    "folder": "vtu",
                    "whole": False,
                    "smooth": False,
                },
            ),
            "png": (mps.png, {"folder": "frames", "view": "speed", "width": 64, "height": 48}),
            "gif": (mps.gif, {"frames": [self.picture], "out": "a.gif", "fps": 10, "width": 40}),
            "Renderer": (
                render.Renderer,
                {"scene": self.scene, "width": 64, "height": 48, "view": "speed"}
                | {"limits": (0.0, 1.0), "beside": (), "beads": True},
            ),
            "Renderer.draw": (
                render.Renderer(self.scene, 64, 48).draw,
                {"snapshot": s, "measures": {"slump_m": 0.1}},
            ),
            "sweep.values": (sweep.values, {"text": "50:100:3", "key": "values"}),
            "sweep.cases": (sweep.cases, study),
            "sweep": (
                partial(sweep.sweep, watch=None),
                {"executor": "nowhere", "out": "s", "workers": 1, **study},
            ),
            "emulator_of": (emulator.emulator_of, {"table": emulator.TABLES / "slump.csv", "test": "slump"}),
            "Emulator": (emulator.Emulator, {"rows": self.rows[:60], "constants": emulator.BINGHAM}),
            "Emulator.at": (
                lambda first, second, grid: self.emulator.at(first, second, grid=grid),
                {"first": -2.0, "second": -4.0, "grid": False},
            ),
            "Measurements": (calibrate.Measurements, slump),
            "calibrate": (
                calibrate.calibrate,
                {"slump": 0.2, "spread": 0.4, "rho": 2300.0, "study": None, "check": False},
            ),
            "Wanted": (require.Wanted, wanted),
            "calibrate_list": (measured_mixes.calibrate_list, {"rows": [], "study": None}),
            "read_list": (measured_mixes.read_list, {"path": "list.csv"}),
            "slump_chart": (chart.slump_chart, {"out": "chart.png", "study": None}),
        }


# ---- how a call ends --------------------------------------------------------------------------------------------
class TooLong(BaseException):
    """A call took longer than LONGEST."""


def stop(*_):
    raise TooLong


GOOD = "refused", "signature", "works"
OWN = re.compile(r"missing|unexpected|takes \d|positional|required argument|multiple values|keyword")
OF_ANY_KIND = {  # arguments that take what is no number, and those where nan is said to be allowed
    ("lattice", "offset"),
    ("gif", "frames"),
    ("Bingham.flows", "rate"),
    ("Emulator.at", "first"),
    ("Emulator.at", "second"),
    ("sweep.cases", "spacing"),
    ("sweep.cases", "yield_value"),
    ("main", "argv"),
    ("channel_at_rest", "length"),
    ("measure.time_of", "values"),
    ("Plane", "velocity"),  # rows of a time and values, as the next three
    ("Cylinder", "velocity"),
    ("Solid", "velocity"),
    ("Scene", "gravity"),
}


def numeric(value) -> bool:
    """Is this one real number, also as text?"""
    if (
        isinstance(value, bool | np.bool_ | bytes)
        or value is np.ma.masked
        or (isinstance(value, np.ndarray) and value.ndim)
    ):
        return False
    with contextlib.suppress(Exception):
        return math.isfinite(in_unit("m", value) if isinstance(value, str) and " " in value else float(value))
    return False


def all_numbers(value) -> bool:
    """Are these real, finite numbers, of one shape?"""
    with contextlib.suppress(Exception):
        array = np.asarray(list(value) if isinstance(value, range) else value)
        return array.dtype.kind in "iuf" and array.ndim > 0 and bool(np.all(np.isfinite(array)))
    return False


def of_the_kind(value, sound) -> bool:
    """Could this mean something where ``sound`` does?"""
    if isinstance(sound, bool):
        return isinstance(value, bool | np.bool_) or str(value) in ("0", "1", "-0.0")
    if isinstance(sound, int | float):
        return numeric(value)
    if isinstance(sound, str | Path):
        return isinstance(value, str | Path)
    if isinstance(sound, tuple | list | np.ndarray) and np.asarray(sound).dtype.kind in "iuf" and len(sound):
        return all_numbers(value)
    return not has_nan(value)


def has_nan(value) -> bool:
    with contextlib.suppress(Exception), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return bool(np.any(np.isnan(np.asarray(value, float))))
    return False


def sound_result(value, depth=0) -> bool:
    """Are all numbers in a result finite?"""
    if isinstance(value, float | np.floating):
        return math.isfinite(value)
    if isinstance(value, np.ndarray):
        return value.dtype.kind != "f" or bool(np.all(np.isfinite(np.asarray(value))))
    if depth < 3 and isinstance(value, dict):
        return all(sound_result(item, depth + 1) for item in value.values())
    if depth < 3 and isinstance(value, tuple | list):
        return all(sound_result(item, depth + 1) for item in value)
    return True


CALLED = {"path": "mesh|run|checkpoint|table|path", "name": "scene|name", "study": "table|study"}  # in messages
CALLED |= {"first": "point|yield_value", "second": "point|plastic_viscosity", "table": "table|status"}
CALLED |= {"smooth": "surface|smooth"}


def names(text, argument) -> bool:
    argument = f"({CALLED.get(argument, argument)})"
    return re.search(rf"(?<![A-Za-z0-9_]){argument}(?![A-Za-z0-9_])", text) is not None


MAY_BE_INFINITE = {
    "Solid.distance",
    "Cylinder.distance",
    "read_history",
    "Emulator.at",
    "measure.time_of",
    "measure.surface",
    "measure.over",
    "measure.top_height",
    "measure.slump",
}  # where there is no wall, no value, no T500


def ending(name, function, sound, argument, value) -> str:
    """How a call ends: 'refused', 'signature', 'works', or what is wrong."""
    signal.signal(signal.SIGALRM, stop)
    signal.alarm(LONGEST)
    try:
        with (
            warnings.catch_warnings(),
            contextlib.redirect_stderr(io.StringIO()),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            warnings.simplefilter("ignore")
            result = function(**(sound | {argument: value}))
    except mps.SceneError as error:
        text = str(error)
        if "\n" in text:
            return f"two lines: {text!r}"
        meant = of_the_kind(value, sound[argument])  # then it is another argument that it does not go with
        others = sound if meant else ("executor", argument) if name == "sweep" else (argument,)
        named = any(names(text, other) for other in others)
        return "refused" if named else f"not named: {text}"
    except TypeError as error:
        if OWN.search(str(error)):
            return "signature"
        return f"exception TypeError: {error}"
    except BaseException as error:
        return f"exception {type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    if value is None or (name, argument) in OF_ANY_KIND:
        return "works"
    if sound[argument] is not None and not of_the_kind(value, sound[argument]):
        return f"taken: gives {str(result)[:60]}"
    if name not in MAY_BE_INFINITE and not sound_result(result):
        return f"not finite: gives {str(result)[:60]}"
    return "works"


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arguments")
    before = Path.cwd()
    os.chdir(folder)
    yield Bench(folder)
    os.chdir(before)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seconds", "seed"),
    [(3.0, 1), pytest.param(60.0, 2, marks=pytest.mark.long), pytest.param(3600.0, 3, marks=pytest.mark.long)],
)
def test_a_bad_argument_is_named_or_means_something(bench, seconds, seed):
    wrong = [f"{call} {end}" for call, end in tried(bench, seconds, seed) if end not in GOOD]
    assert not wrong, "\n".join(wrong)


def test_a_sound_call_works(bench):
    for name, (function, sound) in bench.targets().items():
        argument = next(iter(sound))
        if name not in ("sweep", "read_list"):  # of a folder that is not there
            assert ending(name, function, sound, argument, sound[argument]) == "works", name


def calls(targets, seed):
    """(target, argument, name of the value) of all calls, in an order of this seed."""
    every = [(name, argument, key) for name, (_, sound) in targets.items() for argument in sound for key in VALUES]
    random.Random(seed).shuffle(every)
    return every


def tried(bench, seconds, seed):
    """Yield (call, ending) of as many calls as fit into these seconds."""
    begin, targets = time.monotonic(), bench.targets()
    for name, argument, key in calls(targets, seed):
        if time.monotonic() - begin > seconds:
            return
        value = (k for k in range(2)) if key == "generator" else VALUES[key]
        yield f"{name}({argument}={key})", ending(name, *targets[name], argument, value)
