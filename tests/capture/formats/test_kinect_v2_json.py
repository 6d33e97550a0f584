import json
from pathlib import Path

import numpy as np
import pytest

from capture.formats import kinect_v2_json
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

from .conftest import assert_refused
from .conftest import changed as changed_document


def joint(x: float = 256, y: float = 212, z: float = 0) -> dict[str, object]:
    return {"x": x, "y": y, "z": z, "px": [{"x": 1, "y": 2, "z": 3}]}


def body(user: int = 7, slot: int = 0, **joints: dict[str, object]) -> dict[str, object]:
    """Return a body with all joints in the middle of the image at 2.25 m, except those given as j3=joint(…)."""
    return {
        "bodyIndex": slot,
        "trackingId": str(user),
        "leftHandState": 0,
        "rightHandState": 1,
        "joints": [joints.get(f"j{index}", joint()) for index in range(21)],
    }


def write(folder: Path, document: object) -> Path:
    path = folder / "take.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


def test_pixels_become_metres_before_the_sensor(tmp_path: Path) -> None:
    # 100 steps are 0.45 m, so z = 0 is 2.25 m; 183 pixels are half the focal length.
    joints = {"j3": joint(256, 29, 0), "j11": joint(439, 395, 100), "j20": joint(256, 212, -100)}
    (clip,) = kinect_v2_json.read(write(tmp_path, [[body(**joints)]]), ReadOptions())
    found = {
        name: clip.positions[0, JOINT_INDEX[name]] for name in ("hip_center", "head", "hand_right", "shoulder_center")
    }
    np.testing.assert_allclose(found["hip_center"], [0, 0, 2.25], atol=1e-12)
    np.testing.assert_allclose(found["head"], [0, 1.125, 2.25], atol=1e-12)
    np.testing.assert_allclose(found["hand_right"], [1.35, -1.35, 2.7], atol=1e-12)
    np.testing.assert_allclose(found["shoulder_center"], [0, 0, 1.8], atol=1e-12)


def test_joints_without_depth_or_on_the_wall_behind_are_lost(tmp_path: Path) -> None:
    frame = [body(j15=joint(z=-500), j7=joint(z=300), j11=joint(z=260))]
    (clip,) = kinect_v2_json.read(write(tmp_path, [frame]), ReadOptions())
    lost = {name for name, index in JOINT_INDEX.items() if clip.confidence[0, index] == 0}
    assert lost == {"foot_left", "hand_left"}  # 1.35 m behind the body; 1.17 m is within reach


def test_states_of_hands_become_channels_and_unknown_ones_are_nan(tmp_path: Path) -> None:
    states = [(2, 3), (4, 0), (1, 2)]
    frames = [[body() | {"leftHandState": left, "rightHandState": right}] for left, right in states]
    (clip,) = kinect_v2_json.read(write(tmp_path, frames), ReadOptions())
    assert clip.channels is not None
    found = [clip.channels[f"{name}_{side}"] for side in ("left", "right") for name in ("hand_open", "point")]
    nan = np.nan
    np.testing.assert_array_equal(found, [[1, 0.25, nan], [0, 1, nan], [0, nan, 1], [0, nan, 0]])
    frames[0].append(frames[1][0])  # the same performer again, which is skipped
    frames[0][0] |= {"leftHandState": 0, "rightHandState": 1}
    frames[0].append(body() | {"leftHandState": 2})  # the same performer again is skipped
    assert kinect_v2_json.read(write(tmp_path, frames[:1]), ReadOptions())[0].channels is None
    for key in ("leftHandState", "rightHandState"):
        del frames[0][0][key]
    assert kinect_v2_json.read(write(tmp_path, frames[:1]), ReadOptions())[0].channels is None


def test_each_tracking_id_is_a_clip(tmp_path: Path) -> None:
    document = [[body(5)], [], [body(5), body(9, 1)], [body(9, 1)]]
    one, two = kinect_v2_json.read(write(tmp_path, document), ReadOptions(fps=10))
    assert (one.user, two.user) == (5, 9)
    np.testing.assert_allclose(one.times, [0, 0.2])
    np.testing.assert_allclose(two.times, [0.2, 0.3])


def changed(*path: object, value: object) -> object:
    return changed_document([[body()], [body()]], *path, value=value)


@pytest.mark.parametrize(
    ("document", "place", "message"),
    [
        (changed(1, 0, "joints", 4, "z", value=None), "[1][0].joints[4]", "no 'z'"),
        (changed(1, 0, "joints", 4, "z", value="far"), "[1][0].joints[4].z", '"far"'),
        (changed(1, 0, "joints", 4, value=[1, 2, 3]), "[1][0].joints[4]", "a list of 3; expected an object"),
        (changed(1, 0, "joints", value=[joint()] * 20), "[1][0].joints", "20 joints"),
        (changed(1, 0, "joints", value={}), "[1][0].joints", "a list"),
        (changed(1, 0, "leftHandState", value="open"), "[1][0].leftHandState", '"open"'),
        (changed(1, 0, "trackingId", value=None), "[1][0]", "no 'trackingId'"),
        (changed(1, 0, "trackingId", value="x7"), "[1][0].trackingId", '"x7"'),
        (changed(1, value={"bodies": []}), "[1]", "an object of 1; expected a list"),
        ({"frames": []}, "the document's top level", "an object of 1"),
        (json.dumps([[body()]]).replace("212", "NaN", 1), "take.json", "the number NaN"),
        (json.dumps([[body()]]).replace("212", "1e999", 1), "[0][0].joints[0].y", "a number of ordinary size"),
        (json.dumps([[body()]])[:500], "take.json, line 1", "broken JSON at column"),
        ("[" * 100_000, "take.json", "cannot be parsed"),
        ("", "take.json, line 1", "broken JSON"),
        ([[], []], "take.json", "no frame with a tracked performer"),
        ([[body(**{f"j{index}": joint(z=-500) for index in range(21)})]], "take.json", "no frame with a tracked"),
    ],
)
def test_violations_of_the_format_are_refused_with_their_place(
    tmp_path: Path, document: object, place: str, message: str
) -> None:
    assert_refused(kinect_v2_json, write(tmp_path, document), place, message)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "take.json"
    path.write_bytes(b'[[{"bodyIndex": \xff}]]')
    with pytest.raises(SkeletonLogError, match="UTF-8"):
        kinect_v2_json.read(path, ReadOptions())


def test_the_first_frame_of_a_real_file_equals_values_by_hand(real_logs: Path) -> None:
    (clip,) = kinect_v2_json.read(real_logs / "kinect_v2_json" / "1-person_raise-right-arm.json", ReadOptions())
    # joint 0 is x 255, y 215, z −23; joint 11 is x 278, y 40, z −21
    np.testing.assert_allclose(clip.positions[0, 0], [-1 * 2.1465 / 366, -3 * 2.1465 / 366, 2.1465])
    np.testing.assert_allclose(clip.positions[0, 11], [22 * 2.1555 / 366, 172 * 2.1555 / 366, 2.1555])
    assert clip.user == 72057594037930007
    assert len(clip.times) == 96
    assert clip.channels is not None  # the file has 58 states "open" and 8 "lasso" of the right hand, none of the left
    assert {name: np.nansum(each) for name, each in clip.channels.items()} == {"hand_open_right": 60, "point_right": 8}
    assert clip.positions[0, 11, 1] > clip.positions[0, JOINT_INDEX["head"], 1]  # the raised arm is the right one


def test_real_counts(real_logs: Path) -> None:
    one, two = kinect_v2_json.read(
        real_logs / "kinect_v2_json" / "1-person_raise-both-arms-separately.json", ReadOptions()
    )
    assert (len(one.times), len(two.times)) == (231, 7)
    # All of the 151 joints at −500 are the performer's: none of the 21st, which is the shoulder centre, is among them.
    assert np.count_nonzero(one.confidence == 0) == 151
    assert two.times[0] == 224 / 30


def test_recognises_a_list_of_frames_and_no_other_document() -> None:
    assert kinect_v2_json.matches(b"\xef\xbb\xbf " + json.dumps([[], [body()]]).encode())
    assert not kinect_v2_json.matches(b'{"bodyIndex": 0, "joints": []}')
