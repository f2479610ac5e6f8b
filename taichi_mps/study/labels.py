"""How the columns of a study are shown."""

from ..problem.labels import is_measure


def spelled(value) -> str:
    """A value of a parameter as text."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def measures(rows) -> list[str]:
    """The columns that are results of the scene and have a unit."""
    names = dict.fromkeys(name for row in rows for name in row)
    return [name for name in names if is_measure(name)]
