from pathlib import Path

import numpy as np
import pytest

from engine_bridge.character.surfaces.text import Rows, decoded, lines_of, spans, word
from puppetline.errors import MeshError


def rows(*texts):
    ends = np.cumsum([len(text.encode()) for text in texts], dtype=np.int64)
    starts = ends - [len(text.encode()) for text in texts]
    data = np.frombuffer("".join(texts).encode(), np.uint8)
    return Rows(Path("a.obj"), "'v x y z'", data, np.arange(5, 5 + len(texts)), starts.astype(np.int64), ends)


def test_every_line_end_and_a_byte_order_mark_are_read():
    assert decoded(Path("a"), b"\xef\xbb\xbfa\r\nb\rc\n") == "a\nb\nc\n"


def test_text_that_is_not_utf8_is_taken_for_windows_text():
    assert decoded(Path("a"), "Körper…".encode("cp1252")) == "Körper…"


def test_zero_bytes_are_refused_with_their_line():
    with pytest.raises(MeshError) as error:
        decoded(Path("a.obj"), b"v 1\nv 2\n\0\n")
    assert (error.value.where, error.value.found) == ("a.obj, line 3", "bytes that are not text")


def test_lines_that_hold_something_keep_their_numbers_and_texts():
    lines = lines_of("v 1 2  \n\n  \t\n usemtl Körper # skin\n")
    assert len(lines) == 2
    assert lines.numbers.tolist() == [1, 4]
    assert [lines.text(line) for line in range(2)] == ["v 1 2  ", "usemtl Körper # skin"]
    assert lines.words.tolist() == [word("v"), word("usemtl")]
    assert lines.data[lines.comments[1] : lines.ends[1]].tobytes() == b"# skin"
    assert len(lines_of("")) == len(lines_of(" \n")) == 0


def test_the_lines_that_go_on_in_the_next_count_for_the_numbers_of_those_after_them():
    assert lines_of("a\rb\n\nc\r\rd\ne", "\r").numbers.tolist() == [1, 4, 7]


def test_a_table_is_as_wide_as_its_shortest_row():
    np.testing.assert_array_equal(
        rows("1 2 3 4", " 5\t6\x0b7 ", "8 9 1e1 11 12").table(3), [[1, 2, 3], [5, 6, 7], [8, 9, 10]]
    )
    assert rows().table(3).shape == (0, 3)


def test_numbers_of_ragged_rows_come_with_their_widths():
    values, widths = rows("1 2", "", "3 4 5").numbers
    assert (values.tolist(), widths.tolist()) == ([1, 2, 3, 4, 5], [2, 0, 3])


@pytest.mark.parametrize("bad", ["1 2 x", "1,0 2 3", "1_0 2 3", "0x10 2 3", "--1 2 3"])
def test_the_first_row_with_what_is_no_number_is_named(bad):
    with pytest.raises(MeshError) as error:
        _ = rows("1 2 3", bad, "x").numbers
    assert (error.value.where, error.value.found) == ("a.obj, line 6", repr(bad))


@pytest.mark.parametrize("bad", ["1 2", "", "1 2 nan", "1 2 -inf", "1e400 1 1"])
def test_the_first_row_that_is_no_position_is_named(bad):
    with pytest.raises(MeshError) as error:
        rows("1 2 3", bad, bad).positions()
    assert (error.value.where, error.value.found) == ("a.obj, line 6", repr(bad))


def test_what_is_quoted_is_not_long():
    with pytest.raises(MeshError) as error:
        rows("x" * 10_000).table(3)
    assert len(error.value.found) == 63


def test_spans_are_counted_up_one_after_another():
    np.testing.assert_array_equal(spans(np.array([5, 0, 9]), np.array([2, 0, 3])), [5, 6, 9, 10, 11])
