"""A list that a user hands over as a file: head and rows as text, however a spreadsheet wrote it."""

import csv
import io
import re
from contextlib import suppress

from ..units import SceneError, ordinary, require

REMARK = re.compile(r'\s*"?#(?!\s*[,;\t]\s*["\w])')  # begins a remark before the head; '#,slump' is a head
SEPARATOR = re.compile(r'(?i)"?sep=(.)"?\s*')  # the first line by which Excel is told the delimiter
MOST_ROWS = 100_000  # some two hours of calibrations
WRONG = None  # key of a row under which stands why its cells are none of the head's


def read(path) -> tuple[list[dict[str, str]], bool]:
    """The rows of a CSV file as text by the names of its head, without those that hold nothing: commas, semicolons or
    tabs between the cells, remarks (#) before the head; and whether a comma in them can only be a decimal one. A row
    with more or fewer cells than the head says so under WRONG. SceneError, with the line, for what is no such file."""
    where = f"table = {path}: "
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
            found += [(first, [cell.strip() for cell in row])] if any(map(str.strip, row)) else []
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
    return table, delimiter == ";"


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
