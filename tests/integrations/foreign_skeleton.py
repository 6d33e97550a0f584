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

TABLE = """
Hips     -        0    1    0
Spine    Hips     0    1.2  0.02
Head     Spine    0    1.7  0.05
Arm      Spine    0.2  1.45 0
ForeArm  Arm      0.4  1.2 -0.02
Hand     ForeArm  0.55 1    0.05
UpLeg    Hips     0.1  0.95 0
Leg      UpLeg    0.15 0.5  0.03
Foot     Leg      0.17 0.1  0
"""
ROWS = {name: (parent, np.array(place, float)) for name, parent, *place in map(str.split, TABLE.strip().splitlines())}
MIDDLE = ("Hips", "Spine", "Head")
FOREIGN = {name: (None if name == "Hips" else ROWS[name][0], ROWS[name][1]) for name in MIDDLE} | {
    f"{side}{name}": (parent if parent in MIDDLE else f"{side}{parent}", place * [sign, 1, 1])
    for side, sign in (("Left", 1), ("Right", -1))
    for name, (parent, place) in ROWS.items()
    if name not in MIDDLE
}
"""Parent and place of each bone of a skeleton in an A-pose, with Mixamo's names; its left is at +x, and it faces +z."""

PROGRAMS = """mixamorig:Hips mixamorig:Spine mixamorig:Head
mixamorig:LeftArm mixamorig:LeftForeArm mixamorig:LeftHand mixamorig:LeftUpLeg mixamorig:LeftLeg mixamorig:LeftFoot
mixamorig:RightArm mixamorig:RightForeArm mixamorig:RightHand mixamorig:RightUpLeg
mixamorig:RightLeg mixamorig:RightFoot

J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_Head
J_Bip_L_UpperArm J_Bip_L_LowerArm J_Bip_L_Hand J_Bip_L_UpperLeg J_Bip_L_LowerLeg J_Bip_L_Foot
J_Bip_R_UpperArm J_Bip_R_LowerArm J_Bip_R_Hand J_Bip_R_UpperLeg J_Bip_R_LowerLeg J_Bip_R_Foot

CC_Base_Hip CC_Base_Waist CC_Base_Head
CC_Base_L_Upperarm CC_Base_L_Forearm CC_Base_L_Hand CC_Base_L_Thigh CC_Base_L_Calf CC_Base_L_Foot
CC_Base_R_Upperarm CC_Base_R_Forearm CC_Base_R_Hand CC_Base_R_Thigh CC_Base_R_Calf CC_Base_R_Foot"""
MIXAMO, VROID, CHARACTER_CREATOR = map(str.split, PROGRAMS.split("\n\n"))
"""Names of these bones in three programs."""


def foreign(names=MIXAMO):
    """The bones with random axes: parents first, rotations and places relative to the parent."""
    rng, world, bones = np.random.default_rng(5), {}, []
    for own, (name, (parent, place)) in zip(names, FOREIGN.items(), strict=True):
        turn = Rotation.random(rng=rng)
        above, start = world[parent] if parent else (Rotation.identity(), np.zeros(3))
        local = above.inv() * turn
        bones.append(
            {
                "name": own,
                "parent": list(FOREIGN).index(parent) if parent else -1,
                "rotation": local.as_quat().tolist(),
                "position": above.inv().apply(place - start).tolist(),
            }
        )
        world[name] = turn, place
    return bones


def directions(frame):
    """The directions of the service's bones, to the next joint's head, along the character's left, up and front."""
    skeleton, found, basis = frame.character.skeleton, {}, frame.character.prepared.puppet.character.basis
    moves = frame.pose.bones
    places = {joint.name: joint.head @ moves[joint.bone, :3] + moves[joint.bone, 3] for joint in skeleton.joints}
    for joint, (after, bone) in CHAINS.items():
        if after in places:
            found[bone] = basis @ (places[after] - places[joint])
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
    moved = hips.head @ frame.pose.bones[0, :3] + frame.pose.bones[0, 3] + frame.pose.root - hips.head
    moved = frame.character.prepared.puppet.character.basis @ moved
    joints = {joint.name: joint.head for joint in frame.character.skeleton.joints}
    own = sum(np.linalg.norm(joints[a] - joints[b]) for a, b in pairwise(["leftUpperLeg", "leftLowerLeg", "leftFoot"]))
    places = [FOREIGN[f"Left{name}"][1] for name in ("UpLeg", "Leg", "Foot")]
    return np.array([0, 1.0, 0]) + sum(np.linalg.norm(a - b) for a, b in pairwise(places)) / own * moved
