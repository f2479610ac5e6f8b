"""Every field a particle carries from one step to the next, in one SNode structure; load and read back."""

import numpy as np

from ..runtime.backend import double_field, real, ti
from ..runtime.field_io import FieldIO
from ..runtime.stages import stage

FLUID, WALL, DUMMY = 0, 1, 2


@ti.data_oriented
class Particles:
    """State of ``capacity`` particles in d dimensions. FieldIO are kept in the order (cell, id) by the bins.

    A fluid particle moves; a wall particle is fixed and carries pressure; a dummy wall particle only fills the
    particle number density.
    """

    def __init__(
        self,
        positions,
        kinds,
        velocity,
        volumes,
        carries_stress,
        axisymmetric=False,
        extra=(),
        frictions=(),
        to_come=0,
        mixes=0,
    ):
        d = positions.shape[1]
        t = 3 if axisymmetric else d
        self.dimension, self.tensor_dimension = d, t  # of vectors, and of stresses and gradients
        self.axisymmetric = axisymmetric
        self.usual_volume = float(volumes[0])  # of every particle but rings [m3, m2 in 2-D]
        self.capacity = len(positions) + to_come  # rows, some of them for particles that enter later
        self.carries_stress = carries_stress
        makers = {
            "x": lambda: double_field(self.capacity, d),  # position [m]
            "u": lambda: ti.Vector.field(d, real()),  # velocity [m/s]
            "p": lambda: ti.field(real()),  # pressure [Pa]
            "shear_rate": lambda: ti.field(real()),  # sqrt(2 D:D) [1/s]
            "kind": lambda: ti.field(ti.i32),  # FLUID, WALL or DUMMY
            "id": lambda: ti.field(ti.i32),  # persistent number of the particle
        }
        if carries_stress:
            makers["stress"] = lambda: ti.Matrix.field(t, t, real())  # deviatoric, at most tau_y where rigid [Pa]
            makers["plastic_rate"] = lambda: ti.Matrix.field(t, t, real())  # deviatoric rate q of the yield law [1/s]
        if axisymmetric:
            makers["ring"] = lambda: ti.field(real())  # volume of the ring [m3]
        # structure [-] of a thixotropic material; still, the time at rest [s] (sleep); number of the mix; a, the
        # acceleration of the last step [m/s2]; released, 1 where a loose wall has let go
        others = {"mix": lambda: ti.field(ti.i32), "a": lambda: ti.Vector.field(d, real())}
        makers |= {name: others.get(name, lambda: ti.field(real())) for name in extra}
        for k, law in enumerate(frictions):  # of each wall with friction
            makers[f"slip_{k}"] = lambda: ti.Vector.field(d, real())  # velocity on the wall beneath [m/s]
            if law.yield_value > 0.0:
                makers[f"traction_{k}"] = lambda: ti.Vector.field(d, real())  # yield part of the wall's traction [Pa]
        self.carried = {name: make() for name, make in makers.items()}
        self._twin = {name: make() for name, make in makers.items()}  # scratch of the reorder
        self._pairs = [(item, self._twin[name]) for name, item in self.carried.items()]
        for name, item in self.carried.items():
            setattr(self, name, item)
        self.count = ti.field(ti.i32, ())  # particles in use
        self.source_row = ti.field(ti.i32)  # row that each particle had before the reorder
        others = [item for pair in self._pairs if pair[0] is not self.x for item in pair]
        for item in (*others, self.source_row):
            ti.root.dense(ti.i, self.capacity).place(item)
        self.rows = FieldIO(self.carried, self.capacity)
        n = len(positions)
        self.load({"x": positions, "u": velocity, "kind": kinds, "id": np.arange(n), "ring": volumes, "mix": mixes})

    def load(self, state: dict) -> None:
        """Put arrays (n, ...) into the fields; what is not named becomes zero."""
        self.count[None] = len(state["x"])
        self.rows.load(state, len(state["x"]))

    def read(self) -> dict[str, np.ndarray]:
        """All carried fields (n, ...), in the order of the rows."""
        return self.rows.read(self.count[None])

    def append(self, positions, velocity, mix: int = 0) -> None:
        """Fluid particles of a mix at positions (m, d) [m] with a velocity (d,) [m/s], numbered on; all else of them is
        zero."""
        old, m = self.read(), len(positions)
        new = {name: np.zeros((m, *rows.shape[1:]), rows.dtype) for name, rows in old.items()}
        n = len(old["id"])
        new |= {"x": positions, "u": np.tile(velocity, (m, 1)), "kind": np.full(m, FLUID), "id": np.arange(n, n + m)}
        new["mix"] = np.full(m, mix)
        self.load({name: np.concatenate([old[name], new[name]]) for name in old})

    @ti.func
    def volume(self, i):
        """Volume of particle i [m3]; per metre of depth in a plane scene [m2]."""
        volume = ti.cast(self.usual_volume, float)
        if ti.static(self.axisymmetric):
            volume = self.ring[i]
        return volume

    @stage
    def reorder(self):
        """Move every carried field from row source_row[i] to row i."""
        for i in range(self.count[None]):
            for field, twin in ti.static(self._pairs):
                twin[i] = field[self.source_row[i]]
        for i in range(self.count[None]):
            for field, twin in ti.static(self._pairs):
                field[i] = twin[i]
