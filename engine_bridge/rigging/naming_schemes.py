"""Names of humanoid joints in other programs."""

from typing import Literal, get_args

from capture.bone_names import MIDDLE_PARTS, SIDE_PARTS, TABLE, bone_name
from engine_bridge.puppet.humanoid_bones import HUMANOID_BONES, SIDES

Scheme = Literal["vrm", "mixamo", "unreal", "rigify", "godot"]
SCHEMES: tuple[Scheme, ...] = get_args(Scheme)


def _names(scheme: Scheme) -> dict[str, str]:
    convention = TABLE["conventions"][scheme]
    names = dict(zip(MIDDLE_PARTS, convention["middle"], strict=False))
    for side in SIDES:
        words = {"side": side, "Side": side.capitalize(), "s": side[0], "S": side[0].upper()}
        for part, name in zip(SIDE_PARTS, convention["sides"], strict=True):
            names[bone_name(side, part)] = convention["side"].format(name, **words)
    return {bone: convention["all"].format(names.get(bone, bone)) for bone in HUMANOID_BONES}


NAMES: dict[Scheme, dict[str, str]] = {scheme: _names(scheme) for scheme in SCHEMES}
"""Name of each bone of a VRM humanoid in each scheme; all other joints keep their names."""
