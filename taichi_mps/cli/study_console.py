"""What a study shows while it goes on: a live table on a terminal, a line for each case elsewhere."""

from contextlib import contextmanager

from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.table import Table

from ..problem.labels import in_words, title, written
from ..study.labels import measures, spelled

LINES = 20  # of the live table: the last ones that came


@contextmanager
def watching(varied, quiet: bool):
    """``watch(rows, total)`` for a sweep in which the parameters of these names differ."""
    console = Console(stderr=True)
    order = []  # keys in the order in which they came

    def news(rows):
        fresh = [row for row in rows if row["key"] not in order]
        order.extend(row["key"] for row in fresh)
        return fresh

    if quiet:
        yield None
        return
    if not console.is_terminal:

        def tell(rows, total):
            before = len(order)
            for number, row in enumerate(news(rows), before + 1):
                words = [f"{number}/{total}", *(f"{in_words(name)} {spelled(row[name])}" for name in varied)]
                console.print(f"{', '.join(words)}: {outcome(row)}", soft_wrap=True, highlight=False, markup=False)

        yield tell
        return
    with Live(console=console, transient=False) as live:

        def draw(rows, total):
            news(rows)
            live.update(table({row["key"]: row for row in rows}, order, varied, total))

        yield draw


def differing(cases) -> list[str]:
    """The parameters that are not the same in all cases."""
    return [name for name in cases[0].parameters if len({str(case.parameters[name]) for case in cases}) > 1]


def outcome(row) -> str:
    """The measures of a row in a few words, or why there are none."""
    if row["status"] != "done":
        return f"{row['status']}: {row['reason']}"
    return ", ".join(f"{title(name)} {cell(name, row[name])}" for name in measures([row]) if row[name] is not None)


def cell(name, value) -> str:
    """A result with its unit, '-' where there is none."""
    return "-" if value is None else written(name, value)


def table(rows, order, varied, total) -> Table:
    """The last rows that came."""
    names = measures(rows.values())
    view = Table(title=f"{len(order)} of {total} cases")
    for name in [*map(in_words, varied), *map(title, names), ""]:
        view.add_column(name, justify="right")
    for key in order[-LINES:]:
        row = rows[key]
        parameters = [spelled(row[name]) for name in varied]
        reason = "" if row["status"] == "done" else escape(row["reason"])
        view.add_row(*parameters, *(cell(name, row.get(name)) for name in names), reason)
    return view
