"""A performer whose bones never change their lengths, and the joints of a written motion."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.skeleton import to_character_axes
from capture.sources.demo import performances
from capture.timeline import resample
from engine_bridge.export.performer.motion import motion_of

OF_JOINTS = {
    "hip_center": "hips",
    "spine": "spine",
    "shoulder_center": "neck",
    **{
        f"{joint}_{side}": f"{side}{bone}"
        for side in ("left", "right")
        for joint, bone in (
            *(("shoulder", "UpperArm"), ("elbow", "LowerArm"), ("wrist", "Hand")),
            *(("hip", "UpperLeg"), ("knee", "LowerLeg"), ("ankle", "Foot")),
        )
    },
}
"""VRM's bone at each joint of the Kinect."""


def joints_of(motion):
    """Return the positions (F, 3) of joints and tips by forward kinematics."""
    skeleton, places, turns = motion.body.skeleton, {}, {}
    for row, joint in enumerate(skeleton.joints):
        own = Rotation.from_quat(motion.rotations[:, row])
        if joint.parent < 0:
            places[joint.name], turns[joint.name] = motion.hips, own
            continue
        above = skeleton.joints[joint.parent]
        places[joint.name] = places[above.name] + turns[above.name].apply(joint.head - above.head)
        turns[joint.name] = turns[above.name] * own
    for name, tip in motion.body.tips.items():
        head = skeleton.heads[skeleton.names.index(name)]
        places[f"{name}_end"] = places[name] + turns[name].apply(tip - head)
    return places


def timeline_of(poses):
    """Return the timeline of a performer with these joints (T, 20, 3) in character axes, NaN for unknown ones."""
    known = np.isfinite(poses[..., 0]).astype(np.float32)
    return resample(SkeletonClip("test", 0, np.arange(len(poses)) / 30, to_character_axes(poses), known))


@pytest.fixture(scope="session")
def kung_fu():
    """A timeline of kung fu, and its motion."""
    timeline = resample(performances()["kung_fu"](), 30)
    return timeline, motion_of(timeline, timeline.positions[0, 0])


@pytest.fixture(scope="session")
def motion(kung_fu):
    """The motion of kung fu."""
    return kung_fu[1]


@pytest.fixture(scope="session")
def places(motion):
    """The positions of its joints."""
    return joints_of(motion)
