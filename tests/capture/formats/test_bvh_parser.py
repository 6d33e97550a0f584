from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from capture.formats import bvh, bvh_parser
from capture.formats.options import ReadOptions
from puppetline.errors import SkeletonLogError

from .bvh_files import BODY, JOINT_COUNT, body_file, clips_of, hierarchy, motion, random_rows, write
from .conftest import assert_refused

GOOD = ["HIERARCHY", *hierarchy(BODY), *motion(np.zeros((3, 3 + 3 * JOINT_COUNT)))]
MOTION = GOOD.index("MOTION") + 1  # the number of its line, from 1


def broken(line: int, text: str | None) -> list[str]:
    """Return the valid file with one line replaced, or cut off before that line."""
    return GOOD[: line - 1] if text is None else [*GOOD[: line - 1], text, *GOOD[line:]]


ZEROS = ["0"] * (3 + 3 * JOINT_COUNT)


@pytest.mark.parametrize(
    ("lines", "place", "message"),
    [
        (broken(1, "HIERARCHIE"), "line 1", "'HIERARCHIE'; expected HIERARCHY"),
        (broken(2, "JOINT Hips"), "line 2", "expected ROOT"),
        (broken(3, "OFFSET 0 0 0"), "line 3", "expected {"),
        (broken(4, "CHANNELS 0"), "line 4", "expected OFFSET"),
        (broken(4, "OFFSET 0 0"), "line 4", "2 columns"),
        (broken(4, "OFFSET 0 nan 0"), "line 4", "'nan' in column 2"),
        (broken(4, "OFFSET 0 0 -1e300"), "line 4", "the number -1e+300"),
        (broken(5, "CHANNELS 6 Xrotation"), "line 5", "CHANNELS, their number"),
        (broken(5, "CHANNELS 2 Xrotation Xrotation"), "line 5", "different channels"),
        (broken(6, "JOINTS Spine"), "line 6", "'JOINTS Spine'"),
        (broken(MOTION - 1, "MOTION"), f"line {MOTION - 1}", "'MOTION'"),
        (broken(MOTION, "}"), f"line {MOTION}", "'}'"),
        (broken(MOTION, "ROOT second"), f"line {MOTION + 1}", "expected {"),
        (broken(MOTION + 1, "Frames: many"), f"line {MOTION + 1}", "Frames: and an integer"),
        (broken(MOTION + 2, "Frame Time: 0"), f"line {MOTION + 2}", "Set the frames per second"),
        (broken(MOTION + 2, "Frame Time: 0,04"), f"line {MOTION + 2}", "'0,04' in column 1; expected a finite number"),
        (broken(MOTION + 2, "0 0 0"), f"line {MOTION + 2}", "Frame Time: and seconds"),
        (broken(MOTION + 4, " ".join(ZEROS[1:])), f"line {MOTION + 4}", f"{len(ZEROS) - 1} columns"),
        ([*GOOD, "0 0 0"], f"line {len(GOOD) + 1}", "3 columns"),
        (broken(MOTION + 4, " ".join(["nan", *ZEROS[1:]])), f"line {MOTION + 4}", "'nan' in column 1"),
        (broken(MOTION + 4, " ".join(["0", "1e300", *ZEROS[2:]])), f"line {MOTION + 4}", "the number 1e+300"),
        (broken(MOTION + 1, None), f"line {MOTION}", "the end of the file after this line; expected Frames"),
        (broken(10, None), "line 9", "the end of the file after this line"),
        ([*GOOD[:5], *["JOINT a", "{", "OFFSET 0 0 0", "CHANNELS 0"] * 600], "line 2002", "more than 500 joints"),
        (["OFFSET 0 0 0" if "OFFSET" in line else line for line in GOOD], "take.bvh", "a body without size"),
        ([line.replace("LeftForeArm", "Wing") for line in GOOD], "take.bvh", "no joint for elbow_left"),
    ],
)
def test_violations_of_the_format_are_refused_with_their_place(
    tmp_path: Path, lines: list[str], place: str, message: str
) -> None:
    assert_refused(bvh, write(tmp_path, lines), place, message)


def test_names_and_keywords_of_other_programs_make_the_same_clip_without_a_note(
    tmp_path: Path, assert_same_frames: Callable[..., None]
) -> None:
    path = body_file(tmp_path, random_rows())
    (whole,) = clips_of(path)
    text = path.read_text()
    number = text.index("MOTION")
    for other in (
        text.replace("HIERARCHY", "Hierarchy").replace("ROOT", "root").replace("JOINT", "Joint"),
        text.replace("End Site", "END SITE").replace("OFFSET", "Offset").replace("CHANNELS", "channels"),
        text.replace("MOTION", "Motion").replace("Frames:", "FRAMES:").replace("Frame Time:", "frame time:"),
        text.replace("Frames: ", "Frames ").replace("Frame Time: ", "FrameTime:"),
        text.replace("Frames: ", "Frames :\t").replace("Frame Time: ", "Frame  Time :  "),
        text[:number].replace("\n", " \n\n\t") + text[number:],
        text.replace("{\n\t", "{ ").replace("\n}\n", " }\n"),
        text + "\n \n\t\n",
        text.removesuffix("\n"),
    ):
        assert other != text
        path.write_text(other)
        assert bvh.matches(path.read_bytes())
        (clip,) = clips_of(path)
        assert_same_frames(clip, whole)
        assert clip.notes == whole.notes


@pytest.mark.parametrize("stated", [0, 1, 5, 7, 999_999_999])
def test_a_wrong_frame_count_is_noted_and_all_frames_are_read(
    tmp_path: Path, assert_same_frames: Callable[..., None], stated: int
) -> None:
    path = body_file(tmp_path, random_rows())
    (whole,) = clips_of(path)
    path.write_text(path.read_text().replace("Frames: 6", f"Frames: {stated}"))
    (clip,) = clips_of(path)
    assert_same_frames(clip, whole)
    note = f"The stated frame count is {stated} and the real one is 6. All complete frames are read."
    assert clip.notes == (*whole.notes, note)


def test_a_recording_cut_off_within_a_line_is_read_up_to_the_last_complete_line(
    tmp_path: Path, assert_same_frames: Callable[..., None]
) -> None:
    rows = random_rows()
    (whole,) = clips_of(body_file(tmp_path, rows[:5]))
    path = body_file(tmp_path, rows)
    text = path.read_text().removesuffix("\n")
    last = text.rindex("\n") + 1
    for length in range(last + 1, text.rindex(" ") + 1, 13):
        path.write_text(text[:length])
        (clip,) = clips_of(path)
        assert_same_frames(clip, whole)
        assert clip.notes == (
            *whole.notes,
            f"The file ends in the middle of line {MOTION + 8}. This frame is omitted.",
            "The stated frame count is 6 and the real one is 5. All complete frames are read.",
        )


def test_a_recording_cut_off_within_its_first_frame_is_refused(tmp_path: Path) -> None:
    path = body_file(tmp_path, random_rows())
    path.write_text("\n".join(path.read_text().split("\n")[: MOTION + 3])[:-30])
    with pytest.raises(SkeletonLogError, match=f"line {MOTION + 3}: found the end of the file after"):
        clips_of(path)


def test_text_after_the_last_frame_is_skipped_with_a_note(
    tmp_path: Path, assert_same_frames: Callable[..., None]
) -> None:
    (whole,) = clips_of(write(tmp_path, GOOD))
    (clip,) = clips_of(write(tmp_path, [*GOOD, "", "# made by hand", "END of take 7"]))
    assert_same_frames(clip, whole)
    note = f"The text from line {len(GOOD) + 2} on, after the last frame, is omitted."
    assert clip.notes == (*whole.notes, note)


@pytest.mark.parametrize("stated", ["0", "0.0", "-0.1", "1e9"])
def test_a_recording_without_a_frame_time_has_the_configured_rate(tmp_path: Path, stated: str) -> None:
    path = body_file(tmp_path, random_rows())
    (whole,) = clips_of(path)
    (given,) = clips_of(path, fps=50.0)
    assert given.times.tolist() == whole.times.tolist()  # the file's own frame time counts
    path.write_text(path.read_text().replace("Frame Time: 0.04", f"Frame Time: {stated}"))
    (clip,) = clips_of(path, fps=50.0)
    assert clip.times.tolist() == [0.0, 0.02, 0.04, 0.06, 0.08, 0.1]
    np.testing.assert_array_equal(clip.positions, whole.positions)
    note = f"The frame time of {float(stated):g} s is invalid. 50 frames per second are used, as given."
    assert clip.notes == (*whole.notes, note)


def test_braces_tabs_and_newlines_of_other_programs_are_read(tmp_path: Path) -> None:
    (expected,) = bvh.read(body_file(tmp_path, random_rows()), ReadOptions())
    text = (
        (tmp_path / "take.bvh").read_text().replace("\n{", " {").replace(" ", "\t").replace("Frame\tTime", "Frame Time")
    )
    path = tmp_path / "other.bvh"
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    assert bvh.matches(path.read_bytes())
    np.testing.assert_array_equal(bvh.read(path, ReadOptions())[0].positions, expected.positions)


def test_more_places_than_memory_should_hold_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bvh_parser, "MAX_POSITIONS", 60)
    with pytest.raises(SkeletonLogError, match="3 frames of 25 joints; expected at most 2 frames"):
        bvh.read(write(tmp_path, GOOD), ReadOptions())
