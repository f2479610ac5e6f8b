"""Summary of a run, as in summary.json: what it tells about itself, the errors to be expected, and all of it in
words."""

import subprocess
from contextlib import suppress
from functools import cache
from html import escape
from pathlib import Path

from .. import __version__
from ..forecast import accuracy
from ..input.labels import in_words, is_measure, mix_in_words, title, written
from ..units import quote

CHECKOUT = Path(__file__).resolve().parents[2]
GIT = "git", "--no-optional-locks", "describe", "--always", "--dirty", "--exclude", "*"


@cache
def commit(root: Path = CHECKOUT) -> str | None:
    """Commit of a checkout, by default that of this package, with -dirty where files differ; None if it is none."""
    with suppress(OSError):  # there is no git
        if (root / ".git").exists():
            return subprocess.run(GIT, cwd=root, capture_output=True, text=True).stdout.strip() or None
    return None


class Summary(dict):
    """Content of summary.json, that prints as a table, in a notebook, too."""

    def rows(self) -> list[tuple[str, str]]:
        """Name and value of each entry, in words."""
        return [entry(key, value) for key, value in self.items()]

    def __str__(self):
        return "\n".join(f"{name:28} {value}" for name, value in self.rows())

    def _repr_html_(self) -> str:
        cells = (f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in self.rows())
        return f"<table>{''.join(cells)}</table>"


def entry(key: str, value) -> tuple[str, str]:
    """An entry of a summary in words: a result with its unit, mixes by their constants."""
    if isinstance(value, dict):
        return in_words(key), ", ".join(f"{in_words(k)} {quote(v, '')}" for k, v in value.items() if v is not None)
    if key == "materials":
        return "mix", "; ".join(map(mix_in_words, value))
    if is_measure(key):
        return title(key), "not known" if value is None else written(key, value)
    return in_words(key), quote(value, "")


def summary(sim) -> Summary:
    """Everything that describes the run, JSON-ready."""
    facts = sim.facts() | {"version": __version__} | ({"commit": commit()} if commit() else {})
    found = accuracy.errors_of_run(facts) if "slump_m" in facts else None
    if found:
        _, height, error = found  # None beyond the measured ones
        facts |= {
            "slump_expected_error_m": height * error.slump if error else None,
            "spread_expected_error_m": 2.0 * height * error.reach if error else None,
        }
    return Summary(facts)
