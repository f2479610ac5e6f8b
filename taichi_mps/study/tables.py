"""Tables: CSV files and Excel sheets of users, what their columns hold, and the folder of a study.

``journal.jsonl``   one row a line, flushed to the disk before the next case; it alone is read when a study is resumed
``results.csv``     the same rows in the order of the cases, one column a quantity
"""

import csv
import io
import json
import os
import re
import unicodedata
from contextlib import contextmanager, suppress
from pathlib import Path

from ..input.labels import is_measure
from ..io.lock import held
from ..spelling import in_unit
from ..units import SceneError, regular_file, require, require_package, user_path

LOCK = "study.lock"
JOURNAL = "journal.jsonl"
TABLE = "results.csv"
COMMENT_LINE = re.compile(r'\s*"?#(?!\s*[,;\t]\s*["\w])')  # begins a comment before the header; '#,slump' is a header
SEPARATOR = re.compile(r'(?i)"?sep=(.)"?\s*')  # first line that tells Excel the delimiter
MAX_ROWS = 100_000  # 1.4 hours of calibrations
DECIMAL_COMMA = re.compile(r"^([-+]?\d+),(\d+)(?![\d.,])")  # a number with a comma, where semicolons separate cells
ROW_ERROR = None  # key of a row's error, where its cells do not match the header
# {field of Measurements or stem of a scene's measure: its other names, common or in EN 12350, JIS A 1101, 1150, 1116}
COLUMN_NAMES = {
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
IGNORED_WORDS = {
    *("value", "mean", "average", "avg", "measured", "test", "the", "of", "fresh", "concrete"),
    *("wert", "mittelwert", "diameter", "平均"),
}
# two kana or kanji, or one apart from letters; one beside letters is an apostrophe, a dash or oe of cp1252
SHIFT_JIS = re.compile(
    rb"[\x81-\x9f][\x40-\xfc][\x81-\x9f\xe0-\xef][\x40-\xfc]"
    rb"|(?<![A-Za-z\x80-\xff])[\x81-\x9f][\x40-\xfc](?![A-Za-z\x80-\xff])"
)
BRACKETS = re.compile(r"[\[(]([^\])]*)[\])]")
STANDARD = re.compile(r"(?i)(en|din|jis|jsce|astm|iso|bs|nf)\b")  # number of a standard in brackets
UNIT = r"mm|cm|dm|m|in|inch|inches|ft|s|ms|sec|min|kg/m\^?3|t/m\^?3|g/cm\^?3|kg/l|lb/ft\^?3|k?Pa|Pa[ .·*]?s|秒|sek"
NAME_AND_UNIT = re.compile(rf"(?i)(.+?)(?:[\s,/_]|\s+in\s+)\s*({UNIT})\.?")  # name of a column without brackets


# ---- lists ----------------------------------------------------------------------------------------------------
def read_list(path, key: str = "table") -> list[dict[str, str]]:
    """Read a CSV file, or the first sheet of an Excel workbook (.xlsx), as rows of text by column, without empty rows
    and columns. Cells of a CSV file are separated by commas, semicolons or tabs; comments (#) may precede the header; a
    decimal comma is read as a point where it is unambiguous. A row with more or fewer cells than the header has a text
    under ROW_ERROR. SceneError, which names the option ``key`` and the line, for any other file."""
    where = f"{key} = {path}: "
    try:
        data = regular_file(f"{key} = {path}", path, 1e8).read_bytes()
        text = sheet_as_csv(data, where) if data[:4] == b"PK\x03\x04" else decoded(data)  # zipped
    except OSError as error:
        raise SceneError(f"{where}cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError:
        raise SceneError(f"{where}is no text in UTF-8, UTF-16, Shift-JIS or Windows-1252; must be a CSV file") from None
    lines = list(io.StringIO(text, newline=""))
    require(len(lines) <= MAX_ROWS, f"{where}has {len(lines)} lines; must have at most {MAX_ROWS}")
    line = text.count("\n", 0, text.find("\0")) + 1
    require("\0" not in text, f"{where}line {line} holds a NUL character; must be a CSV file, which is text")
    header_lines = (k for k, line in enumerate(lines) if re.search(r'[^\s,;"]', line) and not COMMENT_LINE.match(line))
    skipped = next(header_lines, len(lines))
    given = SEPARATOR.fullmatch(lines[skipped]) if lines[skipped:] else None
    skipped += bool(given)
    first, found, empty = skipped + 1, [], f"{where}is empty; must be a CSV file with a header and rows"
    only_comments = f"{where}has comments (#) alone; its header must not begin with #"
    require(lines[skipped:], only_comments if any(map(COMMENT_LINE.match, lines)) else empty)
    try:
        counts = {sign: len(next(csv.reader(lines[skipped:], delimiter=sign))) for sign in "\t;,"}
        delimiter = given[1] if given else next((sign for sign in counts if counts[sign] > 1), ";")  # 18,5 is one cell
        reader = csv.reader(lines[skipped:], delimiter=delimiter, strict=True)
        for row in reader:
            cells = [DECIMAL_COMMA.sub(r"\1.\2", cell.strip()) if delimiter == ";" else cell.strip() for cell in row]
            found += [(first, cells)] if any(cells) else []
            first = skipped + reader.line_num + 1
    except csv.Error as error:
        raise SceneError(
            f"{where}line {first} is no CSV ({error}); must be cells of at most {csv.field_size_limit()} characters, "
            "a quote in one written twice and the cell in quotes"
        ) from None
    require(found, empty)
    (_, header), *rows = found
    require(rows, f"{where}has a header and no row; must have a line for each mix or case")
    header, width, table = [" ".join(name.split()) for name in header], len(header), []
    filled = [name or any(row[k:] and row[k] for _, row in rows) for k, name in enumerate(header)]
    names = [name or f"column {k}" for k, name in enumerate(header, 1)]
    duplicate = next((name for k, name in enumerate(names) if filled[k] and name in names[:k]), None)
    require(duplicate is None, f"{where}column '{duplicate}' stands there twice; must be once")
    for line, row in rows:
        table.append({names[k]: cell for k, cell in enumerate([*row, *[""] * width][:width]) if filled[k]})
        wrong = f"{len(row)} cells, the header has {width}" if len(row) != width else ""
        for name, column, cell in zip(header[1:], names[1:], row[1:], strict=False):  # the first may number the rows
            if delimiter == "," and not name and cell[:1].isdigit():
                wrong = wrong or f"a number in {column}, which has no name"
        if wrong:
            table[-1][ROW_ERROR] = f"line {line} has {wrong}: {' '.join(delimiter.join(row).split())}" + (
                "; a number with a decimal comma must be in quotes" if delimiter == "," and len(row) >= width else ""
            )
    return table


def sheet_as_csv(data: bytes, where: str) -> str:
    """Text of the first sheet of an Excel workbook as CSV with semicolons, a line for each row; of formulas their last
    values. SceneError, which begins with ``where``, for any other zipped file, and without openpyxl."""
    require_package("openpyxl", f"{where}an Excel sheet needs", "excel", ", or save it as CSV")
    import openpyxl

    file = io.StringIO()
    try:
        sheet = openpyxl.load_workbook(io.BytesIO(data), data_only=True).worksheets[0]
        rows = sheet.iter_rows(max_row=min(sheet.max_row, MAX_ROWS + 1), values_only=True)
        csv.writer(file, delimiter=";").writerows([cell_text(cell) for cell in row] for row in rows)
    except Exception as error:  # a file may come from anybody
        raise SceneError(
            f"{where}is no Excel workbook ({type(error).__name__}); must be an .xlsx or a CSV file"
        ) from None
    return file.getvalue()


def cell_text(value) -> str:
    """Text of a cell of a workbook on one line, a number with up to twelve figures; '' of an empty one."""
    text = f"{value:.12g}" if isinstance(value, float | int) and not isinstance(value, bool) else value
    return "" if text is None else " ".join(str(text).split())


def decoded(data: bytes) -> str:
    """Decode a file: UTF-8, UTF-16 by its mark, or what Excel writes in Japan (Shift-JIS) and western Europe."""
    may_be = {"utf-16": data[:2] in (b"\xff\xfe", b"\xfe\xff"), "utf-8-sig": True, "cp932": SHIFT_JIS.search(data)}
    for encoding in filter(may_be.get, may_be):
        with suppress(UnicodeDecodeError):
            return data.decode(encoding)
    return data.decode("cp1252")


# ---- what a column holds ----------------------------------------------------------------------------------------
def key_of(text: str) -> str:
    """Return the letters and digits of a name in lower case, without IGNORED_WORDS: equal for spellings of one name. A
    diameter without another word stays one."""
    words = words_of(text)
    key = "".join(word for word in words if word not in IGNORED_WORDS).removesuffix("値")
    return key or ("diameter" if "diameter" in words else "")


def words_of(text: str) -> list[str]:
    """Return the words and numbers of a name in lower case."""
    return re.findall(r"[^\W_]+", unicodedata.normalize("NFKC", text).casefold())


def is_unit(text: str, fields) -> bool:
    """Whether a text in brackets is meant as a unit: no standard, no name of a field and no ignored word."""
    is_name = re.search(r"\w", text) and key_of(text) in ("", "diameter", *fields)
    return bool(text) and not is_name and not STANDARD.match(text)


def match_column(column: str, fields: dict[str, str], unit_of, where: str = "") -> tuple[str | None, str]:
    """Return the field of a column by ``fields``, {key_of(name): field}, else None, and the unit in its name, else ''.

    A unit of another kind than ``unit_of(field)`` raises SceneError, which begins with ``where``; after a name of at
    most three letters, which may be an abbreviation of something else, it gives None and ''.
    """
    text = unicodedata.normalize("NFKC", column)
    name = BRACKETS.sub(" ", text).strip()
    units = [re.sub(r"(?i)^in\s+", "", unit.strip()) for unit in BRACKETS.findall(text)]
    found, units = fields.get(key_of(name)), [unit for unit in units if is_unit(unit, fields)]
    if not found and (tail := NAME_AND_UNIT.fullmatch(name)):
        found, units = fields.get(key_of(tail[1])), [tail[2]]
    if not found or not units:
        return found, ""
    si_unit = unit_of(found)
    for unit in reversed(units):
        with suppress(ValueError):
            in_unit(si_unit, f"1 {unit}")
            return found, unit
    require(len(key_of(name)) <= 3, f"{where}column '{column}': its unit must be {si_unit} or one of that kind")
    return None, ""  # SF [kg/m3] is silica fume


# ---- the folder of a study --------------------------------------------------------------------------------------
class Results:
    """Rows of a study by key, in an open journal."""

    def __init__(self, folder: Path, file):
        self.file, self.table = file, folder / TABLE
        self.rows: dict[str, dict] = {}
        file.seek(0)
        content = file.read()
        end = content.rfind(b"\n") + 1  # an incomplete last line is of a process that was killed
        file.truncate(end)
        for number, line in enumerate(content[:end].splitlines(), 1):
            try:
                row = json.loads(line)
                self.rows[row["key"]], _ = row, row["status"]  # KeyError without one of them
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
        temporary = self.table.with_suffix(".part")
        write(rows, temporary)
        os.replace(temporary, self.table)


@contextmanager
def open_results(folder):
    """Open the results of a study's folder, which is made if need be; one study at a time may write there."""
    folder = user_path(folder)
    present = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    require(
        not (present - {LOCK} and JOURNAL not in present),
        f"out = {folder}: holds other files and no study; must be a new or a study's folder",
    )
    with held(folder, LOCK, "another study, process"), open(folder / JOURNAL, "a+b") as file:
        yield Results(folder, file)


def write(rows: list[dict], path) -> None:
    """Write rows as CSV, a column for each name in any row; curves (dict) and ROW_ERROR are left out, formulas
    escaped."""
    columns = list(dict.fromkeys(k for row in rows for k, cell in row.items() if k and not isinstance(cell, dict)))
    with open(path, "w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file)
        lines.writerow(map(escape_formula, columns))
        lines.writerows([escape_formula(row.get(name, "")) for name in columns] for row in rows)


def escape_formula(value):
    """Return a cell, with an apostrophe before a text that a spreadsheet would take for a formula."""
    formula = isinstance(value, str) and value.lstrip()[:1] in set("=+-@") and isinstance(parse_number(value), str)
    return f"'{value}" if formula else value


def read(path) -> list[dict]:
    """Read the rows of a results.csv or of a study's folder: numbers as float, empty cells as None."""
    path = user_path(path)
    path = path / TABLE if path.is_dir() else path
    rows = read_list(path)
    wrong = next((row[ROW_ERROR] for row in rows if ROW_ERROR in row), None)
    require(not wrong, f"table = {path}: {wrong}")
    require("status" in rows[0], f"table = {path}: has no column status; must be a study's folder or its results.csv")
    return [{name: parse_number(cell) for name, cell in row.items()} for row in rows]


def parse_number(text: str):
    """Convert a cell to float where it is a number, also with a decimal comma; None where it is empty."""
    with suppress(ValueError):
        return float(text.replace(",", "."))
    return text or None


def measures(rows) -> list[str]:
    """Return the columns that are results of the scene and have a unit."""
    return [name for name in dict.fromkeys(name for row in rows for name in row) if is_measure(name)]
