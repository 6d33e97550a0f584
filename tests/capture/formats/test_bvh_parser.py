import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.formats import bvh, clips

from .bvh_files import lines_of, random_rows, still

GOOD = lines_of(still(3))
MOTION = GOOD.index("MOTION") + 1  # the number of its line, from 1


def broken(line, *text):
    """Return the valid file with one line replaced, or cut off before that line."""
    return [*GOOD[: line - 1], *text, *GOOD[line:]] if text else GOOD[: line - 1]


ZEROS = ["0"] * still().shape[1]


@pytest.mark.parametrize(
    ("lines", "line"),
    [
        (broken(1, "HIERARCHIE"), 1),
        (broken(2, "JOINT Hips"), 2),
        (broken(3, "OFFSET 0 0 0"), 3),
        (broken(4, "CHANNELS 0"), 5),
        (broken(4, "OFFSET 0 0"), 4),
        (broken(4, "OFFSET 0 nan 0"), 4),
        (broken(4, "OFFSET 0 0 -1e300"), 4),
        (broken(5, "CHANNELS 6 Xrotation"), 5),
        (broken(5, "CHANNELS 2 Xrotation Xrotation"), 5),
        (broken(5, "CHANNELS 1 Xscale"), 5),
        (broken(6, "JOINTS Spine"), 6),
        (broken(MOTION - 1, "MOTION"), MOTION - 1),
        (broken(MOTION, "}"), MOTION),
        (broken(MOTION, "ROOT second"), MOTION + 1),
        (broken(MOTION + 1, "Frames: many"), MOTION + 1),
        (broken(MOTION + 2, "Frame Time: 0,04"), MOTION + 2),
        (broken(MOTION + 2, "0 0 0"), MOTION + 2),
        (broken(MOTION + 4, " ".join(ZEROS[1:])), MOTION + 4),
        ([*GOOD, "0 0 0"], len(GOOD) + 1),
        (broken(MOTION + 4, " ".join(["zero", *ZEROS[1:]])), MOTION + 4),
        (broken(MOTION + 4, " ".join(["0", "1e300", *ZEROS[2:]])), MOTION + 4),
        (broken(MOTION + 1), MOTION),
        (broken(MOTION + 3), MOTION + 2),  # no frame
        (broken(10), 9),
        ([*GOOD[:5], *["JOINT a", "{", "OFFSET 0 0 0", "CHANNELS 0"] * 600], 2002),
        ("\n".join(GOOD[: MOTION + 3])[:-30], MOTION + 3),
        (["OFFSET 0 0 0" if "OFFSET" in line else line for line in GOOD], None),
    ],
)
def test_violations_of_the_format_are_refused_with_their_place(refused_at, lines, line):
    assert refused_at(bvh, lines) == ("" if line is None else f"line {line}")


WHOLE = "".join(f"{line}\n" for line in lines_of(random_rows()))


@pytest.fixture
def whole(read):
    [clip] = read(bvh, WHOLE)
    return clip


@pytest.mark.parametrize(
    "changes",
    [
        {"HIERARCHY": "Hierarchy", "ROOT": "root", "JOINT": "Joint"},
        {"End Site": "END SITE", "OFFSET": "Offset", "CHANNELS": "channels"},
        {"MOTION": "Motion", "Frames:": "FRAMES:", "Frame Time:": "frame time:"},
        {"Frames: ": "Frames ", "Frame Time: ": "FrameTime:"},
        {"Frames: ": "Frames :\t", "Frame Time: ": "Frame  Time :  "},
        {"}\n": "} \n\n\t"},
        {"{\n\t": "{ ", "\n}\n": " }\n"},
        {"\n{": " {", " ": "\t", "Frame\tTime": "Frame Time", "\n": "\r\n", "HIERARCHY": "\ufeffHIERARCHY"},
        {"MOTION\n": ""},
    ],
)
def test_names_keywords_and_spaces_of_other_programs_make_the_same_clip_without_a_note(
    read, whole, assert_same_frames, changes
):
    text = WHOLE
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    for other in (text, text.rstrip(), text + "\n \n\t\n"):
        assert bvh.matches(other.encode())
        (clip,) = read(bvh, other)
        assert_same_frames(clip, whole)
        assert clip.notes == whole.notes


def test_a_wrong_frame_count_or_a_cut_off_file_is_noted_and_complete_frames_are_read(read, whole, assert_same_frames):
    for stated in (0, 5, 7, 999_999_999):
        (clip,) = read(bvh, WHOLE.replace("Frames: 6", f"Frames: {stated}"))
        assert_same_frames(clip, whole)
        (note,) = clip.notes[len(whole.notes) :]
        assert f" {stated} " in note
    text = WHOLE.removesuffix("\n")
    last = text.rindex("\n") + 1
    (five,) = read(bvh, text[:last].replace("Frames: 6", "Frames: 5"))
    for length in [*range(last + 1, last + 25), text.rindex(" ")]:
        (clip,) = read(bvh, text[:length])
        assert_same_frames(clip, five)
        line, count = clip.notes[len(five.notes) :]
        assert f"line {MOTION + 8}" in line
        assert " 6 " in count


def test_few_damaged_lines_of_motion_are_omitted_and_the_others_keep_their_time(read):
    lines = lines_of(random_rows(40, 7))
    (whole,) = read(bvh, lines)
    lines[-30] = lines[-30].rsplit(" ", 1)[0]
    lines[-10] += " 0.5"
    (clip,) = read(bvh, lines)
    kept = np.delete(np.arange(40), [10, 30])
    assert_array_equal(clip.times, whole.times[kept])
    assert_array_equal(clip.positions, whole.positions[kept])
    (note,) = set(clip.notes) - set(whole.notes)
    assert "2 of 40 frames" in note


def test_text_after_the_last_frame_is_skipped_with_a_note(read, assert_same_frames):
    (whole,) = read(bvh, GOOD)
    (clip,) = read(bvh, [*GOOD, "", "# made by hand", "END of take 7"])
    assert_same_frames(clip, whole)
    (note,) = clip.notes[len(whole.notes) :]
    assert f"line {len(GOOD) + 2}" in note


@pytest.mark.parametrize("stated", ["0", "0.0", "-0.1", "1e9"])
def test_a_recording_without_a_frame_time_has_the_configured_rate(read, whole, stated):
    (given,) = read(bvh, WHOLE, fps=50.0)
    text = WHOLE.replace("Frame Time: 0.04", f"Frame Time: {stated}")
    for clip, rate in ((given, 50), *((read(bvh, text, fps=fps)[0], fps or 30) for fps in (50.0, None))):
        assert_allclose(clip.times, np.arange(6) / rate, rtol=0, atol=1e-12)
        assert_array_equal(clip.positions, whole.positions)
        assert len(clip.notes) == len(whole.notes) + 1


def test_a_frame_time_in_milliseconds_a_missing_header_and_channels_before_the_offset_are_read(
    read, whole, assert_same_frames
):
    (clip,) = read(bvh, WHOLE.replace("Frame Time: 0.04", "Frame Time: 40"))
    assert_allclose(clip.times, whole.times)
    (clip,) = read(bvh, WHOLE.replace("Frames: 6\nFrame Time: 0.04\n", ""), fps=25)
    assert_same_frames(clip, whole)
    lines = WHOLE.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("CHANNELS"))
    lines[first - 1], lines[first] = lines[first], lines[first - 1]
    (clip,) = read(bvh, lines)
    assert_same_frames(clip, whole)


def test_a_hierarchy_without_motion_is_its_rest_pose(read):
    (rest,), (still,) = read(bvh, GOOD[: MOTION - 1]), read(bvh, GOOD)
    assert rest.times.tolist() == [0.0]
    assert_allclose(rest.positions[0], still.positions[0], atol=1e-12)


def test_more_places_than_memory_should_hold_are_refused(refused_at, monkeypatch):
    monkeypatch.setattr(clips, "MAX_POSITIONS", 3 * 25 - 1)
    assert refused_at(bvh, GOOD) == f"line {len(GOOD)}"
