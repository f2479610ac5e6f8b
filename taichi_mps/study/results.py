"""The folder of a study: a journal to which each row is added as soon as it is known, and the table made from it.

``journal.jsonl``   one row a line, flushed to the disk before the next case is looked at; it alone is read again
``results.csv``     the same rows in the order of the cases, one column a quantity; with pyarrow ``results.parquet``
"""

import csv
import json
import os
from contextlib import contextmanager, suppress
from pathlib import Path

from ..io.lock import held
from ..problem.labels import is_measure
from ..units import SceneError, require, user_path
from . import lists

LOCK = "study.lock"
JOURNAL = "journal.jsonl"
TABLE = "results.csv"


class Results:
    """Rows by key, of an open journal."""

    def __init__(self, folder: Path, file):
        self.file, self.table = file, folder / TABLE
        self.rows: dict[str, dict] = {}
        file.seek(0)
        whole = file.read()
        end = whole.rfind(b"\n") + 1  # what stands after the last end of line was cut off by the end of a process
        file.truncate(end)
        for number, line in enumerate(whole[:end].splitlines(), 1):
            try:
                row = json.loads(line)
                self.rows[row["key"]], _ = row, row["status"]
            except (ValueError, TypeError, KeyError):
                raise SceneError(
                    f"{folder / JOURNAL}: line {number} is no row; delete it to compute its case anew"
                ) from None

    def add(self, row: dict) -> None:
        """Keep a row for good."""
        self.file.write(json.dumps(row).encode() + b"\n")
        self.file.flush()
        os.fsync(self.file.fileno())
        self.rows[row["key"]] = row

    def write(self, rows: list[dict]) -> None:
        """Make the table of these rows anew, whole or not at all."""
        if not rows:
            return
        fresh = self.table.with_suffix(".part")
        write(rows, fresh)
        os.replace(fresh, self.table)
        with suppress(ImportError):
            import pyarrow.csv
            import pyarrow.parquet

            kinds = pyarrow.csv.ConvertOptions(strings_can_be_null=True)
            pyarrow.parquet.write_table(pyarrow.csv.read_csv(self.table, convert_options=kinds), fresh)
            os.replace(fresh, self.table.with_suffix(".parquet"))


@contextmanager
def opened(folder):
    """The results of a study's folder, made if need be; one study at a time may write there."""
    folder = user_path(folder)
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    foreign = there - {LOCK} and JOURNAL not in there
    require(not foreign, f"out = {folder}: holds other files and no study; must be a new or a study's folder")
    with held(folder, LOCK, "another study, process"), open(folder / JOURNAL, "a+b") as file:
        yield Results(folder, file)


def write(rows: list[dict], path) -> None:
    """A table of rows as CSV, one column for each name in any of them, without those of curves (dict). Text that a
    spreadsheet would take for a formula begins with an apostrophe."""
    columns = list(dict.fromkeys(k for row in rows for k, cell in row.items() if k and not isinstance(cell, dict)))
    with open(path, "w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file)
        lines.writerow(map(harmless, columns))
        lines.writerows([harmless(row.get(name, "")) for name in columns] for row in rows)


def harmless(value):
    """A cell as it is; a text that is no number and begins as a formula with an apostrophe before it."""
    formula = isinstance(value, str) and value.lstrip()[:1] in set("=+-@") and isinstance(number(value), str)
    return f"'{value}" if formula else value


def read(path) -> list[dict]:
    """The rows of a results.csv or of a study's folder. Numbers as float, nothing as None."""
    path = user_path(path)
    path = path / TABLE if path.is_dir() else path
    rows, _ = lists.read(path)
    wrong = next((row[lists.WRONG] for row in rows if lists.WRONG in row), None)
    require(not wrong, f"table = {path}: {wrong}")
    none = f"table = {path}: has no column status; must be a study's folder or its results.csv"
    require("status" in rows[0], none)
    return [{name: number(cell) for name, cell in row.items()} for row in rows]


def number(text: str):
    """A cell as float where it is one, also with a decimal comma; None where it is empty."""
    with suppress(ValueError):
        return float(text.replace(",", "."))
    return text or None


def measures(rows) -> list[str]:
    """The columns that are results of the scene and have a unit."""
    names = dict.fromkeys(name for row in rows for name in row)
    return [name for name in names if is_measure(name)]
