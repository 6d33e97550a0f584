"""A character on four legs takes over the motion of an animal joint by joint."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.skeleton import JOINT_INDEX, JOINTS
from capture.timeline import Timeline
from engine_bridge.performance.animals import of_animal
from engine_bridge.performance.clip import poses
from engine_bridge.performance.grounding import legs_of
from engine_bridge.performance.retargeting import PERFORMER
from engine_bridge.performance.settings import Settings
from puppetline.errors import SkeletonLogError
from solver.motion.limb_motion import LimbMotion
from solver.motion.limbs import bones_of

from .test_grounding import LEGS, puppet, steps

TAIL = {
    "name": "tail",
    "points": [[0, 0.6, -0.5], [0, 0.8, -0.7]],
    "joints": ["hip_center", "shoulder_center"],
    "follow": "turn",
    "gain": -0.7,
}

STRIDE = """
hip_center       0   1    0
spine            0   1.05 0.4
shoulder_center  0   1    0.8
head             0   1.2  1.2
hip_left         0.2 1    0
knee_left        0.2 0.5 -0.1
ankle_left       0.2 0.1 -0.3
foot_left        0.2 0   -0.1
shoulder_left    0.2 1    0.8
elbow_left       0.2 0.5  1.3
wrist_left       0.2 0.1  1.1
hand_left        0.2 0    1.3
hip_right       -0.2 1    0
knee_right      -0.2 0.5  0.4
ankle_right     -0.2 0.1  0.2
foot_right      -0.2 0    0.4
shoulder_right  -0.2 1    0.8
elbow_right     -0.2 0.5  0.8
wrist_right     -0.2 0.1  0.6
hand_right      -0.2 0    0.8
"""
PLACES = {joint: place for joint, *place in map(str.split, STRIDE.strip().splitlines())}
ANIMAL = np.array([PLACES[joint] for joint in JOINTS], dtype=np.float64)
"""Joints (20, 3) of an animal that looks to +z, in a stride: its left is at +x."""


def test_legs_and_trunk_point_as_the_animals_do_and_a_tail_rests_on_the_trunk():
    made, pose = of_animal(puppet([*LEGS, TAIL])), ANIMAL
    bones = bones_of(made.limbs)
    moves = np.asarray(LimbMotion(made.limbs, PERFORMER, pose).step(0.0, pose, np.ones(20, np.float32)))
    ways = np.einsum("bi,bij->bj", bones.tails - bones.heads, moves[:, :3])
    joints = [(limb.name, head[0], tail[0]) for limb in made.limbs for head, tail in pairwise(limb.joints)]
    for way, (name, head, tail) in zip(ways, joints, strict=True):
        if name != "tail" and not JOINTS[tail].startswith(("foot", "hand")):  # feet are level
            own = pose[tail] - pose[head]
            assert_allclose(way / np.linalg.norm(way), own / np.linalg.norm(own), atol=1e-6, err_msg=name)
    assert [limb.gain for limb in made.limbs if limb.name == "tail"] == [0]


def test_four_feet_are_held_and_no_leg_steps(standing):
    made = of_animal(puppet())
    joints = [f"{joint}_{side}" for joint in ("ankle", "wrist") for side in ("left", "right")]
    legs = [(JOINT_INDEX[joint], bone, bone + 1, bone + 2) for joint, bone in zip(joints, (2, 5, 8, 11), strict=True)]
    assert [(leg.joint, leg.thigh, leg.shin, leg.foot) for leg in legs_of(made)] == legs
    assert steps(made, standing) is None
    assert steps(puppet(), standing) is not None


def test_only_characters_on_four_legs_follow_an_animal(limbed_figure):
    with pytest.raises(SkeletonLogError, match="four-legged skeleton, for a character on 2 legs that step"):
        of_animal(puppet(LEGS[:2]))
    timeline = Timeline(30.0, np.tile(ANIMAL, (3, 1, 1)), np.ones((3, 20), np.float32), ())
    assert len([*poses(limbed_figure, timeline, Settings())]) == 3
    with pytest.raises(SkeletonLogError, match="a character on no legs that step"):
        next(poses(limbed_figure, replace(timeline, legs=4), Settings()))
