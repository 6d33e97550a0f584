import numpy as np
import pytest

from capture.formats import cad60
from capture.formats.layouts import CAD60
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

MILLIMETRES = np.arange(1, 46).reshape(15, 3) * 64.0
RATE = "The recording has no clock; 30 frames per second are assumed."


def _line(number, positions=MILLIMETRES, confidence=1):
    """Write one frame as the data set's documentation has it: eleven joints with an orientation, four without."""
    confidence = np.broadcast_to(confidence, 15)
    values = [str(number)]
    for joint in range(15):
        if joint < 11:
            values += ["0.5"] * 9 + ["1"]
        values += [f"{value:.3f}" for value in positions[joint]] + [f"{confidence[joint]:g}"]
    return ",".join(values) + ","


def _write(tmp_path, *lines, end="\n"):
    log = tmp_path / "0512164529.txt"
    log.write_text("\n".join(lines) + end)
    return log


def test_each_joint_is_found_by_its_place_in_metres(tmp_path):
    log = _write(tmp_path, _line(1), _line(4), "END")
    assert len(_line(1).split(",")) == 172
    assert cad60.matches(log.read_bytes())
    [clip] = cad60.read(log, ReadOptions())
    assert (clip.format, clip.user) == ("cad60", 0)
    assert clip.times.tolist() == [1 / 30, 4 / 30]
    for joint, name in enumerate(CAD60):
        assert clip.positions[1, JOINT_INDEX[name]] == pytest.approx(MILLIMETRES[joint] / 1000, abs=1e-12)
        assert clip.confidence[1, JOINT_INDEX[name]] == 1.0
    elbow, hand = (clip.positions[0, JOINT_INDEX[name]] for name in ("elbow_left", "hand_left"))
    assert clip.positions[0, JOINT_INDEX["wrist_left"]] == pytest.approx(elbow / 4 + 3 * hand / 4)
    assert clip.confidence[0, JOINT_INDEX["wrist_left"]] == 0.5
    assert clip.notes[0] == RATE
    assert "no hip centre, wrists and ankles" in clip.notes[1]
    assert "may be mirrored" in clip.notes[2]
    assert len(clip.notes) == 3


def test_confidence_0_is_inferred_and_a_joint_at_zero_takes_its_wrist_along(tmp_path):
    positions, confidence = MILLIMETRES.copy(), np.ones(15)
    positions[CAD60.index("hand_left")] = 0.0
    confidence[CAD60.index("head")] = 0.0
    [clip] = cad60.read(_write(tmp_path, _line(1, positions, confidence), "END"), ReadOptions())
    lost = [name for name, index in JOINT_INDEX.items() if clip.confidence[0, index] == 0]
    assert lost == ["wrist_left", "hand_left"]
    assert clip.confidence[0, JOINT_INDEX["head"]] == 0.5


def test_the_rate_can_be_given(tmp_path):
    [clip] = cad60.read(_write(tmp_path, _line(10), _line(20), "END"), ReadOptions(fps=10.0))
    assert clip.times.tolist() == [1.0, 2.0]
    assert RATE not in clip.notes


def test_a_missing_end_is_noted(tmp_path):
    [clip] = cad60.read(_write(tmp_path, _line(1)), ReadOptions())
    assert clip.notes[1] == "The recording has no END line; frames after its last line may be missing."


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (_line(2) + "1,", r"line 2: found 172 columns; expected 171 columns \(frame number"),
        (_line("nan"), "line 2: found 'nan' in column 1; expected a finite number"),
        ("END", r"line 2: found 1 columns; expected 171 columns"),
    ],
)
def test_a_line_that_does_not_fit_is_refused(tmp_path, line, message):
    with pytest.raises(SkeletonLogError, match=message):
        cad60.read(_write(tmp_path, _line(1), line, "END"), ReadOptions())


@pytest.mark.parametrize("torn", [_line(2)[:100], "-"])
def test_a_log_cut_in_mid_line_is_read_up_to_the_last_whole_one(tmp_path, assert_same_frames, torn):
    [whole] = cad60.read(_write(tmp_path, _line(1), _line(4)), ReadOptions())
    [clip] = cad60.read(_write(tmp_path, _line(1), _line(4), torn, end=""), ReadOptions())
    note = "The file ends in the middle of line 3. This frame is omitted."
    assert [text for text in clip.notes if text not in whole.notes] == [note]
    assert_same_frames(clip, whole)


def test_orientations_which_are_not_used_may_be_anything(tmp_path, assert_same_frames):
    [whole] = cad60.read(_write(tmp_path, _line(1), "END"), ReadOptions())
    [clip] = cad60.read(_write(tmp_path, _line(1).replace("0.5,0.5", "nan,-inf"), "END"), ReadOptions())
    assert_same_frames(clip, whole)
    assert clip.notes == whole.notes


def test_a_short_line_that_the_file_does_not_end_in_is_refused(tmp_path):
    for lines, end in (([_line(2)[:100]], "\n"), ([_line(2)[:100], _line(3)], "")):
        with pytest.raises(SkeletonLogError, match=r"line 2: found \d+ columns"):
            cad60.read(_write(tmp_path, _line(1), *lines, end=end), ReadOptions())


def test_a_log_cut_within_its_only_line_is_refused(tmp_path):
    with pytest.raises(SkeletonLogError, match=r"line 1: found the end of the file after \d+ columns"):
        cad60.read(_write(tmp_path, _line(1)[:100], end=""), ReadOptions())


@pytest.mark.parametrize("lines", [["END"], [_line(1, 0 * MILLIMETRES), "END"]])
def test_a_log_without_a_tracked_frame_is_refused(tmp_path, lines):
    with pytest.raises(SkeletonLogError, match=f"no tracked performer in any of {len(lines) - 1} frames"):
        cad60.read(_write(tmp_path, *lines), ReadOptions())


@pytest.mark.parametrize("text", ["", "END\n", "1," * 170, "1," * 172, "1 " * 171, "x," + "1," * 170])
def test_other_texts_do_not_match(text):
    assert not cad60.matches(text.encode())
