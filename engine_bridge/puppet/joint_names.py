"""Meanings of joint names in the skeletons of common programs."""

import re
from dataclasses import dataclass

SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}

WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
"""Word in the name of a joint, such as `LeftForeArm`, `upper_arm.L` or `J_Bip_R_LowerLeg`."""

DECORATION = {*"bcjm", "mixamorig", "def", "cc", "base", "bip", "valve", "biped", "bn", "jnt", "joint", "bone", "bend"}
"""Words that programs put before or after a joint's own name."""

CONTROLS = frozenset(
    ["ik", "fk", "pole", "target", "ctrl", "control", "mch", "org", "twist", "roll", "heel", "end", "nub", "helper"]
)
"""Words in the names of joints that control others; such a joint counts only if vertices follow it."""

PARTS = {
    "head": "head|skull",
    "neck": "neck",
    "spine": "spine|torso|abdomen|ab|chest|upperchest|waist|ribcage|back|hips?|pelvis|body|spinelower|spineupper",
    "girdle": "clavicle|collar|collarbone|shoulder|scapula",
    "upper arm": "upperarm|uparm|uarm|arm|shldr|humerus",
    "lower arm": "lowerarm|lowarm|farm|forearm|elbow|radius",
    "hand": "hand|wrist|palm[a-z]?",
    "thigh": "upperleg|upleg|thigh|femur",
    "shin": "lowerleg|lowleg|calf|shin|knee|tibia",
    "leg": "leg|midleg",
    "foot": "foot|ankle|footback|paw|hoof",
    "toe": "toes?|toebase|ball",
    "tail": "tail",
    "wing": "wing|feather",
    "ear": "ears?",
    "jaw": "jaw|mandible|chin|lowermouth|mouthlower|lowerjaw|jawlower",
}
"""Pattern of a joint's own name, without side, digits and decoration, for each part of the body."""

PATTERNS = {part: re.compile(f"(?:{names})") for part, names in PARTS.items()}

QUARTERS = {"f": "front", "front": "front", "fore": "front", "back": "hind", "hind": "hind", "rear": "hind"}
QUARTERS |= {"midfront": "middle front", "midback": "middle hind", "middle": "middle", "top": "top", "bottom": "bottom"}
"""First or last word in the names of a leg's joints, with its pairs of legs."""

CORNERS = {f"{pair[0]}{side}": (pair, side) for pair in ("front", "back", "hind", "rear") for side in "lr"}
"""Words that say the pair and the side of a leg, such as `fl`."""

LEG_PARTS = ("thigh", "leg", "shin", "foot", "toe")


@dataclass(frozen=True)
class JointMeaning:
    """Meaning of a joint's name.

    Attributes
    ----------
    side : str or None
        "left", "right" or None.
    quarter : str or None
        A value of `QUARTERS`, for a leg whose name says its pair.
    part : str
        One of `PARTS`.
    """

    side: str | None
    quarter: str | None
    part: str


def parse_joint_name(name: str, moves_vertices: bool) -> JointMeaning | None:
    """Return the meaning of a joint's name; None for an unknown name, or a control that moves no vertices."""
    words = [word.lower() for word in WORD.findall(name.rsplit(":", 1)[-1])]
    words = [one for word in words for one in CORNERS.get(word, (word,))]
    sides = [SIDES[word] for word in words if word in SIDES]
    words = [word for word in words if word not in SIDES and word not in DECORATION]
    if not sides and words and words[0][0] in "lr" and _part("".join(words)) is None:  # DAZ: lShin
        sides, words[0] = [SIDES[words[0][0]]], words[0][1:]
    if CONTROLS & set(words) and not moves_vertices:
        return None
    own = "".join(word for word in words if word not in CONTROLS or word in ("twist", "roll"))
    part, quarter = _part(own), None
    for word, which in QUARTERS.items():
        rest = own.removeprefix(word).removesuffix(word)
        if rest != own and sides and part is None and _part(rest) in (*LEG_PARTS, "girdle"):
            part, quarter = _part(rest), which
    return JointMeaning(sides[0] if sides else None, quarter, part) if part else None


def _part(name: str) -> str | None:
    return next((part for part, pattern in PATTERNS.items() if pattern.fullmatch(name)), None)
