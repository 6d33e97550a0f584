import math

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from capture.events import Lost
from capture.network.humanoid import JOINTS, SKELETON
from capture.skeleton import JOINT_INDEX

from ..bodies import table
from .conftest import known, message, message_of

BONES = ("Hips", *SKELETON)
UP_LEFT = (0.0, 0.0, -math.sqrt(0.5), math.sqrt(0.5))
AHEAD_RIGHT = (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5))
IDENTITY = (0.0, 0.0, 0.0, 1.0)


def _sent(address, name, place=(0.0, 0.0, 0.0), turn=IDENTITY):
    return message(address, "sfffffff", name, *map(float, (*place, *turn)))


def _bone(name, turn=IDENTITY, place=(0.3, -0.2, 0.1)):
    """Write a bone's rotation. Its position is the avatar's and must not matter, except for the hips."""
    return _sent("/VMC/Ext/Bone/Pos", name, (0.0, 1.0, 0.0) if name == "Hips" else place, turn)


def _root(place, turn=IDENTITY):
    return _sent("/VMC/Ext/Root/Pos", "root", place, turn)


def _pose(**turns):
    return [_bone(name, turns.get(name, IDENTITY)) for name in BONES]


def _status(*values):
    return message("/VMC/Ext/OK", "i" * len(values), *values)


EXPECTED = table("""
hip_center      0 1 0
spine           0 1.069 0
shoulder_center 0 1.408 0
head            0 1.61 0
shoulder_left   -0.185 1.332006579 0
elbow_left      -0.185 1.595006579 0
wrist_left      -0.185 1.842006579 0
hand_left       -0.185 1.926006579 0
shoulder_right  0.185 1.332006579 0
elbow_right     0.185 1.332006579 -0.263
wrist_right     0.185 1.332006579 -0.510
hand_right      0.185 1.332006579 -0.594
hip_left        -0.08 0.933547009 0
knee_left       -0.08 0.452547009 0
ankle_left      -0.08 0.074547009 0
foot_left       -0.08 0.018896313 -0.072
hip_right       0.08 0.933547009 0
knee_right      0.08 0.452547009 0
ankle_right     0.08 0.074547009 0
foot_right      0.08 0.018896313 -0.072
""")
"""By hand, from the lengths of a typical body."""


def test_a_raised_arm_and_an_arm_held_out_are_at_computed_positions_relative_to_the_root(listen):
    wire, pose = listen(scheme="vmc"), _pose(LeftUpperArm=UP_LEFT, RightUpperArm=AHEAD_RIGHT)
    for frame, place in ((wire.frame(*pose), 0), (wire.frame(_root((0.5, 0.0, 2.0)), *pose), [0.5, 0.0, -2.0])):
        assert (frame.user, frame.confidence.tolist()) == (0, [1.0] * 20)
        assert_allclose(frame.positions, np.array([*EXPECTED.values()]) + place, atol=1e-7)


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
            assert_allclose(frame.positions[JOINT_INDEX[joint]], expected, atol=1e-6)


DRIVEN = """
Hips          hip_center spine hip_left hip_right
Spine         shoulder_center shoulder_left shoulder_right
Head          head
LeftUpperArm  elbow_left
LeftLowerArm  wrist_left
LeftHand      hand_left
RightUpperArm elbow_right
RightLowerArm wrist_right
RightHand     hand_right
LeftUpperLeg  knee_left
LeftLowerLeg  ankle_left
LeftFoot      foot_left
RightUpperLeg knee_right
RightLowerLeg ankle_right
RightFoot     foot_right
"""
"""The joints that a bone moves; only bones that every humanoid has are needed."""


def test_joints_of_missing_bones_are_lost_and_received_bones_are_kept(listen):
    wire, known = listen(scheme="vmc"), np.zeros(20, bool)
    for bone, *joints in map(str.split, DRIVEN.strip().splitlines()):
        frame = wire.frame(_bone("Hips"), *[_bone(bone, UP_LEFT)] * (bone != "Hips"))
        known[[JOINT_INDEX[joint] for joint in joints]] = True
        assert_array_equal(frame.confidence, known)
        assert_array_equal(~np.isnan(frame.positions), np.tile(known, (3, 1)).T)
    again = wire.frame(_bone("Hips"), _bone("Head", UP_LEFT))
    assert_array_equal(again.positions, frame.positions)


def test_the_status_reports_bad_tracking_and_a_missing_performer(listen):
    wire = listen(scheme="vmc")
    for status, confidence in ((_status(1, 3, 0, 0), 0.5), (_status(1, 3, 0, 1), 1.0), (_status(1), 1.0)):
        assert set(wire.frame(status, *_pose()).confidence) == {confidence}
    [lost] = wire.events(_status(0))
    assert (type(lost), lost.user) == (Lost, 0)
    assert wire.settle(*_pose()) == []
    wire.frame(_status(1), _bone("Hips"))
    assert not wire.source.counts.refused


def test_more_arguments_and_other_addresses_are_ignored(listen):
    wire = listen(scheme="vmc")
    turn = 0.0, 0.0, 0.0, 1.0
    frame = wire.frame(
        message("/VMC/Ext/Root/Pos", "s" + "f" * 13, "root", 1.0, 0.0, 0.0, *turn, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0),
        message("/VMC/Ext/Bone/Pos", "s" + "f" * 7 + "is", "Hips", 0.0, 1.0, 0.0, *turn, 5, "new"),
        message("/VMC/Ext/T", "f", 1.0),
        *(message(f"/VMC/Ext/Blend/{what}", "sf", "Joy", 1.0) for what in ("Val", "Other")),
        message("/VMC/Ext/Set/Period", "iiiiii", *[1] * 6),
        message("/VMC/Thru/me", "s", "x"),
        _bone("LeftIndexDistal"),
    )
    assert known(frame)["hip_center"] == [1.0, 1.0, 0.0]
    assert frame.channels is None
    assert not wire.source.counts.refused


REFUSED = """
/VMC/Ext/Bone/Pos  sffffff   Hips 0 1 0 0 0 0
/VMC/Ext/Bone/Pos  ssffffff  Hips 0 1 0 0 0 0 1
/VMC/Ext/Bone/Pos  sfffffff  Hips 0 1 0 0 0 0 0
/VMC/Ext/Bone/Pos  sfffffff  Hips 0 1 0 3e38 3e38 3e38 3e38
/VMC/Ext/Root/Pos  s         root
/VMC/Ext/Blend/Val s         Joy
/VMC/Ext/OK
/VMC/Ext/OK        f         1
"""


def test_fewer_arguments_no_rotations_and_hips_out_of_range_are_refused(listen):
    wire, refused = listen(scheme="vmc"), [message_of(line) for line in REFUSED.strip().splitlines()]
    assert wire.refused(*refused) == {"wrong arguments": len(refused)}
    far = message_of("/VMC/Ext/Bone/Pos sfffffff Hips 3e38 0 0 0 0 0 1")
    assert wire.events(far, until=lambda _: len(wire.source.counts.refused) > 1) == []
    assert wire.source.counts.refused["position too far away"] == 1
