import math

import numpy as np
import pytest
from pythonosc.osc_message_builder import OscMessageBuilder
from scipy.spatial.transform import Rotation

from capture.body import typical_bone_length
from capture.events import Lost
from capture.network.humanoid import JOINTS, SKELETON
from capture.skeleton import JOINT_INDEX

BONES = ("Hips", *SKELETON)
UP_LEFT = (0.0, 0.0, -math.sqrt(0.5), math.sqrt(0.5))
AHEAD_RIGHT = (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5))
IDENTITY = (0.0, 0.0, 0.0, 1.0)


def _sent(address, name, place=(0.0, 0.0, 0.0), turn=IDENTITY):
    """Write a bone with another program's library."""
    builder = OscMessageBuilder(address)
    builder.add_arg(name, "s")
    for number in (*place, *turn):
        builder.add_arg(float(number), "f")
    return builder.build().dgram


def _bone(name, turn=IDENTITY, place=(0.3, -0.2, 0.1)):
    """Write a bone's rotation. Its position is the avatar's and must not matter, except for the hips."""
    return _sent("/VMC/Ext/Bone/Pos", name, (0.0, 1.0, 0.0) if name == "Hips" else place, turn)


def _root(place, turn=IDENTITY):
    return _sent("/VMC/Ext/Root/Pos", "root", place, turn)


def _pose(**turns):
    return [_bone(name, turns.get(name, IDENTITY)) for name in BONES]


def test_a_raised_arm_and_an_arm_held_out_are_at_computed_positions(listen):
    frame = listen(scheme="vmc").frame(*_pose(LeftUpperArm=UP_LEFT, RightUpperArm=AHEAD_RIGHT))
    assert frame.user == 0
    assert frame.confidence.tolist() == [1.0] * 20
    down = math.sqrt(0.20**2 - 0.185**2)
    shoulder = 1.0 + 0.069 + 0.339 - down
    expected = {
        "hip_center": (0, 1.0, 0),
        "spine": (0, 1.069, 0),
        "shoulder_center": (0, 1.408, 0),
        "head": (0, 1.61, 0),
        "shoulder_left": (-0.185, shoulder, 0),
        "elbow_left": (-0.185, shoulder + 0.263, 0),
        "wrist_left": (-0.185, shoulder + 0.510, 0),
        "hand_left": (-0.185, shoulder + 0.594, 0),
        "shoulder_right": (0.185, shoulder, 0),
        "elbow_right": (0.185, shoulder, -0.263),
        "wrist_right": (0.185, shoulder, -0.510),
        "hand_right": (0.185, shoulder, -0.594),
    }
    hips = 1.0 - math.sqrt(0.104**2 - 0.080**2)
    ahead, below = 0.072, math.sqrt(0.091**2 - 0.072**2)
    for side, x in (("left", -0.080), ("right", 0.080)):
        expected |= {
            f"hip_{side}": (x, hips, 0),
            f"knee_{side}": (x, hips - 0.481, 0),
            f"ankle_{side}": (x, hips - 0.859, 0),
            f"foot_{side}": (x, hips - 0.859 - below, -ahead),
        }
    np.testing.assert_allclose(frame.positions, [expected[name] for name in JOINT_INDEX], atol=1e-7)


def test_random_poses_agree_with_scipy(listen, rng):
    """In right-handed sensor coordinates, x and y of a quaternion change their signs."""
    wire = listen(scheme="vmc")
    flip, flip_turn = np.array([1, 1, -1]), np.array([-1, -1, 1, 1])
    for _ in range(10):
        turns = {bone: Rotation.random(rng=rng) for bone in ("Root", *BONES)}
        places = {bone: rng.normal(size=3).astype(np.float32) for bone in ("Root", "Hips")}
        frames = {"Root": (places["Root"] * flip, turns["Root"])}
        for bone in BONES:
            parent, begin = SKELETON.get(bone, ("Root", places["Hips"]))
            start, turn = frames[parent]
            frames[bone] = (start + turn.apply(np.array(begin) * flip), turn * turns[bone])
        unity = {bone: turn.as_quat() * flip_turn for bone, turn in turns.items()}
        frame = wire.frame(
            _root(places["Root"], unity["Root"]),
            _sent("/VMC/Ext/Bone/Pos", "Hips", places["Hips"], unity["Hips"]),
            *(_bone(bone, unity[bone]) for bone in SKELETON),
        )
        for joint, (bone, place) in JOINTS.items():
            start, turn = frames[bone]
            expected = start + turn.apply(np.array(place) * flip)
            np.testing.assert_allclose(frame.positions[JOINT_INDEX[joint]], expected, atol=1e-6)


def test_lengths_are_typical_and_the_hips_are_at_the_received_position(listen):
    wire = listen(scheme="vmc")
    one = wire.frame(*_pose())
    other = wire.frame(_root((0.5, 0.0, 2.0)), *_pose())
    np.testing.assert_allclose(other.positions, one.positions + np.array([0.5, 0.0, -2.0]), atol=1e-6)
    knee, hip = (one.positions[JOINT_INDEX[name]] for name in ("knee_left", "hip_left"))
    assert np.linalg.norm(knee - hip) == pytest.approx(typical_bone_length("knee"), abs=1e-6)


def test_joints_of_missing_bones_are_lost_and_received_bones_are_kept(listen):
    wire = listen(scheme="vmc")
    first = wire.frame(_bone("Hips"), _bone("Spine"), _bone("LeftUpperArm", UP_LEFT))
    known = {name for name, index in JOINT_INDEX.items() if first.confidence[index]}
    assert known == {
        *("hip_center", "spine", "shoulder_center", "hip_left", "hip_right"),
        *("shoulder_left", "shoulder_right", "elbow_left"),
    }
    assert np.isnan(first.positions[first.confidence == 0]).all()
    second = wire.frame(_bone("Hips"), _bone("Spine"), _bone("Head"))
    assert second.confidence[JOINT_INDEX["head"]] == 1.0
    elbow = JOINT_INDEX["elbow_left"]
    assert second.positions[elbow].tolist() == first.positions[elbow].tolist()


def test_the_status_reports_bad_tracking_and_a_missing_performer(listen, osc_message):
    wire = listen(scheme="vmc")
    assert set(wire.frame(osc_message("/VMC/Ext/OK", "iiii", 1, 3, 0, 0), *_pose()).confidence) == {0.5}
    assert set(wire.frame(osc_message("/VMC/Ext/OK", "iiii", 1, 3, 0, 1), *_pose()).confidence) == {1.0}
    assert set(wire.frame(osc_message("/VMC/Ext/OK", "i", 1), *_pose()).confidence) == {1.0}
    [lost] = wire.events(osc_message("/VMC/Ext/OK", "i", 0))
    assert (type(lost), lost.user) == (Lost, 0)
    assert wire.settle(*_pose()) == []
    wire.frame(osc_message("/VMC/Ext/OK", "i", 1), _bone("Hips"))
    assert not wire.source.counts.refused


def test_more_arguments_and_other_addresses_are_ignored(listen, osc_message):
    wire = listen(scheme="vmc")
    root = osc_message("/VMC/Ext/Root/Pos", "s" + "f" * 13, "root", 1, 0, 0, 0, 0, 0, 1, 1, 1, 1, 0, 0, 0)
    hips = osc_message("/VMC/Ext/Bone/Pos", "s" + "f" * 7 + "is", "Hips", 0, 1, 0, 0, 0, 0, 1, 5, "new")
    frame = wire.frame(
        root,
        hips,
        osc_message("/VMC/Ext/T", "f", 1.0),
        osc_message("/VMC/Ext/Blend/Val", "sf", "Joy", 1.0),
        osc_message("/VMC/Ext/Blend/Other", "sf", "Joy", 1.0),
        osc_message("/VMC/Ext/Set/Period", "iiiiii", 1, 1, 1, 1, 1, 1),
        osc_message("/VMC/Thru/me", "s", "x"),
        osc_message("/VMC/Ext/Bone/Pos", "sfffffff", "LeftIndexDistal", 0, 0, 0, 0, 0, 0, 1),
    )
    assert frame.positions[JOINT_INDEX["hip_center"]].tolist() == [1.0, 1.0, 0.0]
    assert frame.channels is None
    assert not wire.source.counts.refused


@pytest.mark.parametrize(
    ("address", "tags", "arguments"),
    [
        ("/VMC/Ext/Bone/Pos", "sffffff", ("Hips", 0, 1, 0, 0, 0, 0)),
        ("/VMC/Ext/Bone/Pos", "ssffffff", ("Hips", "0", 1, 0, 0, 0, 0, 1)),
        ("/VMC/Ext/Bone/Pos", "sfffffff", ("Hips", 0, 1, 0, 0, 0, 0, 0)),
        ("/VMC/Ext/Bone/Pos", "sfffffff", ("Hips", 0, 1, 0, 3e38, 3e38, 3e38, 3e38)),
        ("/VMC/Ext/Root/Pos", "s", ("root",)),
        ("/VMC/Ext/Blend/Val", "s", ("Joy",)),
        ("/VMC/Ext/OK", "", ()),
        ("/VMC/Ext/OK", "f", (1.0,)),
    ],
)
def test_fewer_arguments_and_no_rotations_are_refused(listen, osc_message, address, tags, arguments):
    wire = listen(scheme="vmc")
    assert wire.settle(osc_message(address, tags, *arguments)) == []
    assert wire.source.counts.refused == {"wrong arguments": 1}


def test_hips_out_of_range_are_refused(listen):
    wire = listen(scheme="vmc")
    wire.events(_sent("/VMC/Ext/Bone/Pos", "Hips", (3e38, 0, 0)), until=lambda _: wire.source.counts.refused)
    assert wire.source.counts.refused == {"position too far away": 1}
