import numpy as np
import pytest

from capture.formats._rows import WHOLE_FRAME, CutOffError, RowLayout, confidence_from_states, head_lines, read_lines
from puppetline.errors import SkeletonLogError

TRIPLE = RowLayout(3, "x y z")
COMMA = RowLayout(3, "x, y, z", separator=",")


def test_lines_keep_their_numbers_when_blank_lines_are_skipped(tmp_path):
    log = tmp_path / "log.txt"
    log.write_bytes(b"\xef\xbb\xbf1 2 3\r\n\r\n \t\r\n4 5 6\r\n7 8")
    assert read_lines(log) == [(1, "1 2 3\n"), (4, "4 5 6\n"), (5, "7 8")]


def test_a_row_is_read_whatever_the_white_space_and_number_style():
    assert TRIPLE.numbers("log", (1, "  1.2000000e+002\t-3   .5\n")) == [120.0, -3.0, 0.5]


@pytest.mark.parametrize("text", ["1,-2.5,3\n", "1,-2.5,3,\n", "1, -2.5, 3, \n", "1,-2.5,3"])
def test_a_comma_row_may_end_in_a_comma(text):
    assert COMMA.numbers("log", (1, text)) == [1.0, -2.5, 3.0]


def test_a_table_has_its_columns_even_without_rows(tmp_path):
    assert TRIPLE.table(tmp_path, []).shape == (0, 3)
    assert np.array_equal(TRIPLE.table(tmp_path, [(1, "1 2 3\n"), (3, "4 5 6\n")]), [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(("text", "columns"), [("1 2\n", 2), ("1 2 3 4\n", 4), ("1 2 3 4", 4)])
def test_a_row_with_another_number_of_columns_is_refused_with_line_and_both_numbers(text, columns):
    with pytest.raises(SkeletonLogError) as caught:
        TRIPLE.numbers("log.txt", (7, text))
    assert caught.value.where == "log.txt, line 7"
    assert caught.value.found == f"{columns} columns"
    assert caught.value.expected == "3 columns (x y z)"
    assert caught.value.fix == "Correct it or delete this line, or record again."


@pytest.mark.parametrize("field", ["nan", "-inf", "1e999", "x", "1.#QNAN", "0,5"])
def test_a_field_that_is_no_finite_number_is_refused_with_line_and_column(field):
    with pytest.raises(SkeletonLogError) as caught:
        TRIPLE.numbers("log.txt", (7, f"1 {field} 3\n"))
    assert caught.value.where == "log.txt, line 7"
    assert caught.value.found == f"'{field}' in column 2"
    assert "finite number" in caught.value.expected


def test_an_empty_field_between_commas_is_refused():
    with pytest.raises(SkeletonLogError, match="found '' in column 2"):
        COMMA.numbers("log.csv", (1, "1,,3\n"))


@pytest.mark.parametrize("text", ["1", "1 2", "1 -", "1 EN", "1 2 -", "1 2 1e", "1 2 1e-", "1 2 +."])
def test_a_last_line_that_is_cut_off_is_skipped_with_a_note(text):
    whole = [(1, "1 2 3\n"), (2, "4 5 6\n")]
    assert TRIPLE.complete([*whole, (7, text)]) == (
        whole,
        ("The file ends in the middle of line 7. This frame is omitted.",),
    )


@pytest.mark.parametrize("text", ["1 2\n", "1 2 3", "1 x 3", "1 2 3 4", "1 2 3 -", "1 2 nan"])
def test_other_last_lines_are_kept(text):
    lines = [(1, "1 2 3\n"), (7, text)]
    assert TRIPLE.complete(lines) == (lines, ())


def test_a_cut_off_line_without_a_line_before_it_is_kept():
    assert TRIPLE.complete([(1, "1 2")]) == ([(1, "1 2")], ())
    assert TRIPLE.complete([]) == ([], ())


def test_columns_that_are_not_used_may_be_infinite_but_must_be_numbers():
    layout = RowLayout(3, "x y z", unused=(1,))
    assert layout.numbers("log.txt", (7, "1 -Infinity 3\n")) == [1.0, -np.inf, 3.0]
    for text, column in (("nan 2 3\n", 1), ("1 x 3\n", 2), ("1 inf inf\n", 3)):
        with pytest.raises(SkeletonLogError, match=f"in column {column}; expected a finite number"):
            layout.numbers("log.txt", (7, text))


def test_a_line_that_the_file_ends_within_is_an_error_of_its_own():
    with pytest.raises(CutOffError) as caught:
        TRIPLE.numbers("log.txt", (7, "1 2"))
    assert caught.value.where == "log.txt, line 7"
    assert caught.value.found == "the end of the file after 2 columns"
    assert "3 columns" in caught.value.expected
    assert caught.value.fix == "The file seems incomplete. Delete this line, or record again."


def test_the_fix_for_a_frame_of_several_lines_deletes_all_of_them():
    layout = RowLayout(3, "x y z", frame=WHOLE_FRAME)
    for text, fix in {
        "1 2\n": "Correct it or delete all lines of this frame, or record again.",
        "1 2 x\n": "Correct it or delete all lines of this frame, or record again.",
        "1 2": "The file seems incomplete. Delete all lines of this frame, or record again.",
    }.items():
        with pytest.raises(SkeletonLogError) as caught:
            layout.numbers("log.txt", (7, text))
        assert caught.value.fix == fix


@pytest.mark.parametrize(("data", "where"), [(b"\x89PNG\xff\xfe\x00", ""), (b"1 2 3\n\0\0\0\0", ", line 2")])
def test_bytes_that_are_not_text_are_refused(tmp_path, data, where):
    log = tmp_path / "log.txt"
    log.write_bytes(data)
    with pytest.raises(SkeletonLogError) as caught:
        read_lines(log)
    assert caught.value.where == f"{log}{where}"
    assert "not text" in caught.value.found
    assert "plain text" in caught.value.fix


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(
        SkeletonLogError, match=r"gone\.txt: found a file that cannot be read \(No such file or directory\)"
    ):
        read_lines(tmp_path / "gone.txt")


@pytest.mark.parametrize(
    ("text", "fits"), [("1 2 3\n", True), ("1 nan 3", True), ("1 2\n", False), ("1 2 x\n", False), ("1,2,3\n", False)]
)
def test_a_line_fits_by_its_columns_and_numbers_alone(text, fits):
    assert TRIPLE.fits(text) is fits


def test_a_head_that_ends_within_a_character_is_split_into_lines():
    head = "\ufeff1 2\r\n\n3 é".encode()[:-1]
    assert head_lines(head) == ["1 2", "3 \ufffd"]
    assert head_lines(head, 1) == ["1 2"]


def test_states_become_the_confidences_of_their_level():
    states = np.array([[0.0, 2.0], [1.0, 0.0]])
    confidence = confidence_from_states("log", [(1, ""), (2, "")], states, (0.0, 0.5, 1.0))
    assert confidence.dtype == np.float32
    assert confidence.tolist() == [[0.0, 1.0], [0.5, 0.0]]


@pytest.mark.parametrize("state", [3.0, -1.0, 0.5])
def test_an_unknown_state_is_refused_with_its_line(state):
    with pytest.raises(SkeletonLogError) as caught:
        confidence_from_states("log.csv", [(1, ""), (4, "")], np.array([[0.0, 1.0], [0.0, state]]), (0.0, 0.5, 1.0))
    assert caught.value.where == "log.csv, line 4"
    assert caught.value.found == f"the joint state {state:g}"
    assert caught.value.expected == "a state from 0 to 2"
