from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from engine_bridge.character.surfaces.text import Rows, decoded, filled_lines, parsed, spans
from puppetline.errors import MeshError


def rows(*texts):
    return Rows(Path("a.obj"), "'v x y z'", list(range(5, 5 + len(texts))), list(texts))


def test_every_line_end_and_a_byte_order_mark_are_read():
    assert decoded(Path("a"), b"\xef\xbb\xbfa\r\nb\rc\n") == "a\nb\nc\n"


def test_text_that_is_not_utf8_is_taken_for_windows_text():
    assert decoded(Path("a"), "Körper…".encode("cp1252")) == "Körper…"


def test_zero_bytes_are_refused_with_their_line():
    with pytest.raises(MeshError) as error:
        decoded(Path("a.obj"), b"v 1\nv 2\n\0\n")
    assert (error.value.where, error.value.found) == ("a.obj, line 3", "bytes that are not text")


def test_lines_that_hold_something_keep_their_numbers():
    assert list(filled_lines("v 1 2  \n\n  \t\n usemtl Körper # skin\n")) == [(1, "v 1 2"), (4, "usemtl Körper # skin")]
    assert list(filled_lines("")) == list(filled_lines(" \n")) == []


@given(some.lists(some.floats(), max_size=5), some.sampled_from("efgr"))
def test_numbers_are_those_that_python_reads(values, form):
    texts = [repr(value) if form == "r" else f"{value:.17{form}}" for value in values]
    found, expected = parsed(" ".join(texts), np.float64), np.array(list(map(float, texts)))
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))


def test_signs_points_and_exponents_may_stand_where_python_has_them():
    np.testing.assert_array_equal(
        parsed("-0 +1. -.5 1e5\t1E-3 00012\x0b2.5e+2 1e22", np.float64), [0, 1, -0.5, 1e5, 1e-3, 12, 250, 1e22]
    )


@pytest.mark.parametrize("text", ["x", "+", ".", "e5", "1e", "1e+", "--1", "1-", "0x1", "1_0", "1,5", "1-2", "1#2"])
def test_the_first_row_with_what_is_no_number_is_named(text):
    with pytest.raises(MeshError) as error:
        _ = rows("1 2", f"1 {text} 2", "x").numbers
    assert (error.value.where, error.value.found) == ("a.obj, line 6", repr(f"1 {text} 2"))


def test_a_table_is_as_wide_as_its_shortest_row():
    np.testing.assert_array_equal(
        rows("1 2 3 4", " 5\t6\x0b7 ", "8 9 1e1 11 12").table(3), [[1, 2, 3], [5, 6, 7], [8, 9, 10]]
    )
    assert rows().table(3).shape == (0, 3)


def test_numbers_of_ragged_rows_come_with_their_widths():
    ragged = rows("1 2", "", "3 4 5")
    assert (ragged.numbers.tolist(), ragged.widths.tolist()) == ([1, 2, 3, 4, 5], [2, 0, 3])


@pytest.mark.parametrize("bad", ["1 2", "", "1 2 nan", "1 2 -inf", "1e400 1 1"])
def test_the_first_row_that_is_no_position_is_named(bad):
    with pytest.raises(MeshError) as error:
        rows("1 2 3", bad, bad).positions()
    assert (error.value.where, error.value.found) == ("a.obj, line 6", repr(bad))


def test_a_quotation_in_a_message_is_shortened():
    with pytest.raises(MeshError) as error:
        rows("x" * 10_000).table(3)
    assert len(error.value.found) == 63


def test_spans_are_counted_up_one_after_another():
    np.testing.assert_array_equal(spans(np.array([5, 0, 9]), np.array([2, 0, 3])), [5, 6, 9, 10, 11])
