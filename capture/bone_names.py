"""Meanings of the names of joints in the skeletons of common programs.

`bone_names.toml` has the names. A skeleton has the convention that explains most of its joints, if it has most of the
convention's names. The names of all other joints are read word by word. Case, separators, a namespace, and words that
(nearly) all joints share do not matter: ``mixamorig:LeftUpLeg``, ``UpLeg_L`` and ``smpl_up_leg.l`` are equal.
"""

import re
import tomllib
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from capture.channels import FINGERS

TABLE: dict[str, Any] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))

MIDDLE_PARTS = ("hips", "spine", "chest", "upperChest", "neck", "head", "jaw")
SIDE_PARTS = ("shoulder", "upperArm", "lowerArm", "hand", "upperLeg", "lowerLeg", "foot", "toes")
"""VRM's bones in the middle and of a side, without the side, in the order of the conventions."""

LEG_PARTS = ("upperLeg", "leg", "lowerLeg", "foot", "toes")

SIDES = {word: side for side, words in TABLE["sides"].items() for word in words.split()}

QUARTERS = {word: quarter for quarter, words in TABLE["quarters"].items() for word in words.split()}
"""Pairs of legs by the words for them in the names of a leg's joints."""

SHARED_WORD_SHARE = 0.5
"""Minimum share of a skeleton's joints that have a word which says nothing."""

ALL_SHARE = 0.9
"""The same for a word that is the name of a joint of the trunk otherwise, as in ``Body_Hips``; all joints of a spider
may be of its legs."""

MAX_LOOSE_SHARE = 0.5
"""Maximum share of known names, among those of joints that move vertices, with which single words of others count."""

MIN_SHARING_JOINTS = 5
"""Minimum number of joints from which words are shared."""

MAX_NAME_LENGTH = 120
"""Number of characters of a joint's name that are read."""

MIN_CONVENTION_SHARE = 0.75
"""Minimum share of a convention's names that a skeleton has."""

_PLACES = ("front", "back")
"""Words in the names of parts of a character that say where they are: ``eye_left_front``."""

_CORNERS = {f"{pair[0]}{side}": (pair, side) for pair in ("front", "back", "hind", "rear") for side in "lr"}
"""Words that say the pair and the side of a leg, such as `fl`."""

_WORD = re.compile("[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^ -~]+")
_WORDS = {word: part for part, words in TABLE["words"].items() for word in words.split()}
_WING = re.compile(r"wings?.*|(upper|lower|front|fore|mid|middle|hind|rear|back)wings?")
_FINS, _ORNAMENTS = (frozenset(TABLE["anywhere"][kind].split()) for kind in ("wing", "ornament"))
_POINTS = {word: point for point, words in TABLE["points"].items() for word in words.split()}
_INNER_ENDS = {word for word, point in _POINTS.items() if point in ("wrist", "ankle")}
"""Words for where a hand or foot begins, which may follow it: ``HandWrist``."""

_INITIALS, _MIDDLE_INITIALS = (
    dict(zip(words[::2], words[1::2], strict=True))
    for words in (TABLE["initials"][kind].split() for kind in ("sided", "middle"))
)
_ONE_LETTER_JOINTS = {"n", "h"}
"""Letters that are joints wherever they stand; a column ``p`` is rather a probability."""

_SIDED_INITIALS = {f"{side}{initial}" for side in "lr" for initial in _INITIALS}

_KNOWN = _WORDS.keys() | _POINTS.keys()
_TRUNK_PARTS = (*MIDDLE_PARTS, "root", "trunk")
_DECORATION, _CONTROLS = (frozenset(TABLE["other"][kind].split()) for kind in ("decoration", "controls"))
_GLUED_SIDES = (re.compile("(?P<side>left|right|l|r)(?P<own>.+)"), re.compile("(?P<own>.+?)(?P<side>left|right|l|r)"))
_FINGERS = {word: finger for finger, words in TABLE["fingers"].items() for word in words.split()}
_PHALANGES = ("metacarpal", "proximal", "intermediate", "distal")
_FINGER = re.compile(f"(?:hand|finger|f)?({'|'.join(_FINGERS)})(?:finger)?(?:[.]?([0-9]*)|({'|'.join(_PHALANGES)}))")
_THUMB_BONES, _FINGER_BONES = ("Metacarpal", "Proximal", "Distal"), ("Proximal", "Intermediate", "Distal")

FINGER_BONES = {
    (side, finger, number): f"{side}{finger.title()}{bone}"
    for side in ("left", "right")
    for finger in FINGERS
    for number, bone in enumerate(_THUMB_BONES if finger == "thumb" else _FINGER_BONES, 1)
}
"""VRM's bones of fingers by side, finger, and number of the joint from the palm."""

Key = tuple[str | None, str]
"""Side of a joint, and its other words, joined; a point is before each number."""


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
        One of `MIDDLE_PARTS`, `SIDE_PARTS`, `capture.channels.FINGERS`, or another key of the table's words.
    order : int or None
        Increasing number of the joint of a finger from the palm.
    """

    side: str | None
    quarter: str | None
    part: str
    order: int | None = None


def bone_name(side: str | None, part: str) -> str:
    """Return VRM's name of a part: ``leftUpperArm``."""
    return f"{side}{part[0].upper()}{part[1:]}" if side else part


def joint_meanings(names: Sequence[str], moves_vertices: Sequence[bool] = ()) -> list[JointMeaning | None]:
    """Return the meanings of the names of a skeleton's joints.

    Parameters
    ----------
    names : sequence of str
    moves_vertices : sequence of bool
        Whether vertices follow each joint; by default, they do not.

    Returns
    -------
    list of JointMeaning or None
        None for an unknown name, or a control that moves no vertices. If most names of joints that move vertices are
        unknown, a single word counts: ``arm_joint_L_1``.
    """
    split = _split(names)
    sided = [_without_side([word for word in words if word not in _DECORATION]) for words in split]
    convention = _convention([(side, "".join(words)) for side, words in sided])
    moves = moves_vertices or [False] * len(names)
    found = [_meaning(side, words, convention, moving) for (side, words), moving in zip(sided, moves, strict=True)]
    known = sum(moving for meaning, moving in zip(found, moves, strict=True) if meaning)
    if known > MAX_LOOSE_SHARE * sum(moves):
        return found
    return [
        meaning or (_loose_meaning(side, words) if moving else None)
        for meaning, (side, words), moving in zip(found, sided, moves, strict=True)
    ]


def joint_sides(names: Sequence[str]) -> list[str | None]:
    """Return the sides that the names of a skeleton's joints say, whether or not they say a part: ``Bone.007.R``."""
    return [_without_side(words)[0] for words in _without_shared_words([_words(name) for name in names])]


def ornaments(names: Sequence[str]) -> list[bool]:
    """Return which joints' names say that they move hair, clothes or weapons, and nothing of a body."""
    return [
        meaning is None and not _ORNAMENTS.isdisjoint(_words(name))
        for name, meaning in zip(names, joint_meanings(names, [True] * len(names)), strict=True)
    ]


def is_control(name: str) -> bool:
    """Return whether a joint's name says that it controls others, such as a pole of inverse kinematics."""
    return not {"ik", "pole", "target", "ctrl", "control"}.isdisjoint(_words(name))


def find_bones(names: Sequence[str]) -> dict[str, int]:
    """Return which joint of a skeleton is which bone of a VRM humanoid.

    The upper arm is the last joint with the name of a shoulder, if there is no other.

    Parameters
    ----------
    names : sequence of str
        Parents before their children.

    Returns
    -------
    dict
        Indices of names by VRM's names of bones, also of fingers, and ``leftPalm`` and ``rightPalm`` for a joint
        between wrist and fingers.
    """
    joints: dict[Key, list[int]] = {}
    fingers: dict[Key, list[tuple[int, int]]] = {}
    for index, meaning in enumerate(joint_meanings(names)):
        if meaning and meaning.order is not None:
            fingers.setdefault((meaning.side, meaning.part), []).append((meaning.order, index))
        elif meaning and not meaning.quarter:
            joints.setdefault((meaning.side, meaning.part), []).append(index)
    found: dict[str, int] = {}
    for side, parts in ((None, MIDDLE_PARTS), *((side, (*SIDE_PARTS, "palm", "eye")) for side in ("left", "right"))):
        if (side, "lowerArm") in joints and (side, "upperArm") not in joints and joints.get((side, "shoulder")):
            joints[side, "upperArm"] = [joints[side, "shoulder"].pop()]
        own = {part: joints[side, part].pop(0) for part in parts if joints.get((side, part))}
        for part in parts:
            others = [
                joints[side, other] for other in TABLE["substitutes"].get(part, "").split() if joints.get((side, other))
            ]
            if part not in own and others:
                own[part] = others[0].pop(0)
        found |= {bone_name(side, part): index for part, index in own.items()}
    for (side, finger), chain in fingers.items():
        found |= {FINGER_BONES[side or "", finger, k]: index for k, (_, index) in enumerate(sorted(chain)[:3], 1)}
    return found


def find_points(names: Sequence[str]) -> dict[str, list[int]]:
    """Return which of the points that a sensor or tracker measures are no bones of a humanoid.

    Returns
    -------
    dict
        Indices of names by the point in the table, with ``_left`` or ``_right`` if it has a side.
    """
    found: dict[str, list[int]] = {}
    for index, words in enumerate(_split(names)):
        side, own = _without_side(words)
        point = _POINTS.get(_without_digits("".join(own)))
        if not point and len(own) > 1 and own[0] in _WORDS and own[-1] in _INNER_ENDS:
            point = _POINTS[own[-1]]
        if point:
            found.setdefault(f"{point}_{side}" if side else point, []).append(index)
    return found


def _words(name: str) -> list[str]:
    """Return the words of a name in lower case, without its namespace; a point is before each number."""
    if name.startswith("__"):  # a spacer of MakeHuman, which has the name of the joint that follows it
        return []
    own = unicodedata.normalize("NFKC", re.split("[:|]", name)[-1][:MAX_NAME_LENGTH])
    own = own.replace("左", " left ").replace("右", " right ")
    words = [f".{word}" if word.isdigit() else word.lower() for word in _WORD.findall(own)]
    return [one for word in words for one in _CORNERS.get(word, (word,))]


def _split(names: Sequence[str]) -> list[list[str]]:
    """Return the words of names that tell joints apart; initials are replaced by words."""
    split = _without_shared_words([_words(name) for name in names])
    keys = ["".join(words) for words in split]
    if not set(keys) >= {f"{side}{initial}" for side in "lr" for initial in "shk"}:
        return split
    return [[key[0], _INITIALS[key[1]]] if key in _SIDED_INITIALS else [_MIDDLE_INITIALS.get(key, key)] for key in keys]


def _without_shared_words(split: list[list[str]]) -> list[list[str]]:
    """Return the words of names without those before and after them that (nearly) all joints share, and no part is."""
    joints = max(sum(map(bool, split)), MIN_SHARING_JOINTS)
    least = SHARED_WORD_SHARE * joints
    for end in (0, -1):
        counts = Counter(words[end] for words in split if words)
        word, count = max(counts.items(), key=lambda each: each[1], default=("", 0))
        known = word in _WORDS.keys() | _ORNAMENTS
        of_all = count >= ALL_SHARE * joints and _WORDS.get(word, "trunk") in _TRUNK_PARTS
        if count >= least and (not known or of_all) and word not in SIDES:
            rest = slice(-1) if end else slice(1, None)
            return _without_shared_words([words[rest] if words[end:][:1] == [word] else words for words in split])
    return split


def _without_side(words: list[str]) -> tuple[str | None, list[str]]:
    """Return the side in words, and the other words; a side may be at the beginning or end of a word."""
    sides, key = [SIDES[word] for word in words if word in SIDES], "".join(words)
    if sides or is_known(key):
        return (sides[-1] if sides else None), [word for word in words if word not in SIDES]
    matches = (pattern.fullmatch(key) for pattern in _GLUED_SIDES)
    match = next((match for match in matches if match and is_known(match["own"])), None)
    return (SIDES[match["side"]], [match["own"]]) if match else (None, words)


def is_known(key: str) -> bool:
    """Return whether a word in lower case is the name of a joint's part."""
    own = _without_digits(key)
    return own in _KNOWN or own in _SIDED_INITIALS | _ONE_LETTER_JOINTS or _FINGER.fullmatch(key) is not None


def _without_digits(key: str) -> str:
    return re.sub("[.0-9]", "", key)


def _conventions() -> dict[str, dict[tuple[bool, str], str]]:
    """Return the parts by whether they have a side, and by key, for each convention."""
    found = {}
    for name, convention in TABLE["conventions"].items():
        rows = ((False, MIDDLE_PARTS, "middle"), (True, SIDE_PARTS, "sides"))
        found[name] = {
            (sided, "".join(word for word in _words(own) if word not in _DECORATION)): part
            for sided, parts, row in rows
            for part, own in zip(parts, convention[row], strict=False)
            if own
        }
    return found


CONVENTIONS = _conventions()


def _convention(keys: Sequence[Key]) -> Mapping[tuple[bool, str], str]:
    """Return the convention that explains most joints; an empty one if a skeleton has few names of it."""
    best: Mapping[tuple[bool, str], str] = {}
    most = 0
    for parts in CONVENTIONS.values():
        explained = len({key for key in keys if (key[0] is not None, key[1]) in parts})
        if explained > most and explained >= least_names(parts):
            best, most = parts, explained
    return best


def least_names(convention: Mapping[tuple[bool, str], str]) -> float:
    """Return how many of the joints of a skeleton must have names of a convention."""
    return MIN_CONVENTION_SHARE * sum(1 + sided for sided, _ in convention)


def _meaning(
    side: str | None, words: list[str], convention: Mapping[tuple[bool, str], str], moving: bool
) -> JointMeaning | None:
    key = "".join(words)
    if part := convention.get((side is not None, key)) or _WORDS.get(_without_digits(key)):
        return JointMeaning(side, None, part)
    if _CONTROLS & set(words) and not moving:
        return None
    finger = _FINGER.fullmatch(key) if side else None
    if finger and (finger[2] or finger[3] or finger[1][-1].isdigit()):
        order = _PHALANGES.index(finger[3]) if finger[3] else int(finger[2] or 0)
        is_palm = finger[3] == "metacarpal" and _FINGERS[finger[1]] != "thumb"
        return None if is_palm else JointMeaning(side, None, _FINGERS[finger[1]], order)
    own = _without_digits("".join(word for word in words if word not in _CONTROLS - {"twist", "roll"}))
    part, quarter = _WORDS.get(own), None
    for word, which in QUARTERS.items():
        rest = own.removeprefix(word).removesuffix(word)
        if rest != own and part is None:
            said = _WORDS.get(rest)
            if side and said in (*LEG_PARTS, "shoulder", "wing"):
                part, quarter = said, which
            elif word in _PLACES:
                part = said
    part = part or ("wing" if any(word in _FINS or _WING.fullmatch(word) for word in words) else None)
    return JointMeaning(side, quarter, part) if part else None


def _loose_meaning(side: str | None, words: Sequence[str]) -> JointMeaning | None:
    """Return the only part of a limb that a name's words say, whatever the other words are."""
    said = {_WORDS.get(_without_digits(word), "root") for word in words}.difference(_TRUNK_PARTS)
    return JointMeaning(side, None, said.pop()) if len(said) == 1 and not (_ORNAMENTS | _CONTROLS) & {*words} else None
