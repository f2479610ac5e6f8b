"""Reading and writing of several fields of one length by one kernel: Taichi's to_numpy compiles one for each field."""

import numpy as np

from .backend import ti


@ti.data_oriented
class FieldIO:
    """Reads and writes scalar, vector and matrix fields by name, each of ``capacity`` rows. Numbers are passed as f64,
    which holds f32 and i32 exactly."""

    def __init__(self, fields: dict, capacity: int):
        self.fields, self.capacity = fields, capacity
        self.layout, self.columns = {}, []  # for each field: shape of a row, type, its columns; all scalar fields
        for name, field in fields.items():
            shape = (field.n, field.m)[: field.ndim] if isinstance(field, ti.MatrixField) else ()
            parts = [field.get_scalar_field(*place) for place in np.ndindex(shape)] if shape else [field]
            start = len(self.columns)
            self.columns += parts
            self.layout[name] = shape, ti.lang.util.to_numpy_type(field.dtype), slice(start, start + len(parts))

    def load(self, values: dict, count: int) -> None:
        """Write arrays (count, ...) into the fields; other fields and rows become zero."""
        rows = np.zeros((self.capacity, len(self.columns)))
        for name, (shape, _, columns) in self.layout.items():
            if name in values:
                rows[:count, columns] = np.broadcast_to(values[name], (count, *shape)).reshape(count, -1)
        self._write_fields(rows)

    def read(self, count: int) -> dict[str, np.ndarray]:
        """Return the first rows (count, ...) of all fields by name."""
        rows = np.empty((self.capacity, len(self.columns)))
        self._read_fields(rows)
        return {
            name: rows[:count, columns].reshape(count, *shape).astype(kind)
            for name, (shape, kind, columns) in self.layout.items()
        }

    @ti.kernel
    def _write_fields(self, rows: ti.types.ndarray(ti.f64, 2)):
        for i in range(self.capacity):
            for k, column in ti.static(enumerate(self.columns)):
                column[i] = ti.cast(rows[i, k], column.dtype)

    @ti.kernel
    def _read_fields(self, rows: ti.types.ndarray(ti.f64, 2)):
        for i in range(self.capacity):
            for k, column in ti.static(enumerate(self.columns)):
                rows[i, k] = ti.cast(column[i], ti.f64)
