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
    """Return one frame as in the data set's documentation: eleven joints with an orientation, four without."""
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


def test_confidence_0_is_inferred_and_a_lost_hand_loses_its_wrist(tmp_path):
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


def test_an_end_before_the_last_line_is_refused(tmp_path):
    with pytest.raises(SkeletonLogError, match=r"line 2: found 1 columns; expected 171 columns \(frame number"):
        cad60.read(_write(tmp_path, _line(1), "END", "END"), ReadOptions())


def test_orientations_which_are_not_used_may_be_anything(tmp_path, assert_same_frames):
    [whole] = cad60.read(_write(tmp_path, _line(1), "END"), ReadOptions())
    [clip] = cad60.read(_write(tmp_path, _line(1).replace("0.5,0.5", "nan,-inf"), "END"), ReadOptions())
    assert_same_frames(clip, whole)
    assert clip.notes == whole.notes


@pytest.mark.parametrize("lines", [["END"], [_line(1, 0 * MILLIMETRES), "END"]])
def test_a_log_without_a_tracked_frame_is_refused(tmp_path, lines):
    with pytest.raises(SkeletonLogError, match=f"no tracked performer in any of {len(lines) - 1} frames"):
        cad60.read(_write(tmp_path, *lines), ReadOptions())
