"""A performer whose bones never change their lengths, and the joints of a written motion."""

import numpy as np
import pytest

from capture.clip import SkeletonClip
from capture.skeleton import to_character_axes
from capture.sources.demo import performances
from capture.timeline import resample
from engine_bridge.export.performer.motion import motion_of

from ...bones import in_world

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
    skeleton = motion.body.skeleton
    above = [skeleton.heads[joint.parent] for joint in skeleton.joints]
    offsets = [motion.hips, *(skeleton.heads - above)[1:]]  # of the hips and of what hangs on them
    found = in_world(skeleton, offsets, motion.rotations.swapaxes(0, 1))
    places = {name: place for name, (place, _) in found.items()}
    for name, tip in motion.body.tips.items():
        place, turn = found[name]
        places[f"{name}_end"] = place + turn.apply(tip - skeleton.heads[skeleton.names.index(name)])
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
