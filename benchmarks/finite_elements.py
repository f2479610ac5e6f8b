"""Finite elements for the slump cone: a Bingham fluid with inertia, independent of any particle.

    python benchmarks/finite_elements.py rows      # four rows of the reference again: results/finite_elements.md
    python benchmarks/finite_elements.py contact   # two rules of the contact line, three meshes, 100 and 1000 Pa
    python benchmarks/finite_elements.py draw      # docs/figures/contact_line.png of what `contact` found

Axisymmetric, no slip on the plate, the mould gone at once; true Bingham, without a regularisation, by the augmented
Lagrangian of Fortin and Glowinski (1983). Velocities are biquadratic (Q2), pressures linear and discontinuous (P1) in
each quadrilateral; both together meet the inf-sup condition. A step moves the mesh with the fluid, makes a new one
below the new surface, carries the velocities over along the paths of particles, and solves for the new ones (BDF2).

Lengths are in heights of the cone H, times in sqrt(H/g), stresses in rho g H: two numbers are left, tau_y/(rho g H) and
eta/(rho H sqrt(g H)).
"""

import argparse
import sys
import time
from dataclasses import dataclass

import numpy as np
import points
import scipy.sparse as sparse
from scipy.interpolate import PchipInterpolator
from scipy.sparse.linalg import splu

from validation import columns, provenance

HEIGHT, GRAVITY, DENSITY = 0.3, 9.81, 2300.0  # [m], [m/s2], [kg/m3]
TIME = np.sqrt(HEIGHT / GRAVITY)  # [s]
SPEED = np.sqrt(GRAVITY * HEIGHT)  # [m/s]
BASE, TOP = 1.0 / 3.0, 1.0 / 6.0  # radii of the cone [H]

DISPLACEMENT = 0.006  # [H] at most in a step
LONGEST_STEP = 0.004 / TIME  # up to 0.6 s, then growing with the time to the power 1.5
FIRST_STEP = 0.0004 / TIME
PENALTY = 5.0  # of the augmented Lagrangian, over the viscosity
RELAXATION = 1.6  # of the strain rate in it
TOLERANCE = 1e-4  # of the velocities, over the largest
MAX_ITERATIONS = 600
ARRESTED = 2e-5 / SPEED  # largest speed of a body that has come to rest
GRADED = 0.4  # size of the elements at the rim over their mean
KINK = 0.35  # [rad] from which a bend of the surface, the edge of the mould, stays a corner of elements


# ---- elements: Q2 and P1 on the square (-1, 1)^2 -----------------------------------------------------------------
def quadratic(x):
    """Values (..., 3) of the three quadratic functions with nodes -1, 0, 1."""
    return np.stack([0.5 * x * (x - 1.0), 1.0 - x * x, 0.5 * x * (x + 1.0)], -1)


def quadratic_slope(x):
    """Derivatives (..., 3) of the shape functions ``quadratic``."""
    return np.stack([x - 0.5, -2.0 * x, x + 0.5], -1)


def products(first, second):
    """Functions (n, 9) of two coordinates, as products of three functions (n, 3) of each."""
    return (first[:, :, None] * second[:, None, :]).reshape(-1, 9)


GAUSS, GAUSS_WEIGHT = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)]), np.array([5.0, 8.0, 5.0]) / 9.0
XI, ETA = (axis.ravel() for axis in np.meshgrid(GAUSS, GAUSS, indexing="ij"))
WEIGHT = np.outer(GAUSS_WEIGHT, GAUSS_WEIGHT).ravel()
SHAPE = products(quadratic(XI), quadratic(ETA))  # at the nine Gauss points, (9, 9)
SHAPE_XI = products(quadratic_slope(XI), quadratic(ETA))
SHAPE_ETA = products(quadratic(XI), quadratic_slope(ETA))
PRESSURE = np.stack([np.ones(9), XI, ETA], -1)
STRAINS = 4  # components of the strain rate: sqrt(2) d_rr, sqrt(2) d_zz, 2 d_rz, sqrt(2) d_tt; their square is 2 d:d


class FoldedError(Exception):
    """A mesh with an element that is turned over."""


@dataclass
class Geometry:
    """Geometry of a mesh for integrals: at each Gauss point weight 2 pi r dr dz (e, 9), radius and height (e, 9), and
    derivatives of the shape functions by r and z (e, 9, 9)."""

    weight: np.ndarray
    radius: np.ndarray
    height: np.ndarray
    by_r: np.ndarray
    by_z: np.ndarray

    @property
    def volume(self) -> float:
        return float(self.weight.sum())


class Space:
    """Q2/P1 elements on a grid of nx by ny quadrilaterals; node (i, j) of 2 nx + 1 by 2 ny + 1 has the number
    ``number[i, j]``, i from the axis outwards, j from the plate upwards."""

    def __init__(self, nx: int, ny: int):
        self.nx, self.ny = nx, ny
        self.shape = 2 * nx + 1, 2 * ny + 1
        self.nodes = self.shape[0] * self.shape[1]
        self.number = np.arange(self.nodes).reshape(self.shape)
        corner = [(2 * i, 2 * j) for i in range(nx) for j in range(ny)]
        self.elements = np.array([self.number[i : i + 3, j : j + 3].ravel() for i, j in corner])
        fixed = np.zeros((self.nodes, 2), bool)
        fixed[self.number[0], 0] = True  # no radial velocity on the axis
        fixed[self.number[:, 0]] = True  # no slip on the plate
        self.fixed = fixed.ravel()
        self.free = np.flatnonzero(~self.fixed)
        self.unknowns = np.stack([2 * self.elements, 2 * self.elements + 1], -1).reshape(-1, 18)  # of each element
        self.rim = np.r_[self.number[-1], self.number[::-1, -1][1:]]  # nodes of the surface, from the plate to the axis

    def geometry(self, x) -> Geometry:
        """Integrals on the mesh with nodes x (n, 2); FoldedError where it is folded."""
        r, z = x[self.elements].transpose(2, 0, 1)
        r_xi, z_xi, r_eta, z_eta = r @ SHAPE_XI.T, z @ SHAPE_XI.T, r @ SHAPE_ETA.T, z @ SHAPE_ETA.T
        area = r_xi * z_eta - z_xi * r_eta
        if area.min() <= 0.0:
            raise FoldedError
        by_r = (z_eta[..., None] * SHAPE_XI - z_xi[..., None] * SHAPE_ETA) / area[..., None]
        by_z = (r_xi[..., None] * SHAPE_ETA - r_eta[..., None] * SHAPE_XI) / area[..., None]
        radius = r @ SHAPE.T
        return Geometry(2.0 * np.pi * radius * area * WEIGHT, radius, z @ SHAPE.T, by_r, by_z)

    def matrix(self, blocks, rows, columns, shape):
        """Sparse matrix of blocks (e, a, b) with the numbers of their rows (e, a) and columns (e, b)."""
        rows, columns = np.broadcast_arrays(rows[:, :, None], columns[:, None, :])
        return sparse.csr_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=shape)


class Equations:
    """Momentum and continuity on a mesh, with a mass of the time step: (mass M + penalty K) u - C^T p = f, C u = 0."""

    def __init__(self, space: Space, x, penalty: float, mass: float):
        self.space, self.penalty = space, penalty
        g = self.geometry = space.geometry(x)
        e, free, of_all = len(space.elements), space.free, 2 * space.nodes
        strain = np.zeros((e, 9, STRAINS, 18))
        hoop = SHAPE[None] / g.radius[..., None]
        strain[:, :, 0, 0::2], strain[:, :, 1, 1::2] = np.sqrt(2.0) * g.by_r, np.sqrt(2.0) * g.by_z
        strain[:, :, 2, 0::2], strain[:, :, 2, 1::2] = g.by_z, g.by_r
        strain[:, :, 3, 0::2] = np.sqrt(2.0) * hoop
        divergence = np.zeros((e, 9, 18))
        divergence[:, :, 0::2], divergence[:, :, 1::2] = g.by_r + hoop, g.by_z
        at = np.arange(9 * STRAINS * e).reshape(e, 9 * STRAINS)
        self.point_weight = np.repeat(g.weight.ravel(), STRAINS)
        strain = strain.reshape(e, 9 * STRAINS, 18)
        self.strain = space.matrix(strain, at, space.unknowns, (at.size, of_all))[:, free]
        self.strain_transposed = self.strain.T.tocsr()
        constraint = np.einsum("eg,gk,egd->ekd", g.weight, PRESSURE, divergence)
        constraint = space.matrix(constraint, np.arange(3 * e).reshape(e, 3), space.unknowns, (3 * e, of_all))[:, free]
        load = np.zeros((space.nodes, 2))
        np.add.at(load[:, 1], space.elements, -g.weight @ SHAPE)
        self.load = load.ravel()[free]
        masses = np.einsum("eg,gi,gj->eij", g.weight, SHAPE, SHAPE)
        masses = space.matrix(masses, space.elements, space.elements, (space.nodes,) * 2)
        self.mass = sparse.kron(masses, sparse.eye(2)).tocsr()[free]
        viscous = self.strain_transposed @ sparse.diags(self.point_weight) @ self.strain
        saddle = [
            [penalty * viscous + mass * self.mass[:, free], constraint.T],
            [constraint, -1e-9 * sparse.eye(3 * e)],
        ]
        self.factors = splu(sparse.bmat(saddle).tocsc(), permc_spec="COLAMD", diag_pivot_thresh=0.01)

    def solve(self, yield_stress, viscosity, force, tolerance, iterations, rate, stress):
        """Velocities (2 n,) of the Bingham fluid, by Uzawa iterations on its strain rate and stress (points, 4)."""
        velocity, nothing = np.zeros(len(self.space.free)), np.zeros(3 * len(self.space.elements))
        for k in range(iterations):
            pull = self.strain_transposed @ (self.point_weight * (self.penalty * rate - stress).ravel())
            new = self.factors.solve(np.r_[force + pull, nothing])[: len(velocity)]
            of_velocity = RELAXATION * (self.strain @ new).reshape(-1, STRAINS) + (1.0 - RELAXATION) * rate
            trial = stress + self.penalty * of_velocity
            size = np.linalg.norm(trial, axis=1) + 1e-300
            rate = np.maximum(0.0, 1.0 - yield_stress / size)[:, None] * trial / (viscosity + self.penalty)
            stress = stress + self.penalty * (of_velocity - rate)
            change, velocity = np.abs(new - velocity).max(), new
            if k > 8 and change < tolerance:
                break
        u = np.zeros(2 * self.space.nodes)
        u[self.space.free] = velocity
        return u, rate, stress


# ---- the mesh below a surface ------------------------------------------------------------------------------------
def graded(t, size):
    """Places t in 0..1 moved so that elements at 0 have this size over their mean."""
    return size * t + (1.0 - size) * t * t


def resampled(line, count, size, keep_kink):
    """A line (k, 2) with so many points, evenly but for the size at its beginning; a kink stays at an element's end."""
    arc = np.r_[0.0, np.cumsum(np.hypot(*np.diff(line, axis=0).T))]
    at = arc[-1] * graded(np.linspace(0.0, 1.0, count), size)
    bend = np.abs(np.diff(np.unwrap(np.arctan2(*np.diff(line, axis=0).T[::-1]))))
    if len(bend) > 6 and keep_kink:
        k = 2 + bend[2:-2].argmax()
        if bend[k] > KINK:
            node = 2 * int(np.clip(np.round(0.5 * np.abs(at - arc[k + 1]).argmin()), 1, (count - 3) // 2))
            if 0.25 * at[node] < arc[k + 1] < 4.0 * at[node]:
                at = np.interp(at, [0.0, at[node], arc[-1]], [0.0, arc[k + 1], arc[-1]])
    return np.stack([PchipInterpolator(arc, coordinate)(at) for coordinate in line.T], -1)


def transfinite(space: Space, surface, shift, keep_kink):
    """Nodes (n, 2) below a surface (k, 2), from the plate to the axis: its sides blended, its upper right corner at the
    farthest point of r/r_max + z/z_max, moved by some nodes."""
    far = (surface / surface.max(axis=0)).sum(axis=1).argmax()
    k = int(np.clip(np.clip(far, 2, len(surface) - 3) + shift, 3, len(surface) - 4))
    (mx, my), side_size = space.shape, 0.5 + 0.5 * GRADED
    right, top = resampled(surface[: k + 1], my, GRADED, keep_kink), resampled(surface[k:], mx, 1.0, keep_kink)[::-1]
    across, up = 1.0 - graded(np.linspace(1.0, 0.0, mx), side_size), graded(np.linspace(0.0, 1.0, my), side_size)
    bottom = np.stack([surface[0, 0] * across, 0.0 * across], -1)
    left = np.stack([0.0 * up, surface[-1, 1] * up], -1)
    i, j = np.linspace(0.0, 1.0, mx)[:, None], np.linspace(0.0, 1.0, my)[None, :]
    xi = ((1.0 - j) * across[:, None] + j * i)[..., None]
    eta = ((1.0 - i) * up[None] + i * graded(j, GRADED))[..., None]
    x = (1.0 - eta) * bottom[:, None] + eta * top[:, None] + (1.0 - xi) * left[None] + xi * right[None]
    corners = (1.0 - xi) * (1.0 - eta) * bottom[0] + xi * (1.0 - eta) * bottom[-1]
    corners = corners + (1.0 - xi) * eta * top[0] + xi * eta * top[-1]
    return (x - corners).reshape(-1, 2)


def straightened(space: Space, x):
    """The mesh with middle nodes in the middle of straight sides."""
    x = x.reshape(*space.shape, 2).copy()
    x[1::2, ::2] = 0.5 * (x[:-1:2, ::2] + x[2::2, ::2])
    x[:, 1::2] = 0.5 * (x[:, :-1:2] + x[:, 2::2])
    return x.reshape(-1, 2)


def meshed(space: Space, surface):
    """Nodes (n, 2) of the first mesh below a surface that does not fold."""
    for change in (lambda space, x: x, straightened):
        for shift in (0, 2, -2, 4, -4, 6, -6, 8, -8):
            for keep_kink in (True, False):
                x = change(space, transfinite(space, surface, shift, keep_kink))
                try:
                    space.geometry(x)
                except FoldedError:
                    continue
                return x
    raise FoldedError


def located(space: Space, moved, x):
    """Numbers (n, 9) of nodes and their weights, by which fields of a mesh with nodes ``moved`` are read at points x,
    by Newton's method; points a little outside are read beyond the elements at the border."""
    logical = np.stack(np.meshgrid(*(0.5 * np.arange(n) for n in space.shape), indexing="ij"), -1).reshape(-1, 2)
    most, best, nearest = np.array([space.nx, space.ny]), logical.copy(), np.full(len(x), np.inf)
    for _ in range(13):
        nodes, at = in_elements(space, logical)
        weights = products(quadratic(at[:, 0]), quadratic(at[:, 1]))
        by_xi = products(quadratic_slope(at[:, 0]), quadratic(at[:, 1]))
        by_eta = products(quadratic(at[:, 0]), quadratic_slope(at[:, 1]))
        corner = moved[nodes]
        miss = x - np.einsum("ni,nik->nk", weights, corner)
        nearer = np.linalg.norm(miss, axis=1) < nearest
        nearest[nearer], best[nearer] = np.linalg.norm(miss, axis=1)[nearer], logical[nearer]
        slope = np.stack([np.einsum("ni,nik->nk", by, corner) for by in (by_xi, by_eta)], -1)
        slope[np.abs(np.linalg.det(slope)) < 1e-14] = np.eye(2)
        change = 0.5 * np.linalg.solve(slope, miss[..., None])[..., 0]
        logical = np.clip(logical + np.clip(change, -0.7, 0.7), -0.25, most + 0.25)
    nodes, at = in_elements(space, best)
    return nodes, products(quadratic(at[:, 0]), quadratic(at[:, 1]))


def in_elements(space: Space, logical):
    """Nodes (n, 9) of the elements of logical coordinates (n, 2), and the coordinates (n, 2) in these."""
    k = np.clip(np.floor(logical).astype(int), 0, [space.nx - 1, space.ny - 1])
    return space.elements[k[:, 0] * space.ny + k[:, 1]], 2.0 * (logical - k) - 1.0


# ---- the fall ----------------------------------------------------------------------------------------------------
def cone(count):
    """The surface (k, 2) of the cone, from the plate to the axis."""
    side = np.stack([np.linspace(BASE, TOP, count), np.linspace(0.0, 1.0, count)], -1)
    return np.vstack([side, np.stack([np.linspace(TOP, 0.0, 21)[1:], np.ones(20)], -1)])


def rolls_near(line, k):
    """Rule of the contact line: a node of the tongue ahead of it that has come near the plate rolls onto it."""
    ahead, high = line[k, 0] - line[0, 0], line[k, 1]
    return ahead >= 0.0 and (high < 0.15 * np.hypot(*(line[k] - line[k - 1])) or high < 0.35 * ahead)


def rolls_on_touch(line, k):
    """Rule of the contact line: a node of the tongue ahead of it that has reached the plate is on it."""
    return line[k, 0] >= line[0, 0] and line[k, 1] <= 0.0


RULES = {"near": rolls_near, "touch": rolls_on_touch}


def rolled(line, rule, most):
    """A moved surface whose contact with the plate is the farthest of its first nodes that the rule puts there."""
    contact = max((k for k in range(1, most) if line[: k + 1, 1].max() <= 0.02 and rule(line, k)), default=0)
    line = line[contact:].copy()
    line[0, 1], line[-1, 0] = 0.0, 0.0
    line[:, 1] = np.maximum(line[:, 1], 0.0)
    return line


def mean_top(surface, radius):
    """Mean height [H] of a surface within a radius [H] of the axis, weighted with the area."""
    line = surface[::-1]
    r = np.linspace(0.0, radius, 41)
    return np.trapezoid(np.interp(r, np.maximum.accumulate(line[:, 0]), line[:, 1]) * r, r) / (0.5 * radius**2)


@dataclass
class State:
    """A moment: ``time`` [sqrt(H/g)], ``surface`` (k, 2) [H], largest ``speed`` [sqrt(g H)]; ``arrested``: at rest."""

    time: float
    surface: np.ndarray
    speed: float
    volume: float
    arrested: bool = False

    def in_millimetres(self) -> dict:
        """Columns of the reference table: time [s], slump of the axis and of the middle 20 mm, slump flow, contact
        [mm]."""
        size, middle = 1e3 * HEIGHT, 0.02 / HEIGHT
        return {
            "time_s": TIME * self.time,
            "slump_mm": size * (1.0 - self.surface[-1, 1]),
            "mean20_mm": size * (1.0 - mean_top(self.surface, middle)),
            "spread_mm": 2.0 * size * self.surface[:, 0].max(),
            "contact_mm": 2.0 * size * self.surface[0, 0],
            "vmax_m_s": SPEED * self.speed,
            "volume_ratio": self.volume,
        }


def fall(yield_stress, viscosity, nx, ny, rule="near", until=5.0):
    """States of a cone with a yield stress [Pa] and a plastic viscosity [Pa s], until it rests or a time [s]."""
    tau = yield_stress / (DENSITY * GRAVITY * HEIGHT)
    eta = viscosity / (DENSITY * SPEED * HEIGHT)
    space, surface = Space(nx, ny), cone(2 * ny + 1)
    x = meshed(space, surface)
    volume, end, slow = space.geometry(x).volume, until / TIME, 0
    penalty, least = PENALTY * eta, 2e-6 * min(1.0, 0.042 / eta)
    points = 9 * len(space.elements)
    rate, stress = np.zeros((points, STRAINS)), np.zeros((points, STRAINS))
    now, before, t, dt, last, speed = np.zeros(2 * space.nodes), None, 0.0, FIRST_STEP, FIRST_STEP, 1.0
    # the first velocity is that after half of the first step: found by a step that is not taken
    first = Equations(space, x, penalty, 1.0 / dt)
    moving, rate, stress = first.solve(tau, eta, first.load, least, 1500, rate, stress)
    moving = 0.5 * moving
    while t < end - 1e-9:
        if before is not None:
            moving = now + dt / (2.0 * last) * (now - before)  # velocity in the middle of the step, AB2
        moved = x + dt * moving.reshape(-1, 2)
        surface = rolled(moved[space.rim], RULES[rule], space.ny // 2 + 4)
        x = meshed(space, surface)
        scale = (volume / space.geometry(x).volume) ** (1.0 / 3.0)
        surface = surface * (1.0 + 0.5 * (scale - 1.0))  # what the new mesh cuts off or adds
        x = meshed(space, surface)
        nodes, weights = located(space, moved, x)
        carried, older = (carry(space, nodes, weights, u) for u in (now, now if before is None else before))
        ratio = dt / last
        mass, of_now, of_older = 1.0 / dt, 1.0 / dt, 0.0
        if before is not None or t > 0.0:  # BDF2 with steps of two lengths
            mass = (1.0 + 2.0 * ratio) / (1.0 + ratio) / dt
            of_now, of_older = (1.0 + ratio) / dt, -ratio * ratio / (1.0 + ratio) / dt
        equations = Equations(space, x, penalty, mass)
        force = equations.load + equations.mass @ (of_now * carried + of_older * older)
        now, rate, stress = equations.solve(
            tau, eta, force, max(1e-9, min(least, TOLERANCE * speed)), MAX_ITERATIONS if t > 0.0 else 1500, rate, stress
        )
        before, last, t = carried, dt, t + dt
        speed = np.hypot(now[0::2], now[1::2]).max()
        slow = slow + 1 if speed < ARRESTED else 0
        yield State(t, surface, speed, equations.geometry.volume / volume, slow >= 2)
        if slow >= 2:
            return
        longest = LONGEST_STEP * max(1.0, t * TIME / 0.6) ** 1.5
        dt = min(DISPLACEMENT / speed, longest, 1.25 * last, max(end - t, 1e-6))


def carry(space: Space, nodes, weights, u):
    """Velocities (2 n,) read at other nodes, zero where they are fixed."""
    carried = np.einsum("ni,nik->nk", weights, u.reshape(-1, 2)[nodes]).ravel()
    carried[space.fixed] = 0.0
    return carried


# ---- what is made of it ------------------------------------------------------------------------------------------
ROWS = (1000.0, 50.0, 5.0), (500.0, 50.0, 5.0), (300.0, 50.0, 0.5), (100.0, 50.0, 0.3)  # [Pa], [Pa s], until [s]
STATED = {"slump_mm": 0.4, "mean20_mm": 0.4, "spread_mm": 1.0}  # error of the reference [mm]
MESHES = (8, 14), (12, 20), (18, 30)
STUDY = 100.0, 1000.0  # [Pa]


def last_of(yield_stress, viscosity, mesh, rule, until):
    """Measures of the last state of a fall, with the CPU seconds that it took."""
    begin, state = time.process_time(), None
    for state in fall(yield_stress, viscosity, *mesh, rule, until):
        if sys.stderr.isatty():
            print(f"\r{TIME * state.time:.3f} s", end="", file=sys.stderr)
    return state.in_millimetres() | {"arrested": state.arrested, "cpu_seconds": time.process_time() - begin}


def reference(yield_stress, viscosity, until):
    """Measures (dict) of the reference at that time, or at rest."""
    own = columns("A_fe_inertial_slump_summary.csv", model="A", tau_Pa=yield_stress, eta_Pa_s=viscosity)
    nearest = np.lexsort([own["kind"] != "fixed", np.abs(own["time_s"] - until)])[0]
    return {name: own[name][nearest] for name in STATED}


def head() -> dict:
    """Head of a result: no numerics of the particles enter it."""
    return provenance.facts() | {provenance.NUMERICS: "none"}


def rows() -> int:
    """Four rows of the reference beside this program, on its coarser mesh; 1 if one is off by more than is stated."""
    lines, wrong = [], 0
    for yield_stress, viscosity, until in ROWS:
        found, known = (
            last_of(yield_stress, viscosity, (12, 20), "near", until),
            reference(yield_stress, viscosity, until),
        )
        for name, error in STATED.items():
            off = bool(abs(found[name] - known[name]) > error)
            wrong += off
            cells = f"{found[name]:.2f}", f"{known[name]:.2f}", f"{error:g}" + off * " (missed)"
            when = "rest" if found["arrested"] else f"{until:g}"
            cells = when, name.replace("_mm", " [mm]"), *cells, f"{found['cpu_seconds']:.0f}"
            lines.append([f"{yield_stress:g}", *cells])
            print(" | ".join(lines[-1]), flush=True)
    about = (
        f"Made with `python benchmarks/finite_elements.py rows` ({points.stamp(head())}): 12 by 20 elements, beside "
    )
    table = points.table(["yield stress [Pa]", "at [s]", "", "here", "reference", "stated error", "CPU-s"], lines)
    text = f"{about}the reference on 18 by 30.\n\n{table}\n"
    (points.RESULTS / "finite_elements.md").write_text(text, encoding="utf-8")
    return int(wrong > 0)


def contact() -> int:
    """Rest shapes with two rules of the contact line on three meshes: results/contact_line.json, kept row by row."""
    found = points.load("contact_line")
    for yield_stress in STUDY:
        for mesh in MESHES:
            for rule in RULES:
                name = f"{yield_stress:g} Pa, {mesh[0]} x {mesh[1]}, {rule}"
                if name not in found:
                    found |= {"machine": head(), name: last_of(yield_stress, 50.0, mesh, rule, 3.0)}
                    points.save("contact_line", found)
                    print(name, found[name], flush=True)
    return 0


def draw() -> int:
    """Slump and slump flow of the contact study against the size of the elements: docs/figures/contact_line.png."""
    found = points.load("contact_line")
    figure, axes = points.pyplot().subplots(2, len(STUDY), figsize=(8, 5), sharex=True, layout="constrained")
    for column, yield_stress in zip(axes.T, STUDY, strict=True):
        for axis, name in zip(column, ("mean20_mm", "spread_mm"), strict=True):
            for rule in RULES:
                there = [(ny, found.get(f"{yield_stress:g} Pa, {nx} x {ny}, {rule}")) for nx, ny in MESHES]
                axis.plot([1.0 / ny for ny, f in there if f], [f[name] for _, f in there if f], "o-", label=rule)
            axis.set_ylabel({"mean20_mm": "slump [mm]", "spread_mm": "slump flow [mm]"}[name])
        column[0].set_title(f"{yield_stress:g} Pa, 50 Pa s")
        column[1].set_xlabel("size of an element, over the height of the cone")
    axes[0, 0].legend(title="a node rolls onto the plate")
    figure.savefig(points.FIGURES / "contact_line.png", dpi=100)
    return 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python benchmarks/finite_elements.py", description=__doc__.split("\n\n")[0])
    parser.add_argument("what", choices=("rows", "contact", "draw"))
    sys.exit({"rows": rows, "contact": contact, "draw": draw}[parser.parse_args().what]())
