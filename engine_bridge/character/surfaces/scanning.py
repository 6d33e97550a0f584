"""The loops over the bytes of a text. Each is compiled on first use and kept compiled on disk."""

import numba
import numpy as np

NEWLINE, POINT, SLASH, COMMENT = ord("\n"), ord("."), ord("/"), ord("#")
PLUS, MINUS, ZERO, EXPONENT = ord("+"), ord("-"), ord("0"), ord("e")

EXACT = 2**53
"""Up to here every whole number is a float64."""

POWERS = 10.0 ** np.arange(23)
"""The powers of ten that are a float64."""

ROOM = 9 * 10**17
"""A whole number below it has room for one more digit."""

HALVES = 2.0**27 + 1
"""Times a float64, takes it apart into two of 26 bits (Veltkamp)."""

UNSURE = 2.0**-48
"""More than the relative error of a remainder."""


@numba.njit(cache=True, nogil=True)
def _is_space(byte):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    return byte == 32 or 9 <= byte <= 13


@numba.njit(cache=True, nogil=True)
def _is_digit(byte):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    return ZERO <= byte < ZERO + 10


@numba.njit(cache=True, nogil=True)
def _after_spaces(data, place, end):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    while place < end and _is_space(data[place]):
        place += 1
    return place


@numba.njit(cache=True, nogil=True)
def _after_word(data, place, end):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    while place < end and not _is_space(data[place]):
        place += 1
    return place


@numba.njit(cache=True, nogil=True)
def _packed(data, start, end):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return a word as a number, 0 for one of more than 8 bytes."""
    word = np.uint64(0)
    if end <= start + 8:
        for place in range(start, end):
            word |= np.uint64(data[place]) << np.uint64(8 * (place - start))
    return word


@numba.njit(cache=True, nogil=True)
def find_lines(data, table, words):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Find the lines that hold something, and return how many there are.

    Parameters
    ----------
    data : (b,) uint8
    table : (5, n) int64
        As many columns as the text has lines. Receives the line's number from 1, where its first word begins, where the
        rest after that word and its spaces begins, where its first ``#`` is or else its end, and its end.
    words : (n,) uint64
        Receives the first words, see `text.word`; 0 for one of more than 8 bytes.
    """
    count, number, place = 0, 0, 0
    while place < len(data):
        number += 1
        end, comment = place, -1
        while end < len(data) and data[end] != NEWLINE:
            if data[end] == COMMENT and comment < 0:
                comment = end
            end += 1
        start = _after_spaces(data, place, end)
        if start < end:
            after = _after_word(data, start, end)
            words[count] = _packed(data, start, after)
            table[0, count] = number
            table[1, count] = start
            table[2, count] = _after_spaces(data, after, end)
            table[3, count] = end if comment < 0 else comment
            table[4, count] = end
            count += 1
        place = end + 1
    return count


@numba.njit(cache=True, nogil=True)
def _after_digits(data, place, end, whole):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Append digits to a whole number as long as it has room, and return where they end and that number."""
    while place < end and _is_digit(data[place]) and whole < ROOM:
        whole = 10 * whole + (data[place] - ZERO)
        place += 1
    return place, whole


@numba.njit(cache=True, nogil=True)
def _after_sign(data, place, end):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    return place + (place < end and (data[place] == MINUS or data[place] == PLUS))


@numba.njit(cache=True, nogil=True)
def _number(data, start, end):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Read a number, or return NaN for what is none or takes more care."""
    first = _after_sign(data, start, end)
    point, mantissa = _after_digits(data, first, end, 0)
    place, digits, decimals = point, point - first, 0
    if place < end and data[place] == POINT:
        place, mantissa = _after_digits(data, point + 1, end, mantissa)
        decimals = place - point - 1
        digits += decimals
    exponent = 0
    if place < end and data[place] | 32 == EXPONENT:
        sign = place + 1
        first = _after_sign(data, sign, end)
        place, exponent = _after_digits(data, first, end, 0)
        if place == first:
            return np.nan
        if data[sign] == MINUS:
            exponent = -exponent
    if place < end or digits == 0:
        return np.nan
    value = _scaled(mantissa, exponent - decimals)
    return -value if data[start] == MINUS else value


@numba.njit(cache=True, nogil=True)
def _scaled(mantissa, exponent):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return the float64 nearest to a whole number times a power of ten, or NaN where that takes more care.

    One rounding of a product or quotient of two float64 gives it (Clinger, How to Read Floating Point Numbers
    Accurately, 1990). With more digits than a float64 has, the quotient's remainder tells which way to round, unless it
    is too near to the middle to be sure.
    """
    if abs(exponent) >= len(POWERS):
        return np.nan
    power = POWERS[abs(exponent)]
    if mantissa <= EXACT:
        return mantissa * power if exponent >= 0 else mantissa / power
    if exponent > 0:
        return np.nan
    most = float(mantissa)
    quotient = most / power
    product, error = _product(quotient, power)
    remainder = (((most - product) - error) + (mantissa - np.int64(most))) / power
    value = quotient + remainder * (1 - UNSURE)
    return value if value == quotient + remainder * (1 + UNSURE) else np.nan


@numba.njit(cache=True, nogil=True)
def _product(a, b):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return a product and what is missing from it (Dekker, A Floating-Point Technique, 1971)."""
    upper_a, upper_b = HALVES * a - (HALVES * a - a), HALVES * b - (HALVES * b - b)
    lower_a, lower_b = a - upper_a, b - upper_b
    product = a * b
    return product, ((upper_a * upper_b - product) + upper_a * lower_b + lower_a * upper_b) + lower_a * lower_b


@numba.njit(cache=True, nogil=True)
def read_numbers(data, starts, ends, values, widths, is_plain):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Read rows of numbers with spaces between, and return how many numbers there are.

    Parameters
    ----------
    data : (b,) uint8
    starts, ends : (n,) int64
        Of each row.
    values : (m,) float64
        As many as there could be. Receives the numbers, one row's after another's, NaN for those that are not plain.
    widths : (n,) int64
        Receives how many each row has.
    is_plain : (n,) bool
        Receives whether all of a row's numbers are.
    """
    count = 0
    for row in range(len(starts)):
        is_plain[row], before = True, count
        start = _after_spaces(data, starts[row], ends[row])
        while start < ends[row]:
            after = _after_word(data, start, ends[row])
            values[count] = _number(data, start, after)
            is_plain[row] &= not np.isnan(values[count])
            count += 1
            start = _after_spaces(data, after, ends[row])
        widths[row] = count - before
    return count


@numba.njit(cache=True, nogil=True)
def _corner(data, start, end, corners, count):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Read one corner into a column of the (3, m) corners, and tell whether it is one."""
    corners[0, count] = corners[1, count] = corners[2, count] = 0
    place = start
    for part in range(3):
        sign, first = place, _after_sign(data, place, end)
        place, index = _after_digits(data, first, end, 0)
        if sign < first == place:
            return False
        corners[part, count] = -index if sign < end and data[sign] == MINUS else index
        if place == end:
            return True
        if data[place] != SLASH:
            return False
        place += 1
    return False


@numba.njit(cache=True, nogil=True)
def read_corners(data, starts, ends, corners, sizes):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Read rows of corners like ``7``, ``7/2``, ``7//3`` and ``-1/2/3``.

    Parameters
    ----------
    data : (b,) uint8
    starts, ends : (n,) int64
        Of each row.
    corners : (3, m) int64
        As many as there could be. Receives the indices, one row's after another's, 0 for what is not there.
    sizes : (n,) int64
        Receives how many corners each row has.

    Returns
    -------
    count, wrong : int
        How many corners there are, and the first row that holds something else, −1 where there is none.
    """
    count = 0
    for row in range(len(starts)):
        before = count
        start = _after_spaces(data, starts[row], ends[row])
        while start < ends[row]:
            after = _after_word(data, start, ends[row])
            if not _corner(data, start, after, corners, count):
                return count, row
            count += 1
            start = _after_spaces(data, after, ends[row])
        sizes[row] = count - before
    return count, -1
