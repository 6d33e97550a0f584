import numpy as np
import pytest

from capture.formats._rows import CutOffError, RowLayout, confidence_from_states, head_lines, read_lines
from puppetline.errors import SkeletonLogError

TRIPLE = RowLayout(3, "x y z")
COMMA = RowLayout(3, "x, y, z", separator=",")


def test_lines_keep_their_numbers_when_blank_lines_are_skipped(tmp_path):
    log = tmp_path / "log.txt"
    log.write_bytes(b"\xef\xbb\xbf1 2 3\r\n\r\n \t\r\n4 5 6\r\n7 8")
    assert read_lines(log) == [(1, "1 2 3\n"), (4, "4 5 6\n"), (5, "7 8")]


@pytest.mark.parametrize(
    ("layout", "text"),
    [
        (TRIPLE, "  1.0000000e+000\t-2.5   3\n"),
        *((COMMA, text) for text in ("1,-2.5,3\n", "1,-2.5,3,\n", "1, -2.5, 3, \n", "1,-2.5,3")),
    ],
)
def test_a_row_is_read_whatever_the_white_space_the_number_style_and_a_last_comma(layout, text):
    assert layout.numbers("log", (1, text)) == [1.0, -2.5, 3.0]


def test_a_table_has_its_columns_even_without_rows():
    assert TRIPLE.table("log", []).shape == (0, 3)
    assert np.array_equal(TRIPLE.table("log", [(1, "1 2 3\n"), (3, "4 5 6\n")]), [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    ("layout", "text", "found"),
    [
        *((TRIPLE, text, f"{len(text.split())} columns") for text in ("1 2\n", "1 2 3 4\n", "1 2 3 4")),
        *(
            (TRIPLE, f"1 {field} 3\n", f"'{field}' in column 2")
            for field in ("nan", "-inf", "1e999", "x", "1.#QNAN", "0,5")
        ),
        (COMMA, "1,,3\n", "'' in column 2"),
    ],
)
def test_a_row_of_another_length_or_without_finite_numbers_is_refused_with_line_and_column(layout, text, found):
    with pytest.raises(SkeletonLogError) as caught:
        layout.numbers("log.txt", (7, text))
    assert not isinstance(caught.value, CutOffError)
    assert (caught.value.where, caught.value.found) == ("log.txt, line 7", found)


@pytest.mark.parametrize("text", ["1", "1 2", "1 -", "1 EN", "1 2 -", "1 2 1e", "1 2 1e-", "1 2 +."])
def test_a_last_line_that_is_cut_off_is_skipped_with_a_note_or_an_error_of_its_own(text):
    whole = [(1, "1 2 3\n"), (2, "4 5 6\n")]
    rows, (note,) = TRIPLE.complete([*whole, (7, text)])
    assert rows == whole
    assert "line 7" in note
    with pytest.raises(CutOffError) as caught:
        TRIPLE.numbers("log.txt", (7, text))
    assert caught.value.where == "log.txt, line 7"


@pytest.mark.parametrize("text", ["1 2\n", "1 2 3", "1 x 3", "1 2 3 4", "1 2 3 -", "1 2 nan"])
def test_other_last_lines_are_kept(text):
    for lines in ([(1, "1 2 3\n"), (7, text)], [(1, "1 2")], []):
        assert TRIPLE.complete(lines) == (lines, ())


def test_columns_that_are_not_used_may_be_infinite_but_must_be_numbers():
    layout = RowLayout(3, "x y z", unused=(1,))
    assert layout.numbers("log.txt", (7, "1 -Infinity 3\n")) == [1.0, -np.inf, 3.0]
    for text in ("nan 2 3\n", "1 x 3\n", "1 inf inf\n"):
        with pytest.raises(SkeletonLogError):
            layout.numbers("log.txt", (7, text))


@pytest.mark.parametrize(
    ("data", "where"), [(b"\x89PNG\xff\xfe\x00", ""), (b"1 2 3\n\0\0\0\0", ", line 2"), (None, "")]
)
def test_a_file_that_is_not_text_or_not_there_is_refused(tmp_path, data, where):
    log = tmp_path / "log.txt"
    if data:
        log.write_bytes(data)
    with pytest.raises(SkeletonLogError) as caught:
        read_lines(log)
    assert caught.value.where == f"{log}{where}"


@pytest.mark.parametrize(
    ("text", "fits"), [("1 2 3\n", True), ("1 nan 3", True), ("1 2\n", False), ("1 2 x\n", False), ("1,2,3\n", False)]
)
def test_a_line_fits_by_its_columns_and_numbers_alone(text, fits):
    assert TRIPLE.fits(text) is fits


def test_a_head_that_ends_within_a_character_is_split_into_lines():
    head = "\ufeff1 2\r\n\n3 é".encode()[:-1]
    assert head_lines(head) == ["1 2", "3 \ufffd"]
    assert head_lines(head, 1) == ["1 2"]


def test_states_become_the_confidences_of_their_level_and_an_unknown_one_is_refused_with_its_line():
    lines, levels = [(1, ""), (4, "")], (0.0, 0.5, 1.0)
    confidence = confidence_from_states("log", lines, np.array([[0.0, 2.0], [1.0, 0.0]]), levels)
    assert confidence.dtype == np.float32
    assert confidence.tolist() == [[0.0, 1.0], [0.5, 0.0]]
    for state in (3.0, -1.0, 0.5):
        with pytest.raises(SkeletonLogError) as caught:
            confidence_from_states("log", lines, np.array([[0.0, 1.0], [0.0, state]]), levels)
        assert (caught.value.where, caught.value.found) == ("log, line 4", f"the joint state {state:g}")
