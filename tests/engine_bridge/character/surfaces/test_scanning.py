from decimal import Decimal, getcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from engine_bridge.character.surfaces.scanning import find_lines, read_corners, read_numbers


def lines(text):
    """The table and the words of a text."""
    data = np.frombuffer(text, np.uint8)
    table, words = np.full((5, text.count(b"\n") + 1), -9), np.full(text.count(b"\n") + 1, 9, np.uint64)
    count = find_lines(data, table, words)
    return table[:, :count].T.tolist(), words[:count].tolist()


def one_row(text):
    data = np.frombuffer(text, np.uint8)
    return data, np.zeros(1, np.int64), np.full(1, len(text))


def numbers(text):
    """The numbers of a row, and whether they are plain."""
    values, widths, is_plain = np.empty(len(text) + 1), np.empty(1, np.int64), np.empty(1, np.bool_)
    count = read_numbers(*one_row(text), values, widths, is_plain)
    assert widths[0] == count
    return values[:count], bool(is_plain[0])


def corners(text):
    found, sizes = np.full((3, len(text) + 1), -9), np.empty(1, np.int64)
    count, wrong = read_corners(*one_row(text), found, sizes)
    if wrong < 0:
        assert sizes[0] == count
    return found[:, :count].T.tolist(), int(wrong)


def test_lines_are_found_with_their_words_and_comments():
    table, words = lines(b"v 1 #2\n\n \t\x0b\n  vertices# x  \nusemtl\n12345678 9")
    assert table == [[1, 0, 2, 4, 6], [4, 14, 24, 22, 27], [5, 28, 34, 34, 34], [6, 35, 44, 45, 45]]
    assert words == [int.from_bytes(word, "little") for word in (b"v", b"", b"usemtl", b"12345678")]


@given(some.text(alphabet=" \t\n#ab", max_size=40))
def test_lines_are_those_that_python_finds(text):
    table, words = lines(text.encode())
    expected = [(number, line) for number, line in enumerate(text.split("\n"), 1) if line.strip()]
    assert [row[0] for row in table] == [number for number, _ in expected]
    for (_, start, rest, comment, end), word, (_, line) in zip(table, words, expected, strict=True):
        first, *others = line.split(None, 1)
        assert text[start:end] == line.lstrip()
        assert text[rest:end] == (others[0] if others else "")
        assert text[start:comment] == line.lstrip().partition("#")[0]
        assert word == (int.from_bytes(first.encode(), "little") if len(first) <= 8 else 0)


@given(some.lists(some.floats(allow_nan=False, allow_infinity=False), max_size=5), some.sampled_from("efgr"))
def test_numbers_are_those_that_python_reads(values, form):
    texts = [repr(value) if form == "r" else f"{value:.15{form}}" for value in values]
    found, is_plain = numbers(" ".join(texts).encode())
    expected = np.array(list(map(float, texts)))
    plain = ~np.isnan(found)
    assert is_plain == plain.all()
    np.testing.assert_array_equal(found[plain], expected[plain])
    np.testing.assert_array_equal(np.signbit(found[plain]), np.signbit(expected[plain]))


@pytest.mark.parametrize("decimals", [6, 9, 15, 17, 18])
def test_numbers_of_usual_length_are_plain_and_rounded_to_the_nearest(decimals):
    texts = [f"{value:.{decimals}f}" for value in np.random.default_rng(0).normal(size=2000)]
    found, _ = numbers(" ".join(texts).encode())
    plain = ~np.isnan(found)
    assert plain.mean() > 0.99
    np.testing.assert_array_equal(found[plain], np.array(list(map(float, texts)))[plain])


def test_a_number_in_the_middle_of_two_is_left_to_who_takes_more_care():
    getcontext().prec = 60
    for value in np.random.default_rng(1).uniform(0.5, 8, 300):
        middle = str((Decimal(float(value)) + Decimal(float(np.nextafter(value, 9)))) / 2)[:19]
        (found,), _ = numbers(middle.encode())
        assert np.isnan(found) or found == float(middle)


def test_signs_points_and_exponents_may_stand_where_python_has_them():
    found, is_plain = numbers(b"-0 +1. -.5 1e5 1E-3 00012 2.5e+2 1e22")
    assert is_plain
    np.testing.assert_array_equal(found, [-0.0, 1, -0.5, 1e5, 1e-3, 12, 250, 1e22])
    assert np.signbit(found[0])


@pytest.mark.parametrize("text", ["+", ".", "e5", "1e", "1e+", "--1", "1-", "0x1", "1_0", "nan", "inf", "1,5", "1e999"])
def test_what_is_no_plain_number_is_said_to_be_none(text):
    found, is_plain = numbers(f"1 {text} 2".encode())
    np.testing.assert_array_equal(found, [1, np.nan, 2])
    assert not is_plain


def test_corners_are_read_with_what_they_name():
    found, wrong = corners(b" 7 7/2\t7//3 -1/2/3 +4/ 5// 0012/0/-0 / ")
    assert wrong < 0
    assert found == [[7, 0, 0], [7, 2, 0], [7, 0, 3], [-1, 2, 3], [4, 0, 0], [5, 0, 0], [12, 0, 0], [0, 0, 0]]


@pytest.mark.parametrize("text", ["x", "1/2/3/", "1/2/3/4", "-", "1/-", "1.5", "1/x", "--1", "9" * 30, "1_0"])
def test_what_is_no_corner_is_said_to_be_none(text):
    assert corners(f"1 2/2 {text} 3".encode()) == ([[1, 0, 0], [2, 2, 0]], 0)
