"""Names and hierarchy of the bones of a humanoid, as in VRM 1.0 (VRMC_vrm, humanoid).

VRM, VMC and Unity have the same bones; VMC and Unity write their names with a capital first letter.
"""

from collections.abc import Container

SIDES = ("left", "right")

_LIMB_PARENTS = {
    "Shoulder": "upperChest",
    "UpperArm": "{}Shoulder",
    "LowerArm": "{}UpperArm",
    "Hand": "{}LowerArm",
    "UpperLeg": "hips",
    "LowerLeg": "{}UpperLeg",
    "Foot": "{}LowerLeg",
    "Toes": "{}Foot",
}

PARENTS: dict[str, str] = {
    "spine": "hips",
    "chest": "spine",
    "upperChest": "chest",
    "neck": "upperChest",
    "head": "neck",
    "jaw": "head",
    **{f"{side}{bone}": parent.format(side) for side in SIDES for bone, parent in _LIMB_PARENTS.items()},
}
"""Parent of each bone but the hips, parents first. Bones that VRM does not require may be missing."""

HUMANOID_BONES = ("hips", *PARENTS)
"""All bones, parents first."""

REQUIRED = (
    "hips",
    "spine",
    "head",
    *(f"{side}{bone}" for side in SIDES for bone in ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot")),
)
"""Bones that every VRM humanoid has."""


def parent_of(bone: str, present: Container[str]) -> str | None:
    """Return the nearest ancestor of a bone that a humanoid has; None for the hips."""
    parent = PARENTS.get(bone)
    while parent is not None and parent not in present:
        parent = PARENTS.get(parent)
    return parent
