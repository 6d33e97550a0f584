"""Text files as rows of cells: separators, quotes, decimal commas, header lines, and several numbers in a cell."""

import csv
import itertools
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from capture.formats._rows import Line

SEPARATORS: tuple[str | None, ...] = (";", "\t", ",", "|", None)
"""Separators in order of priority; None stands for any white space."""

MAX_HEADER_ROWS = 8
"""Number of lines above the first row that may name the columns."""

DIGITS, DIGITS_SHARES = 5, (0.25, 0.5)
"""Cells that are a number's part after a decimal comma have so many digits; the range of the share of such cells."""

FRACTION_DIGITS, DECIMAL_COMMA_SHARE = 3, 0.9
"""Smallest number of digits after a decimal comma that is also between cells, and share of rows with only such ones."""

_SHORT_NUMBER = re.compile(r"-?\d{1,4}")

OTHER_HEADER_ROWS = frozenset(("id", "parent", "type"))
"""First words of header rows that do not name columns. An empty cell precedes them (OptiTrack Motive)."""

UNKNOWN = frozenset(("", "nan", "null", "none", "na", "n/a", "-", "inf", "-inf", "undefined", "[]"))
"""Cells in lower case that stand for a value which is not known."""

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_LABELLED = rf"(?:['\"]?[A-Za-z]+['\"]?\s*[:=]\s*)?{_NUMBER}"
_NUMBERS = re.compile(_NUMBER)
_VECTOR = re.compile(rf"(?:[A-Za-z]*[\[({{<]\s*)*{_LABELLED}(?:[\s,;\[\](){{}}]+{_LABELLED}){{2,}}[\s\])}}>]*")
_PAIR = re.compile(rf"[\[(]\s*{_NUMBER}\s*,\s*{_NUMBER}\s*[\])]")
_CELLS = re.compile(r"[^\s,;\[\](){}]+")
_TOKENS = re.compile(rf"(?<![\w.]){_NUMBER}(?![\w.])|[A-Za-z]\w*")

MIN_SAME_LENGTH = 5
"""Number of rows of the same other length than most from which these have another form, and are no damaged lines."""

MIN_HEADLINES = 2
"""Number of lines with a frame's number or a joint's name, after rows of numbers, from which they begin rows."""

MAX_COUNTS = 3
"""Largest number of numbers in a line that counts the rows after it."""

SENTENCES_SHARE = 0.8
"""Smallest share of the lines of a text that have the same words and numbers in the same order."""

MIN_THREES = 6
"""Number of names with two empty cells after them from which each name is that of three columns."""

MIN_COUNTED = 7
"""Minimum number of numbers in a row that counts its columns."""

MAX_POINT_NUMBERS = 7
"""Largest number of numbers of a point in a cell; more are those of all points."""

PARTS = ("x", "y", "z", "visibility")
"""Names of the numbers in a cell; others have none."""
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
_UNITS = frozenset(("m", "mm", "cm", "s", "ms", "sec", "", "meters", "metres", "unit", "units"))


@dataclass(frozen=True, slots=True)
class Cells:
    """Rows of equal length.

    Attributes
    ----------
    names : list of list of str
        Of each column, the header's cells from top to bottom; empty without a header.
    rows : list of list of str
    lines : list of int
        Line number of each row.
    origin : list of int
        The file's column that each column is from: one whose cells have several numbers becomes several columns.
    cut_off : int or None
        Line within which the file ends, which is no row.
    left_out : int
        Number of lines that have another form than most.
    filled : int
        Number of rows that have fewer cells than the header, and are taken to lack the last ones.
    """

    names: list[list[str]]
    rows: list[list[str]]
    lines: list[int]
    origin: list[int]
    cut_off: int | None
    left_out: int
    filled: int


class UnevenError(ValueError):
    """A row has another number of cells than the others; the arguments are line, its cells and theirs."""


class DecimalCommaError(ValueError):
    """Commas are between cells and in numbers, so that nobody can tell where a number ends."""


def number(cell: str) -> float | None:
    """Return the number in a cell, NaN if it is not known, None if the cell is neither."""
    try:
        value = float(cell.replace("_", "?"))  # Python allows 1_000
    except ValueError:
        return math.nan if cell.lower() in UNKNOWN else None
    return value if math.isfinite(value) else math.nan


def vector(cell: str) -> list[float] | None:
    """Return the numbers of a cell such as ``(0.1, 1.2)`` or ``x: 0.1 y: 1.2 z: 3``; None if it has one."""
    parts = _parts(cell)
    return None if parts is None else [float(each) for each in parts]


def _parts(cell: str) -> list[str] | None:
    cell = cell.replace("/", " ") if cell.count(".") > 1 else cell  # a date has slashes too
    return _NUMBERS.findall(cell) if _VECTOR.fullmatch(cell) or _PAIR.fullmatch(cell) else None


def _is_plain_vector(cell: str) -> bool:
    return len(_parts(cell) or ()) > 2 and not re.search("[:=]", cell)


def split(lines: Sequence[Line]) -> Cells | None:
    """Split lines that are not blank into cells.

    Returns
    -------
    Cells or None
        None if the lines are no table of numbers.

    Raises
    ------
    UnevenError, DecimalCommaError
    """
    lines = [(at, text.lstrip("#% ") if text.lstrip()[:1] in "#%" else text) for at, text in _whole_rows(lines)]
    if not lines:
        return None
    separator, lines, rows = _rows(lines)
    count = len(rows)
    first = next((index for index, row in enumerate(rows) if _has_numbers(row)), None)
    if blocks := _under_headlines(lines) or _under_counts(rows, lines):
        lines, rows, count = blocks
        first, separator = 1, None
    elif first is None:
        lines, rows = _of_sentences(lines)
        first, count = 1, count + 1  # the header
    if not rows:
        return None
    if separator == "," and _is_digits(rows[first : first + 60]):
        lines, rows = _with_decimal_commas(lines, rows, first)
    left_out = count - len(rows)
    width, filled = _width(rows, first)
    above = rows[:first]
    header = _header(above, width)
    kept = [k for k in range(first, len(rows)) if rows[k] not in above]  # files that were joined repeat their header
    body, numbers = [rows[k] for k in kept], [lines[k][0] for k in kept]
    cut_off = None
    if len(body) > 1 and len(body[-1]) < width and not lines[-1][1].endswith("\n"):
        cut_off = numbers[-1]
        body, numbers = body[:-1], numbers[:-1]
    uneven = [len(row) for row in body if len(row) < width or any(row[width:])]
    is_form = bool(uneven) and Counter(uneven).most_common(1)[0][1] >= MIN_SAME_LENGTH
    if is_form and len(uneven) < (1 - SENTENCES_SHARE) * len(body):  # such as those with a second hand
        even = [(row, at) for row, at in zip(body, numbers, strict=True) if len(row) >= width and not any(row[width:])]
        body, numbers = [row for row, _ in even], [at for _, at in even]
        left_out += len(uneven)
    for row, at in zip(body, numbers, strict=True):
        if len(row) < width or any(row[width:]):
            raise UnevenError(at, len(row), width)
    names, body, origin = _with_a_number_per_cell(_names(header, width), body)
    return Cells(names, body, numbers, origin, cut_off, left_out, filled)


def _with_a_number_per_cell(
    names: list[list[str]], rows: list[list[str]]
) -> tuple[list[list[str]], list[list[str]], list[int]]:
    """Return names and rows in which each number of a cell has a column, and the columns that these are from."""
    sizes = []
    for column in range(len(names)):
        found = Counter(len(each) for row in rows[:50] if (each := _parts(row[column])))
        sizes.append(found.most_common(1)[0][0] if found else 1)
    origin = [column for column, size in enumerate(sizes) for _ in range(size)]
    if len(origin) == len(names):
        return names, [row[: len(names)] for row in rows], origin
    parts = [k for size in sizes for k in range(size)]

    def is_point(column: int) -> bool:
        return sizes[column] <= MAX_POINT_NUMBERS

    named = [
        names[column] if sizes[column] == 1 else [*names[column], *PARTS[k : k + 1]] if is_point(column) else []
        for column, k in zip(origin, parts, strict=True)
    ]
    split_rows = []
    for row in rows:
        cells: list[str] = []
        for cell, size in zip(row, sizes, strict=False):
            found_parts = _parts(cell) if size > 1 else None
            whole = found_parts is not None and len(found_parts) == size
            cells += found_parts if whole and found_parts else [cell, *[""] * (size - 1)]
        split_rows.append(cells)
    return named, split_rows, origin


def _width(rows: list[list[str]], first: int) -> tuple[int, int]:
    """Return how many cells rows with numbers have, from the first; fill those that lack the last, and count them."""
    counts = Counter(len(row) for row in rows[first:])
    width, filled = counts.most_common(1)[0][0], 0
    if first and width < len(rows[first - 1]) in counts:
        short, filled, width = width, counts[width], len(rows[first - 1])
        for row in rows[first:]:
            row += [""] * (width - short if len(row) == short else 0)
    is_empty = not any(row[width - 1] for row in rows[first:] if len(row) == width)
    used = width - 1 if is_empty and width > 1 else width  # the lines end in a separator
    return used, filled if used == width else 0


def _rows(lines: Sequence[Line]) -> tuple[str | None, Sequence[Line], list[list[str]]]:
    """Return the separator of lines, the lines and the cells of each; groups of numbers without names are cells each.

    A first row that counts the columns, which pandas writes for names, is left out.
    """
    separator = _separator([text for _, text in lines[:60]])
    rows = [_row(text, separator) for _, text in lines]
    numbered = int(all(cell.isdecimal() for cell in rows[0]))
    if len(rows) > numbered and all(map(_is_plain_vector, rows[numbered][:2])):
        rows = [_NUMBERS.findall(text) if index >= numbered else [] for index, (_, text) in enumerate(lines)]
        return None, lines, rows
    names = int(len(rows) > 1 and _counts(rows[0]) and _has_numbers(rows[1]))
    return separator, lines[names:], rows[names:]


def _under_headlines(lines: Sequence[Line]) -> tuple[Sequence[Line], list[list[str]], int] | None:
    """Return lines and cells, with a header, and how many there were, of rows of numbers below lines that begin them.

    Such a headline is the number of a frame, as in ``Frame: 7``, or the name of a joint, as in ``Left knee:``. A row
    has x, y and z, perhaps after a joint's number. Rows of another length than most are left out.
    """
    headlines = [re.match(r"\s*[A-Za-z]", text) is not None for _, text in lines]
    numbers = [_NUMBERS.findall(text) if own else [] for (_, text), own in zip(lines, headlines, strict=True)]
    again = sum(now > before for before, now in itertools.pairwise(headlines))
    if not headlines[0] or again < MIN_HEADLINES or max(map(len, numbers)) > 2:
        return None
    first = [each[0] for each in numbers if each]
    is_frame = len(set(first)) == len(first)
    frame = joint = ""
    found: list[tuple[Line, list[str]]] = []
    for line, is_headline, own in zip(lines, headlines, numbers, strict=True):
        if not is_headline:
            found.append((line, [frame, joint, *_CELLS.findall(line[1])]))
        elif own and is_frame:
            frame, joint = own[0], ""
        else:
            joint = own[0] if own else line[1].strip(" :-\t\r\n")
    width, count = Counter(len(row) for _, row in found).most_common(1)[0]
    rows = [each for each in found if len(each[1]) == width and None not in map(number, each[1][2:])]
    if count < SENTENCES_SHARE * len(found) or width < 5 or not rows:
        return None
    is_numbered = not any(row[1] for _, row in rows) and all(row[2].isdecimal() for _, row in rows)
    header = ["frame", "", "joint", *"xyz"] if is_numbered else ["frame", "joint", *"xyz"]
    header += ["visibility"] if width == len(header) + 1 else [""] * (width - len(header))
    return [rows[0][0], *(line for line, _ in rows)], [header, *(row for _, row in rows)], len(found) + 1


def _under_counts(
    rows: Sequence[list[str]], lines: Sequence[Line]
) -> tuple[Sequence[Line], list[list[str]], int] | None:
    """Return lines and cells, with a header, of rows below lines of few numbers, one of which counts these rows.

    The rows are the joints or the people of a frame, as in ``4 17`` above 4 people with 17 joints each.
    """
    width = len(rows[0])
    starts = [at for at, row in enumerate(rows) if len(row) == width]
    counts = [after - at - 1 for at, after in itertools.pairwise([*starts, len(rows)])]
    told = [[int(cell) if cell.isdecimal() else -1 for cell in rows[at]] for at in starts]
    is_count = [all(own[k] == count for own, count in zip(told[:-1], counts, strict=False)) for k in range(width)]
    if width > MAX_COUNTS or len(starts) < MIN_HEADLINES + 1 or not any(is_count) or max(counts) < 1:
        return None
    found = [
        (lines[at + k], [str(frame), str(k - 1), *rows[at + k]])
        for frame, (at, count) in enumerate(zip(starts, counts, strict=True))
        for k in range(1, count + 1)
    ]
    size = Counter(len(row) for _, row in found).most_common(1)[0][0]
    kept = [each for each in found if len(each[1]) == size]
    header = ["frame", "person", *[""] * (size - 2)] if size > 9 else ["frame", "joint", *"xyz", *[""] * (size - 5)]
    return [kept[0][0], *(line for line, _ in kept)], [header, *(row for _, row in kept)], len(found) + 1


def _of_sentences(lines: Sequence[Line]) -> tuple[Sequence[Line], list[list[str]]]:
    """Return lines and cells, with a header, of text with words before numbers, such as ``Head: position (1, 2, 3)``.

    Most lines have the same number of words and numbers in the same order; others are left out. Words that are equal in
    all lines name the numbers after them; without any, columns have no names. A word that differs is a cell.
    """
    tokens = [(line, _TOKENS.findall(line[1])) for line in lines]
    kinds = Counter(tuple(number(token) is None for token in own) for _, own in tokens)
    kind, count = kinds.most_common(1)[0]
    own = [(line, each) for line, each in tokens if tuple(number(token) is None for token in each) == kind]
    if count < SENTENCES_SHARE * len(lines) or kind.count(False) < 3:
        return [], []
    columns: list[tuple[int, str]] = []
    label = ""
    for index, is_word in enumerate(kind):
        if is_word and len({each[index] for _, each in own}) == 1:
            label = own[0][1][index]
        else:
            columns.append((index, label or "joint"))
    labels = [label for _, label in columns]
    header = [
        f"{label} {'xyz'[labels[:place].count(label)]}" if labels.count(label) == 3 else label
        for place, label in enumerate(labels)
    ]
    if labels[0].lower() == "joint" and len(set(labels[1:4])) == 1:  # whose position follows
        header[1:4] = "xyz"
    chosen = [line for line, _ in own]
    header = header if label else [""] * len(header)
    return [chosen[0], *chosen], [header, *([each[index] for index, _ in columns] for _, each in own)]


def _is_digits(rows: Sequence[Sequence[str]]) -> bool:
    """Return whether no number has a point, and many cells have digits only, as those after a decimal comma."""
    cells = [cell for row in rows for cell in row if cell]
    digits = sum(cell.isdecimal() and len(cell) >= DIGITS for cell in cells)
    low, high = DIGITS_SHARES
    is_often = low * len(cells) < digits <= high * len(cells)
    return is_often and not any("." in cell and number(cell) is not None for cell in cells)


def _with_decimal_commas(
    lines: Sequence[Line], rows: list[list[str]], first: int
) -> tuple[Sequence[Line], list[list[str]]]:
    """Return the rows whose numbers, split at their decimal commas, are whole again: as many cells as names.

    Digits after a short number are its fraction, from some column on; before that are counts, times and identities. The
    few rows with other fractions are left out.

    Raises
    ------
    DecimalCommaError
        No column gives most rows the number of the names.
    """
    width = len(rows[first - 1]) if first else 0
    for start in range(width):
        whole = [_joined(row, start) for row in rows[first:]]
        good = [len(row) == width for row in whole]
        if sum(good) >= DECIMAL_COMMA_SHARE * len(good):
            kept = [index for index, is_good in enumerate(good) if is_good]
            return [*lines[:first], *(lines[first + k] for k in kept)], [*rows[:first], *(whole[k] for k in kept)]
    raise DecimalCommaError


def _joined(row: Sequence[str], start: int) -> list[str]:
    joined = list(row[:start])
    for cell in row[start:]:
        is_fraction = len(joined) > start and cell.isdecimal() and len(cell) >= FRACTION_DIGITS
        if is_fraction and _SHORT_NUMBER.fullmatch(joined[-1]):
            joined[-1] = f"{joined[-1]}.{cell}"
        else:
            joined.append(cell)
    return joined


def _whole_rows(lines: Sequence[Line]) -> Sequence[Line]:
    """Return lines of which those within a quoted cell or a list are joined; a cell that does not end is no cell."""
    rows: list[Line] = []
    is_open = False
    for at, text in lines:
        is_list = rows and text.lstrip()[:1] not in "[{" and rows[-1][1].count("[") > rows[-1][1].count("]")
        if is_open or is_list:
            rows[-1] = (rows[-1][0], rows[-1][1] + text)
        else:
            rows.append((at, text))
        is_open ^= text.count('"') % 2 == 1
    if is_open:
        return rows[:-1] if len(rows) > 2 else lines
    return rows


def _header(above: list[list[str]], width: int) -> list[list[str]]:
    """Return the rows above the first one with numbers that name the columns."""
    header: list[list[str]] = []
    for row in above[-MAX_HEADER_ROWS:][::-1]:
        if len(row) < 0.6 * width or not any(row):
            break
        header.insert(0, row[:width])
    return header


def _separator(texts: Sequence[str]) -> str | None:
    """Return the separator with which most rows are equally long and most of their cells numbers."""

    def quality(separator: str | None) -> tuple[float, int]:
        rows = [_row(text, separator) for text in texts]
        width, count = Counter(len(row) for row in rows).most_common(1)[0]
        cells = [cell for row in rows if _has_numbers(row) for cell in row if cell]
        good = sum(number(cell) is not None or _parts(cell) is not None for cell in cells)
        return round(good / max(1, len(cells)) * count / len(rows), 2) if width > 1 else 0.0, good

    return max(SEPARATORS, key=quality)


def _row(text: str, separator: str | None) -> list[str]:
    """Return the cells of a line, with points in numbers; none if a cell is too long."""
    if separator is None:
        cells = text.split()
    elif '"' in text:
        try:
            cells = next(csv.reader([text.strip("\r\n")], delimiter=separator, skipinitialspace=True))
        except csv.Error:  # a cell of more than 131,072 characters
            return []
    else:
        cells = text.split(separator)
    cells = [cell.strip().strip("'\"") for cell in cells]
    if "," in text and (separator != "," or '"' in text):
        cells = [cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in cells]
    return cells


def _counts(row: Sequence[str]) -> bool:
    """Return whether all numbers of a row are whole ones, each one more than the one before."""
    numbers = [cell for cell in row if cell.lower() not in UNKNOWN and number(cell) is not None]
    if len(numbers) < MIN_COUNTED or not all(cell.isdecimal() and len(cell) < DIGITS for cell in numbers):
        return False
    return [*map(int, numbers)] == [*range(int(numbers[0]), int(numbers[0]) + len(numbers))]


def _has_numbers(row: Sequence[str]) -> bool:
    """Return whether most of at least three known cells of a row are numbers, or all of the few among unknown ones."""
    known = [cell for cell in row if cell.lower() not in UNKNOWN]
    good = sum(number(cell) is not None or 3 * (_parts(cell) is not None) for cell in known)
    return good >= max(3, 0.5 * len(known)) or (len(row) >= 3 and bool(row[0]) and good == len(known))


def _names(header: list[list[str]], width: int) -> list[list[str]]:
    """Return the header's cells of each column; a name above several columns stands above the first of them."""
    header = [row for row in header if not {cell.lower().strip("[]()") for cell in row} <= _UNITS]
    header = [row for row in header if len({cell for cell in row if cell}) > 1 or len(header) == 1]
    types = next((row for row in header if _label(row) == "type" and "Bone" in row), [])
    header = [row for row in header if _label(row) not in OTHER_HEADER_ROWS]
    columns: list[list[str]] = [[] for _ in range(width)]
    for level, row in enumerate(header):
        last = ""
        named = [column for column, cell in enumerate(row) if cell]
        apart = [after - before for before, after in itertools.pairwise(named)]
        is_for_three = apart.count(3) >= max(MIN_THREES, len(apart) - 2)  # such as those of the time and of a rate
        for names, cell in zip(columns, row + [""] * width, strict=False):
            last = cell or (last if level < len(header) - 1 or is_for_three else "")
            if last:
                names.append(last)
    for names, kind in zip(columns[2:], types[2:], strict=False):
        if kind != "Bone":  # a marker
            names.clear()
    return columns


def _label(row: list[str]) -> str:
    """Return the first word of a header row that begins with an empty cell, in lower case; "" for other rows."""
    return "" if row[0] else next(filter(None, row), "").lower()
