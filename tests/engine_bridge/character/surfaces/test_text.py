from pathlib import Path

import pytest

from engine_bridge.character.surfaces.text import decoded, filled_lines, position, unreadable
from puppetline.errors import MeshError


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
    assert list(filled_lines("a # b\n# c\nd", comment="#")) == [(1, "a"), (3, "d")]
    assert list(filled_lines("")) == list(filled_lines(" \n")) == []


def test_a_position_is_three_finite_numbers_of_any_spelling():
    assert position(["-.5", "1e5", "+1.", "red"]) == [-0.5, 1e5, 1.0]
    assert position(["-1e18", "1e18", "0"]) == [-1e18, 1e18, 0]


@pytest.mark.parametrize(
    "line", ["1 2", "", "1 2 nan", "1 2 -inf", "1e400 1 1", "1 2 1e19", "1 2 x", "0x1 2 3", "1,5 2 3"]
)
def test_anything_else_is_no_position(line):
    with pytest.raises(ValueError, match=r"."):
        position(line.split())


def test_a_quotation_in_a_message_is_shortened():
    error = unreadable(Path("a.obj"), 6, "x" * 10_000, "'v x y z'")
    assert (error.where, len(error.found)) == ("a.obj, line 6", 63)
