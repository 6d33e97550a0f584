import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.formats import kinect_v2_json
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX

from .conftest import TOP_LEVEL, changed, place_of


def joint(x=256, y=212, z=0):
    return {"x": x, "y": y, "z": z, "px": [{"x": 1, "y": 2, "z": 3}]}


def body(user=7, hands=(0, 1), **joints):
    """Return a body with all joints in the middle of the image at 2.25 m, except those given as j3=joint(…)."""
    return {
        "bodyIndex": 0,
        "trackingId": str(user),
        "leftHandState": hands[0],
        "rightHandState": hands[1],
        "joints": [joints.get(f"j{index}", joint()) for index in range(21)],
    }


@pytest.fixture
def clips(read):
    return lambda frames, **options: read(kinect_v2_json, json.dumps(frames), **options)


def test_pixels_become_metres_before_the_sensor(clips):
    # 100 steps are 0.45 m, so z = 0 is 2.25 m; 183 pixels are half the focal length.
    (clip,) = clips([[body(j3=joint(256, 29, 0), j11=joint(439, 395, 100), j20=joint(256, 212, -100))]])
    for name, place in {
        "hip_center": [0, 0, 2.25],
        "head": [0, 1.125, 2.25],
        "hand_right": [1.35, -1.35, 2.7],
        "shoulder_center": [0, 0, 1.8],
    }.items():
        assert_allclose(clip.positions[0, JOINT_INDEX[name]], place, atol=1e-12)


def test_joints_without_depth_or_on_the_wall_behind_are_lost(clips):
    (clip,) = clips([[body(j15=joint(z=-500), j7=joint(z=300), j11=joint(z=260))]])
    lost = {name for name, index in JOINT_INDEX.items() if clip.confidence[0, index] == 0}
    assert lost == {"foot_left", "hand_left"}  # 1.35 m behind the body; 1.17 m is within reach


def test_states_of_hands_become_channels_and_unknown_ones_are_nan(clips):
    (clip,) = clips([[body(hands=hands)] for hands in ((2, 3), (4, 0), (1, 2))])
    found = [clip.channels[f"{name}_{side}"] for side in ("left", "right") for name in ("hand_open", "point")]
    nan = np.nan
    assert_array_equal(found, [[1, 0.25, nan], [0, 1, nan], [0, nan, 1], [0, nan, 0]])
    handless = body()
    del handless["leftHandState"], handless["rightHandState"]
    again = [body(), body(hands=(2, 0))]  # the same performer again is skipped
    assert [clips([bodies])[0].channels for bodies in (again, [handless])] == [None, None]


def test_each_tracking_id_is_a_clip(clips):
    one, two = clips([[body(5)], [], [body(5), body(9)], [body(9)]], fps=10)
    assert (one.user, two.user) == (5, 9)
    assert_allclose(one.times, [0, 0.2])
    assert_allclose(two.times, [0.2, 0.3])


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ((1, 0, "joints", 4, "z"), None),
        ((1, 0, "joints", 4, "z"), "far"),
        ((1, 0, "joints", 4), [1, 2, 3]),
        ((1, 0, "joints"), [joint()] * 20),
        ((1, 0, "joints"), {}),
        ((1, 0, "leftHandState"), "open"),
        ((1, 0, "trackingId"), None),
        ((1, 0, "trackingId"), "x7"),
        ((1,), {"bodies": []}),
    ],
)
def test_violations_of_the_format_are_refused_with_their_place(refused_at, path, value):
    document = changed([[body()], [body()]], path, value)
    assert refused_at(kinect_v2_json, json.dumps(document)) == place_of(path, value)


GOOD = json.dumps([[body()]])


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ('{"frames": []}', TOP_LEVEL),
        (GOOD.replace("212", "NaN", 1), "[0][0].joints[0].y"),
        (GOOD.replace("212", "1e999", 1), "[0][0].joints[0].y"),
        (GOOD[:500], "line 1"),
        ("[" * 100_000, ""),
        ("", "line 1"),
        ("[[], []]", ""),
        (json.dumps([[body(**{f"j{index}": joint(z=-500) for index in range(21)})]]), ""),
        (b'[[{"bodyIndex": \xff}]]', ""),
    ],
)
def test_texts_that_are_no_such_document_are_refused(refused_at, text, place):
    assert refused_at(kinect_v2_json, text) == place


def test_the_first_frame_of_a_real_file_equals_values_by_hand(real_logs):
    (clip,) = kinect_v2_json.read(real_logs / "kinect_v2_json" / "1-person_raise-right-arm.json", ReadOptions())
    # joint 0 is x 255, y 215, z −23; joint 11 is x 278, y 40, z −21
    assert_allclose(clip.positions[0, 0], [-1 * 2.1465 / 366, -3 * 2.1465 / 366, 2.1465])
    assert_allclose(clip.positions[0, 11], [22 * 2.1555 / 366, 172 * 2.1555 / 366, 2.1555])
    assert (clip.user, len(clip.times)) == (72057594037930007, 96)
    # the file has 58 states "open" and 8 "lasso" of the right hand, none of the left
    assert {name: np.nansum(each) for name, each in clip.channels.items()} == {"hand_open_right": 60, "point_right": 8}


def test_recognises_a_list_of_frames_and_no_other_document():
    assert kinect_v2_json.matches(b"\xef\xbb\xbf " + GOOD.encode())
    assert not kinect_v2_json.matches(b'{"bodyIndex": 0, "joints": []}')
    assert not kinect_v2_json.matches(b'[{"joints": []}]')
