"""A skeleton that another program made, and the directions in which a frame of the service points its limbs."""

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

CHAINS = {
    f"{side}{joint}": (following and f"{side}{following}", f"{side.title()}{bone}")
    for side in ("left", "right")
    for joint, following, bone in (
        *(("UpperArm", "LowerArm", "Arm"), ("LowerArm", "Hand", "ForeArm"), ("Hand", None, "Hand")),
        *(("UpperLeg", "LowerLeg", "UpLeg"), ("LowerLeg", "Foot", "Leg"), ("Foot", None, "Foot")),
    )
}
"""Next joint of each one that is compared, and its bone in the foreign skeleton."""

FOREIGN = {
    "Hips": (None, (0, 1.0, 0)),
    "Spine": ("Hips", (0, 1.2, 0.02)),
    "Head": ("Spine", (0, 1.7, 0.05)),
    **{
        f"{side}{bone}": (f"{side}{parent}" if parent[0] != "*" else parent[1:], (sign * x, y, z))
        for side, sign in (("Left", 1), ("Right", -1))
        for bone, parent, (x, y, z) in (
            ("Arm", "*Spine", (0.2, 1.45, 0.0)),
            ("ForeArm", "Arm", (0.4, 1.2, -0.02)),
            ("Hand", "ForeArm", (0.55, 1.0, 0.05)),
            ("UpLeg", "*Hips", (0.1, 0.95, 0.0)),
            ("Leg", "UpLeg", (0.15, 0.5, 0.03)),
            ("Foot", "Leg", (0.17, 0.1, 0.0)),
        )
    },
}
"""Parent and place of each bone of a skeleton in an A-pose, with Mixamo's names; its left is at +x, and it faces +z."""


def foreign(prefix="mixamorig_"):
    """The bones with random axes: parents first, rotations and places relative to the parent."""
    rng, world, bones = np.random.default_rng(5), {}, []
    for name, (parent, place) in FOREIGN.items():
        turn = Rotation.random(rng=rng)
        above, start = world[parent] if parent else (Rotation.identity(), np.zeros(3))
        local = above.inv() * turn
        bones.append(
            {
                "name": f"{prefix}{name}",
                "parent": list(FOREIGN).index(parent) if parent else -1,
                "rotation": local.as_quat().tolist(),
                "position": above.inv().apply(np.array(place) - start).tolist(),
            }
        )
        world[name] = turn, np.array(place, dtype=np.float64)
    return bones


def directions(frame):
    """The directions of the service's bones: head to the next joint's head, file coordinates."""
    skeleton, found = frame.character.skeleton, {}
    moves = frame.motions
    places = {joint.name: joint.head @ moves[joint.bone, :3] + moves[joint.bone, 3] for joint in skeleton.joints}
    for joint, (after, bone) in CHAINS.items():
        if after in places:
            found[bone] = places[after] - places[joint]
    return found


def worst_angle(places, frame):
    """The largest angle between limbs of the foreign skeleton and those of the service, in degrees."""
    worst = 0.0
    for before, after in pairwise(CHAINS.values()):
        if before[0] is not None:
            along, aim = places[after[1]] - places[before[1]], directions(frame)[before[1]]
            cosine = along @ aim / np.linalg.norm(along) / np.linalg.norm(aim)
            worst = max(worst, float(np.degrees(np.arccos(min(cosine, 1)))))
    return worst


def hips_place(frame):
    """Where the hips of the foreign skeleton are: they travel in proportion to the legs."""
    hips = frame.character.skeleton.joints[0]
    moved = hips.head @ frame.motions[0, :3] + frame.motions[0, 3] + frame.root - hips.head
    joints = {joint.name: joint.head for joint in frame.character.skeleton.joints}
    own = sum(np.linalg.norm(joints[a] - joints[b]) for a, b in pairwise(["leftUpperLeg", "leftLowerLeg", "leftFoot"]))
    places = [np.array(FOREIGN[f"Left{name}"][1]) for name in ("UpLeg", "Leg", "Foot")]
    return np.array([0, 1.0, 0]) + sum(np.linalg.norm(a - b) for a, b in pairwise(places)) / own * moved
