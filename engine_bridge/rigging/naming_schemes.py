"""Names of humanoid joints in other programs."""

from typing import Literal, get_args

from engine_bridge.puppet.humanoid_bones import HUMANOID_BONES, SIDES

Scheme = Literal["vrm", "mixamo", "unreal", "rigify", "godot"]
SCHEMES: tuple[Scheme, ...] = get_args(Scheme)

_MIDDLE: dict[Scheme, dict[str, str]] = {
    "mixamo": {
        "hips": "Hips",
        "spine": "Spine",
        "chest": "Spine1",
        "upperChest": "Spine2",
        "neck": "Neck",
        "head": "Head",
    },
    "unreal": {
        "hips": "pelvis",
        "spine": "spine_01",
        "chest": "spine_02",
        "upperChest": "spine_03",
        "neck": "neck_01",
        "head": "head",
    },
    "rigify": {
        "hips": "spine",
        "spine": "spine.001",
        "chest": "spine.002",
        "upperChest": "spine.003",
        "neck": "spine.004",
        "head": "spine.006",
    },
}

_SIDED: dict[Scheme, dict[str, str]] = {
    "mixamo": {
        "Shoulder": "Shoulder",
        "UpperArm": "Arm",
        "LowerArm": "ForeArm",
        "Hand": "Hand",
        "UpperLeg": "UpLeg",
        "LowerLeg": "Leg",
        "Foot": "Foot",
        "Toes": "ToeBase",
    },
    "unreal": {
        "Shoulder": "clavicle",
        "UpperArm": "upperarm",
        "LowerArm": "lowerarm",
        "Hand": "hand",
        "UpperLeg": "thigh",
        "LowerLeg": "calf",
        "Foot": "foot",
        "Toes": "ball",
    },
    "rigify": {
        "Shoulder": "shoulder",
        "UpperArm": "upper_arm",
        "LowerArm": "forearm",
        "Hand": "hand",
        "UpperLeg": "thigh",
        "LowerLeg": "shin",
        "Foot": "foot",
        "Toes": "toe",
    },
}
"""Names of the joints of a side, without the side."""

_WITH_SIDE: dict[Scheme, str] = {"mixamo": "{Side}{name}", "unreal": "{name}_{s}", "rigify": "{name}.{S}"}

_PREFIX: dict[Scheme, str] = {"mixamo": "mixamorig:"}


def _renamed(bone: str, scheme: Scheme) -> str:
    if scheme == "vrm":
        return bone
    if scheme == "godot":
        return bone[0].upper() + bone[1:]
    prefix = _PREFIX.get(scheme, "")
    side = next((side for side in SIDES if bone.startswith(side)), None)
    if side is None:
        return prefix + _MIDDLE[scheme].get(bone, bone)
    name = _SIDED[scheme].get(bone.removeprefix(side), bone)
    return prefix + _WITH_SIDE[scheme].format(name=name, Side=side.capitalize(), s=side[0], S=side[0].upper())


NAMES: dict[Scheme, dict[str, str]] = {
    scheme: {bone: _renamed(bone, scheme) for bone in HUMANOID_BONES} for scheme in SCHEMES
}
"""Name of each bone of a VRM humanoid in each scheme; all other joints keep their names."""
