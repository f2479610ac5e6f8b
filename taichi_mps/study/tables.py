"""Tables: lists that users hand over as files, what their columns hold, and the folder of a study.

``journal.jsonl``   one row a line, flushed to the disk before the next case is looked at; it alone is read again
``results.csv``     the same rows in the order of the cases, one column a quantity; with pyarrow ``results.parquet``
"""

import csv
import io
import json
import os
import re
import unicodedata
from contextlib import contextmanager, suppress
from pathlib import Path

from ..io.lock import held
from ..problem.labels import is_measure
from ..spelling import in_unit
from ..units import SceneError, ordinary, require, user_path

LOCK = "study.lock"
JOURNAL = "journal.jsonl"
TABLE = "results.csv"
REMARK = re.compile(r'\s*"?#(?!\s*[,;\t]\s*["\w])')  # begins a remark before the head; '#,slump' is a head
SEPARATOR = re.compile(r'(?i)"?sep=(.)"?\s*')  # the first line by which Excel is told the delimiter
MOST_ROWS = 100_000  # some two hours of calibrations
DECIMAL = re.compile(r"^([-+]?\d+),(\d+)(?![\d.,])")  # a number with a comma, among semicolons
WRONG = None  # key of a row under which stands why its cells are none of the head's
# by field of Measurements and measure of a scene, beside its own name: of EN 12350, JIS A 1101, 1150 and 1116, and
# common ones; letters alone
SPELLINGS = {
    "slump": "setzmass affaissement zetmaat スランプ",
    "spread": "slumpflow sf slumpflowsf slumpspread setzfliessmass étalement vloeimaat スランプフロー",
    "t500": "t50 t50cm t500mm t500time slumpflowtime slumpflowtimet500 t500zeit 50cmフロー到達時間 500mmフロー到達時間 "
    "フロー到達時間 スランプフロー到達時間",
    "mini_cone": "minislumpflow minislumpspread miniconespread miniconeflow ミニスランプフロー",
    "v_funnel": "tv vfunneltime vfunnelflowtime trichterauslaufzeit vtrichter v漏斗 v漏斗流下時間 vロート "
    "vロート流下時間",
    "yield_value": "yieldstress fliessgrenze 降伏値 降伏応力",
    "plastic_viscosity": "plastischeviskosität 塑性粘度",
    "rho": "density ρ unitweight rohdichte frischbetonrohdichte massevolumique volumiekemassa 密度 単位容積質量",
}
BESIDE = {"value", "mean", "average", "avg", "measured", "test", "the", "of", "fresh", "concrete", "wert", "mittelwert"}
BESIDE |= {"diameter", "平均"}  # words beside a name that change nothing
BRACKETS = re.compile(r"[\[(]([^\])]*)[\])]")
STANDARD = re.compile(r"(?i)(en|din|jis|jsce|astm|iso|bs|nf)\b")  # in brackets
ALIKE = {"秒": "s", "sek": "s", "sek.": "s", "s": "s", "pa": "Pa", "pa s": "Pa s", "t/m3": "t/m3", "g/cm3": "g/cm3"}
UNITS = r"mm|cm|dm|m|in|inch|inches|ft|s|sec|min|kg/m\^?3|t/m\^?3|g/cm\^?3|kg/l|lb/ft\^?3|k?Pa|Pa[ .·*]?s|秒|sek\.?"
TAIL = re.compile(rf"(?i)(.+?)(?:[\s,/_]|\s+in\s+)\s*({UNITS})")  # a name and a unit without brackets


# ---- lists ----------------------------------------------------------------------------------------------------
def read_list(path, key: str = "table") -> list[dict[str, str]]:
    """The rows of a CSV file as text by the names of its head, without those that hold nothing: commas, semicolons or
    tabs between the cells, remarks (#) before the head; a decimal comma is a point where it can be nothing else. A row
    with more or fewer cells than the head says so under WRONG. SceneError, with the line, for what is no such file,
    which begins with the ``key`` that it was given by."""
    where = f"{key} = {path}: "
    try:
        text = decoded(ordinary(where[:-2], path, 1e8).read_bytes())
    except OSError as error:
        raise SceneError(f"{where}cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError:
        raise SceneError(f"{where}is no text in UTF-8, UTF-16, Shift-JIS or Windows-1252; must be a CSV file") from None
    lines = list(io.StringIO(text, newline=""))
    require(len(lines) <= MOST_ROWS, f"{where}has {len(lines)} lines; must have at most {MOST_ROWS}")
    line = text.count("\n", 0, text.find("\0")) + 1
    require("\0" not in text, f"{where}line {line} holds a NUL character; must be a CSV file, which is text")
    heads = (k for k, line in enumerate(lines) if re.search(r'[^\s,;"]', line) and not REMARK.match(line))
    skipped = next(heads, len(lines))
    told = SEPARATOR.fullmatch(lines[skipped]) if lines[skipped:] else None
    skipped += bool(told)
    first, found, none = skipped + 1, [], f"{where}is empty; must be a CSV file with a head and rows"
    require(lines[skipped:], none)
    try:
        cells = {sign: len(next(csv.reader(lines[skipped:], delimiter=sign))) for sign in "\t;,"}
        delimiter = told[1] if told else next((sign for sign in cells if cells[sign] > 1), ";")  # 18,5 is one cell
        reader = csv.reader(lines[skipped:], delimiter=delimiter, strict=True)
        for row in reader:
            cells = [DECIMAL.sub(r"\1.\2", cell.strip()) if delimiter == ";" else cell.strip() for cell in row]
            found += [(first, cells)] if any(cells) else []
            first = skipped + reader.line_num + 1
    except csv.Error as error:
        raise SceneError(
            f"{where}line {first} is no CSV ({error}); must be cells of at most {csv.field_size_limit()} characters, "
            "a quote in one written twice and the cell in quotes"
        ) from None
    require(found, none)
    (_, head), *rows = found
    require(rows, f"{where}has a head and no row; must have a line for each mix or case")
    head, width, table = [" ".join(name.split()) for name in head], len(head), []
    filled = [name or any(row[k:] and row[k] for _, row in rows) for k, name in enumerate(head)]
    names = [name or f"column {k}" for k, name in enumerate(head, 1)]
    twice = next((name for k, name in enumerate(names) if filled[k] and name in names[:k]), None)
    require(twice is None, f"{where}column '{twice}' stands there twice; must be once")
    for line, row in rows:
        table.append({names[k]: cell for k, cell in enumerate([*row, *[""] * width][:width]) if filled[k]})
        if len(row) != width:
            cells = " ".join(delimiter.join(row).split())
            table[-1][WRONG] = f"line {line} has {len(row)} cells, the head has {width}: {cells}" + (
                "; a number with a decimal comma must be in quotes" * (delimiter == "," and len(row) > width)
            )
    return table


def decoded(data: bytes) -> str:
    """Text of a file: UTF-8, UTF-16 by its mark, or what Excel writes in Japan (Shift-JIS) and in the west of
    Europe."""
    utf16 = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    japanese = re.search(rb"[\x81-\x9f][\x40-\xfc]", data)  # a kana or a kanji; a letter with an accent is above
    for encoding, may_be in (("utf-16", utf16), ("utf-8-sig", True), ("cp932", japanese)):
        if may_be:
            with suppress(UnicodeDecodeError):
                return data.decode(encoding)
    return data.decode("cp1252")


# ---- what a column holds ----------------------------------------------------------------------------------------
def key_of(text: str) -> str:
    """A name without what people write in several ways: its letters and digits alone, in small ones."""
    words = re.findall(r"[^\W_]+", unicodedata.normalize("NFKC", text).casefold())
    return "".join(word for word in words if word not in BESIDE).removesuffix("値")


def is_unit(text: str, fields) -> bool:
    """Whether a text in brackets is meant as a unit: no standard, no name of ours and no word beside one."""
    named = re.search(r"\w", text) and key_of(text) in ("", *fields)
    return bool(text) and not named and not STANDARD.match(text)


def quantity(column: str, fields: dict[str, str], unit_of) -> tuple[str | None, str]:
    """Content of a column by the names of ``fields``, {key_of(name): what it is}, None for another; and its unit, empty
    where it names none. SceneError for a unit that is not of the kind of ``unit_of(what it is)``."""
    text = unicodedata.normalize("NFKC", column)
    bare, units = BRACKETS.sub(" ", text).strip(), [unit.strip() for unit in BRACKETS.findall(text)]
    found, units = fields.get(key_of(bare)), [unit for unit in units if is_unit(unit, fields)]
    if not found and (tail := TAIL.fullmatch(bare)):
        found, units = fields.get(key_of(tail[1])), [tail[2]]
    if not found or not units:
        return found, ""
    ours = unit_of(found)
    for unit in (ALIKE.get(unit.lower(), unit) for unit in reversed(units)):
        with suppress(ValueError):
            in_unit(ours, f"1 {unit}")
            return found, unit
    require(len(key_of(bare)) <= 3, f"column '{column}': its unit must be {ours} or one of that kind")
    return None, ""  # an abbreviation of something else: SF [kg/m3] is silica fume


# ---- the folder of a study --------------------------------------------------------------------------------------
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
        """Append a row to the journal on the disk."""
        self.file.write(json.dumps(row).encode() + b"\n")
        self.file.flush()
        os.fsync(self.file.fileno())
        self.rows[row["key"]] = row

    def write(self, rows: list[dict]) -> None:
        """Rewrite the table with these rows, whole or not at all."""
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
    """Return a cell; a text that a spreadsheet would take for a formula gets an apostrophe before it."""
    formula = isinstance(value, str) and value.lstrip()[:1] in set("=+-@") and isinstance(number(value), str)
    return f"'{value}" if formula else value


def read(path) -> list[dict]:
    """The rows of a results.csv or of a study's folder. Numbers as float, nothing as None."""
    path = user_path(path)
    path = path / TABLE if path.is_dir() else path
    rows = read_list(path)
    wrong = next((row[WRONG] for row in rows if WRONG in row), None)
    require(not wrong, f"table = {path}: {wrong}")
    none = f"table = {path}: has no column status; must be a study's folder or its results.csv"
    require("status" in rows[0], none)
    return [{name: number(cell) for name, cell in row.items()} for row in rows]


def number(text: str):
    """Convert a cell to float where it is a number, also with a decimal comma; None where it is empty."""
    with suppress(ValueError):
        return float(text.replace(",", "."))
    return text or None


def measures(rows) -> list[str]:
    """The columns that are results of the scene and have a unit."""
    names = dict.fromkeys(name for row in rows for name in row)
    return [name for name in names if is_measure(name)]
