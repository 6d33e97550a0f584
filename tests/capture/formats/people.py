"""A person's positions under the names of several skeletons, and what readers must make of them."""

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from capture.skeleton import JOINT_INDEX, PARENTS

from ..bodies import body, both, table

_NAMES = """
SpineBase SpineMid Neck Head ShoulderLeft ElbowLeft WristLeft HandLeft ShoulderRight ElbowRight WristRight HandRight
HipLeft KneeLeft AnkleLeft FootLeft HipRight KneeRight AnkleRight FootRight SpineShoulder HandTipLeft ThumbLeft
HandTipRight ThumbRight

nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer left_ear right_ear mouth_left
mouth_right left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist left_pinky right_pinky left_index
right_index left_thumb right_thumb left_hip right_hip left_knee right_knee left_ankle right_ankle left_heel right_heel
left_foot_index right_foot_index

Hip RHip RKnee RFoot LHip LKnee LFoot Spine Thorax Nose Head LShoulder LElbow LWrist RShoulder RElbow RWrist
"""
KINECT_V2, BLAZEPOSE, HUMAN36M = map(str.split, _NAMES.strip().split("\n\n"))
"""Names of joints in the order and the spelling of other skeletons."""


LIMBS = both("shoulder", "elbow", "wrist", "hip", "knee", "ankle")

WAYS = table("""
spine           0 1 0
shoulder_center 0 1 0
head            0 1 0
shoulder        1 0 0
elbow           0.2 -1 0.3
wrist           0.1 -1 -0.3
hand            0 -1 -0.2
hip             1 0 0
knee            0 -1 -0.1
ankle           0 -1 0.1
foot            0 -0.3 -1
""")


def person(frames=4):
    """Return (T, 20, 3) positions of a person 2.5 m in front of a sensor who raises the right arm."""
    poses = np.tile(body(WAYS, (0.1, 0.2, 2.5), typical=True), (frames, 1, 1))
    arm = [JOINT_INDEX[f"{part}_right"] for part in ("shoulder", "elbow", "wrist", "hand")]
    hanging = poses[:, arm[1]] - poses[:, arm[0]]
    size = np.linalg.norm(hanging[0])
    raised = hanging + np.outer(np.linspace(0, 1.5 * size, frames), [0, 1, 0])
    raised *= size / np.linalg.norm(raised, axis=1, keepdims=True)
    poses[:, arm[1:]] += (raised - hanging)[:, None]
    return poses


PERSON = person()
MATRICES = np.tile(np.eye(4), (*PERSON.shape[:2], 1, 1))
MATRICES[..., :3, 3] = PERSON
"""Matrices (T, 20, 4, 4) whose origins are the joints; some programs write them by columns."""


def moving(frames=40):
    """Return positions (T, 20, 3) of a person each of whose limbs' bones swings in a rhythm of its own."""
    points, turns = np.tile(PERSON[:1], (frames, 1, 1)), {}
    for index, (joint, parent) in enumerate(PARENTS.items()):
        bends = joint.split("_")[0] in ("elbow", "wrist", "hand", "knee", "ankle", "head")
        swing = np.sin(np.arange(frames) * (0.3 + 0.05 * index)) * 0.5 * bends
        swing += {"wrist": 0.6, "ankle": -0.6}.get(joint.split("_")[0], 0)  # elbows bend forwards, knees backwards
        turns[joint] = Rotation.from_rotvec(np.outer(swing, [1, 0, 0])) * turns.get(parent, Rotation.identity())
        way = PERSON[0, JOINT_INDEX[joint]] - PERSON[0, JOINT_INDEX[parent]]
        points[:, JOINT_INDEX[joint]] = points[:, JOINT_INDEX[parent]] + turns[joint].apply(way)
    return points


def joints_as(names):
    """Return the person's positions under the names of another skeleton; others are near the joint that they follow."""
    at = {joint.replace("_", ""): PERSON[:, index] for joint, index in JOINT_INDEX.items()}
    same = {"hip": "hipcenter", "spinebase": "hipcenter", "thorax": "shouldercenter", "spineshoulder": "shouldercenter"}
    same |= {"spinemid": "spine", "neck": "shouldercenter", "pelvis": "hipcenter"}
    for side in "left", "right":
        own = {"footindex": "foot", "heel": "ankle", **dict.fromkeys(("index", "pinky", "thumb", "handtip"), "hand")}
        same |= {f"{part}{side}": f"{joint}{side}" for part, joint in own.items()} | {f"ear{side}": "head"}
    columns = []
    for name in names:
        key = name.lower().replace("_", "")
        for side, start in (("left", "l"), ("right", "r")):
            if key.startswith(side):
                key = key.removeprefix(side) + side
            elif names is HUMAN36M and key.startswith(start):
                key = key.removeprefix(start).replace("foot", "ankle") + side
        columns.append(at.get(same.get(key, key), at["head"] - [0, 0, 0.1]))
    return np.stack(columns, axis=1)


POINTS = joints_as(BLAZEPOSE)


def assert_reads(clip, poses=PERSON, joints=slice(None), atol=1e-9, step=None):
    """A clip has the positions of poses, in all or some joints, and its times the step if one is given."""
    assert_allclose(clip.positions[:, joints], poses[:, joints], atol=atol)
    if step is not None:
        assert_allclose(clip.times - clip.times[0], step * np.arange(len(poses)), atol=1e-6)
