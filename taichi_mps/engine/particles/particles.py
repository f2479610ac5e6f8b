"""Every field a particle carries from one step to the next; load and read back.

Each field is an array of its own, a dense node of Taichi's tree, in which the components of a vector or tensor lie side
by side. A stage reads two or three of a dozen fields of each neighbour; with one node for all it would load the others,
too.
"""

from dataclasses import dataclass

import numpy as np

from ..runtime.backend import double_field, real, ti
from ..runtime.field_io import FieldIO
from ..runtime.stages import no_op, stage

FLUID, WALL, DUMMY = 0, 1, 2
BOUNDARY, HALO, EXCLUDED = 3, 4, 5  # fluid at rest that a step does not compute (active_set.py)


@dataclass(frozen=True)
class Carried:
    """A field that a term wants the particles to carry: what it is, its unit, and its shape: 'scalar', 'integer',
    'vector' (d,) or 'tensor' (t, t)."""

    meaning: str
    unit: str
    shape: str = "scalar"


ALWAYS = {
    "x": Carried("position", "m", "vector"),
    "u": Carried("velocity", "m/s", "vector"),
    "p": Carried("pressure", "Pa"),
    "shear_rate": Carried("sqrt(2 D:D)", "1/s"),
    "kind": Carried("FLUID, WALL or DUMMY", "-", "integer"),
    "id": Carried("persistent number", "-", "integer"),
}
RING = {"ring": Carried("volume of the ring", "m3")}


@ti.data_oriented
class Particles:
    """State of ``capacity`` particles in d dimensions. Rows are kept in the order (cell, id) by the bins.

    A fluid particle moves; a wall particle is fixed and carries pressure; a dummy wall particle only fills the
    particle number density. Fluid that is ``excluded`` from a step lies in the rows behind those in use;
    ``restore_all`` brings it back before the fields are read (active_set.py). ``start``: arrays (n, ...) of what the
    particles carry at first, zero where nothing is said; ``volumes`` (n,) [m3]; ``carried``: fields that terms add to
    x, u, p, shear_rate, kind and id; ``to_come``: rows for particles that enter later.
    """

    def __init__(self, start: dict, volumes, carried: dict[str, Carried], axisymmetric=False, to_come: int = 0):
        n, d = start["x"].shape
        t = 3 if axisymmetric else d
        self.dimension, self.tensor_dimension = d, t  # dimension of vectors, and of tensors
        self.axisymmetric = axisymmetric
        self.usual_volume = float(volumes[0])  # volume of each particle, if it is no ring [m3, m2 in 2-D]
        self.capacity = n + to_come
        makers = {
            "scalar": lambda: ti.field(real()),
            "integer": lambda: ti.field(ti.i32),
            "vector": lambda: ti.Vector.field(d, real()),
            "tensor": lambda: ti.Matrix.field(t, t, real()),
        }
        specs = ALWAYS | (RING if axisymmetric else {}) | carried

        def make(name):
            return double_field(self.capacity, d) if name == "x" else makers[specs[name].shape]()

        self.carried = {name: make(name) for name in specs}
        self.carries_stress, self.has_grains = "stress" in specs, "slot" in specs
        self.buffers = [(field, make(name)) for name, field in self.carried.items()]  # scratch of the reorder
        vars(self).update(self.carried)
        self.has_walls = bool((np.asarray(start.get("kind", FLUID)) != FLUID).any())
        self.count = ti.field(ti.i32, ())  # particles in use
        self.excluded = ti.field(ti.i32, ())  # fluid particles behind them, which a step excludes
        self.restore_all = no_op  # bring these back
        self.source_row = ti.field(ti.i32)  # row that each particle had before the reorder
        all_but_x = [field for pair in self.buffers if pair[0] is not self.x for field in pair]
        for field in (*all_but_x, self.source_row):
            ti.root.dense(ti.i, self.capacity).place(field)
        self.field_io = FieldIO(self.carried, self.capacity)
        self.load({**start, "id": np.arange(n)} | ({"ring": volumes} if axisymmetric else {}))

    def load(self, state: dict) -> None:
        """Put arrays (n, ...) into the fields; what is not named becomes zero."""
        self.restore_all()
        self.count[None] = len(state["x"])
        self.field_io.load(state, len(state["x"]))

    @property
    def number(self) -> int:
        """Number of particles that are there."""
        return self.count[None] + self.excluded[None]

    def read(self) -> dict[str, np.ndarray]:
        """All carried fields (n, ...), in the order of the rows."""
        self.restore_all()
        return self.field_io.read(self.count[None])

    def append(self, positions, velocities, **fields) -> None:
        """Add fluid particles at positions (m, d) [m] with velocities (m, d) [m/s] and other ``fields`` that they
        carry; their numbers go on from those of the rows, and all else of them is zero."""
        state, m = self.read(), len(positions)
        new = {"x": positions, "u": velocities, "kind": FLUID, "id": len(state["x"]) + np.arange(m)} | fields
        for name, values in state.items():
            state[name] = np.concatenate([values, np.broadcast_to(new.get(name, 0.0), (m, *values.shape[1:]))])
        self.load(state)

    @ti.func
    def in_grain(self, i):
        """Whether particle i is of a grain."""
        grain = False
        if ti.static(self.has_grains):
            grain = self.slot[i] > 0
        return grain

    @ti.func
    def volume(self, i):
        """Volume of particle i [m3]; per metre of depth in a plane scene [m2]."""
        if ti.static(self.axisymmetric):
            return self.ring[i]
        else:
            return ti.cast(self.usual_volume, float)

    @stage("reorder")
    def reorder(self):
        """Move every carried field from row source_row[i] to row i."""
        for i in range(self.count[None]):
            for field, buffer in ti.static(self.buffers):
                buffer[i] = field[self.source_row[i]]
        for i in range(self.count[None]):
            for field, buffer in ti.static(self.buffers):
                field[i] = buffer[i]
