"""The folder of a study: a journal to which each row is added as soon as it is known, and the table made from it.

``journal.jsonl``   one row a line, flushed to the disk before the next case is looked at; it alone is read again
``results.csv``     the same rows in the order of the cases, one column a quantity; with pyarrow ``results.parquet``
"""

import csv
import json
import os
from contextlib import ExitStack, suppress
from pathlib import Path

from ..io.lock import locked
from ..units import SceneError

LOCK = "study.lock"


class Results:
    """Rows by key. Use it in a ``with``: one study at a time may write to a folder."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.journal, self.table = self.folder / "journal.jsonl", self.folder / "results.csv"
        self.rows: dict[str, dict] = {}
        self._file = self._opened = None

    def __enter__(self):
        there = {path.name for path in self.folder.iterdir()} if self.folder.is_dir() else set()
        if there - {LOCK} and self.journal.name not in there:
            raise SceneError(f"out = {self.folder}: holds other files and no study; must be a new or a study's folder")
        with ExitStack() as opened:
            opened.enter_context(locked(self.folder / LOCK, "another study, process"))
            self._file = opened.enter_context(open(self.journal, "a+b"))
            self._read()
            self._opened = opened.pop_all()
        return self

    def __exit__(self, *_):
        self._opened.close()

    def _read(self) -> None:
        """The rows of the journal, which stays open for more."""
        self._file.seek(0)
        whole = self._file.read()
        end = whole.rfind(b"\n") + 1  # what stands after the last end of line was cut off by the end of a process
        self._file.truncate(end)
        for number, line in enumerate(whole[:end].splitlines(), 1):
            try:
                row = json.loads(line)
                self.rows[row["key"]], _ = row, row["status"]
            except (ValueError, TypeError, KeyError):
                raise SceneError(
                    f"{self.journal}: line {number} is no row; delete it to compute its case anew"
                ) from None

    def add(self, row: dict) -> None:
        """Keep a row for good."""
        self._file.write(json.dumps(row).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        self.rows[row["key"]] = row

    def write(self, rows: list[dict]) -> None:
        """Make the table of these rows anew, whole or not at all."""
        columns = list(dict.fromkeys(name for row in rows for name in row))
        if not columns:
            return
        fresh = self.table.with_suffix(".part")
        with open(fresh, "w", newline="", encoding="utf-8") as file:
            lines = csv.DictWriter(file, columns, restval="")
            lines.writeheader()
            lines.writerows(rows)
        os.replace(fresh, self.table)
        with suppress(ImportError):
            import pyarrow
            import pyarrow.parquet

            full = {name: uniform([row.get(name) for row in rows]) for name in columns}
            pyarrow.parquet.write_table(pyarrow.table(full), fresh)
            os.replace(fresh, self.table.with_suffix(".parquet"))


def uniform(values: list) -> list:
    """A column of one kind, as Parquet has them: text where some is text, numbers as float."""
    if any(isinstance(value, str) for value in values):
        return [None if value is None else str(value) for value in values]
    return [float(value) if isinstance(value, int) else value for value in values]


def read(path) -> list[dict]:
    """The rows of a results.csv or of a study's folder; lines that begin with # are remarks. Numbers as float, nothing
    as None."""
    path = Path(path)
    path = path / "results.csv" if path.is_dir() else path
    if not path.is_file():
        raise SceneError(f"table = {path}: no such file; must be a study's folder or its results.csv")
    with open(path, newline="", encoding="utf-8", errors="replace") as file:
        lines = csv.DictReader(line for line in file if not line.startswith("#"))
        if "status" not in (lines.fieldnames or ()):
            raise SceneError(f"table = {path}: has no column status; must be a study's folder or its results.csv")
        return [{name: number(row[name] or "") for name in lines.fieldnames} for row in lines]


def number(text: str):
    """A cell as float where it is one, None where it is empty."""
    try:
        return float(text)
    except ValueError:
        return text or None
