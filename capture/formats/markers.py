"""Markers on a body, as optical motion capture has them, and the joints between them.

The markers are those of Plug-in Gait, of CMU, of OpenSim's models and of ISB, in several spellings. A joint is the mean
of the markers on both sides of it, or a centre that a program has computed. A knee or an ankle with one marker is
beside it. The hips follow from the pelvis's markers: 0.36 of its width outwards, 0.19 backwards and 0.30 down from the
middle of its front (Bell et al. 1990).
"""

import itertools
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MARKERS = {
    "front": "asi asis fwt waistf waistfront hipf ias fthip",
    "back": "psi psis bwt backasis waistb hipb ips bkhip",
    "sacrum": "sacr vsac vsacral s2 sacrum waistback",
    "hip": "hjc hipjoint",
    "knee": "kjc kneejoint",
    "knee outside": "kne lfc fle",
    "knee sides": "kni knee mknee mfc fme",
    "ankle": "ajc anklejoint",
    "ankle outside": "ank lmal fal",
    "ankle sides": "ane ani ankle mankle mmal tam",
    "toe": "toe to toetip mt2 mt1 mt5 forefoot bigtoe fm1 fm2 fm5",
    "heel": "hee heel cal calc heelback fcc",
    "shoulder": "sho fsh bsh ac acromium acromion acr shoulder acrotip sae saj",
    "elbow": "elb iel elbow elbm melbow lel mel hle hme",
    "elbow else": "hum",
    "wrist": "wri owr iwr wre wra wrb w wrist faradius faulna radius ulna rsp usp uhe",
    "hand": "fin finger hand ihand ohand mcp3 middfing hm2 hm5",
    "head sides": "fhd bhd temple hea thea fhea head headf headb headfront headback headtamp fthead bkhead hdf hdb",
    "neck": "c7 cv7 clav sternum sjn snj",
}
"""Names of markers, without the side, by what they are at."""

BELL = 0.36, 0.19, 0.30
"""Distances of a hip from the middle of the pelvis's front, outwards, backwards and down, in widths of the pelvis."""

OUTER = {"knee": 0.28, "ankle": 0.2}
"""Distances from the outer side of a joint, where its only marker is, to its centre, as shares of the distance of the
hips from each other: some 0.05 m and 0.035 m of 0.18 m, with half of the marker."""

_SIDE_OF_JOINT = re.compile("(lat|med|lateral|medial|radius|ulna|reg|v|in|out|top|[0-9])+$")
"""Ends of names that tell the side of a joint, or how a program has placed the marker."""

_WORD = re.compile("[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+")
_CORNER = re.compile("(?<![A-Za-z])([FB])([LR])(?![A-Za-z])", re.IGNORECASE)
"""Front or back, and the side: Hip_FL."""
_SIDES = {"l": "Left", "left": "Left", "r": "Right", "right": "Right", "lt": "Left", "rt": "Right"}

_PLACES = {word: place for place, words in MARKERS.items() for word in words.split()}
_OF_JOINT = "", " sides", " outside", " else"
"""Ends of the places of the same joint: its centre, around it, on its outer side, and near it if there is no other."""

_JOINTS = ("knee", "ankle", "toe", "shoulder", "elbow", "wrist", "hand")


def joints_of_markers(names: Sequence[str], positions: Floats) -> dict[str, Floats]:
    """Return the joints (T, 3) that named markers (T, J, 3) tell, by the Kinect's names; NaN where they are lost.

    There are none if the markers are not those of a whole body.
    """
    return _joints(names, positions) if has_markers(names) else {}


def has_markers(names: Sequence[str]) -> bool:
    """Return whether names are those of the markers of a whole body."""
    places = {place for place in places_of(names) if place is not None}
    pelvis = {("hip", "Left"), ("hip", "Right")}, {("front", "Left"), ("front", "Right")}
    has_pelvis = pelvis[0] <= places or (pelvis[1] <= places and {"back", "sacrum"} & {place for place, _ in places})
    both = {
        joint: all({(f"{joint}{of}", side) for of in _OF_JOINT} & places for side in ("Left", "Right"))
        for joint in _JOINTS
    }
    return bool(has_pelvis) and both["shoulder"] and (both["elbow"] or both["knee"])


def _own(names: Sequence[str]) -> list[str]:
    """Return names without their namespace and the word that they all begin with.

    OpenCap's markers end in "_study". The joints of its videos, which it writes beside them, get no name.
    """
    own = [re.split("[:|]", name)[-1] for name in names]
    is_shared = len({name.split("_")[0] for name in own}) == 1
    own = [name.split("_", maxsplit=1)[-1] for name in own] if is_shared else own
    of_study = [name.removesuffix("_study") if name.endswith("_study") else "" for name in own]
    return of_study if any(of_study) else own


def places_of(names: Sequence[str]) -> list[tuple[str, str] | None]:
    """Return what each marker is at (`MARKERS`), and its side; None for others."""
    return [_place_of(name) for name in _own(names)]


def _place_of(name: str) -> tuple[str, str] | None:
    words = [word.lower() for word in _WORD.findall(_CORNER.sub(r"\1_\2", name))]
    side = next((word for word in words if word in _SIDES), "")
    if side:  # LElbowOut, HeadL, r_knee
        words.remove(side)
    full = side[:1] + "".join(words)
    for own in (full, _SIDE_OF_JOINT.sub("", full)):
        if own in _PLACES:
            return _PLACES[own], ""
        for letter in ("l", "r"):
            for rest in (own.removeprefix(letter), own.removesuffix(letter)):
                kept = (rest, rest[1:]) if side and rest[:1] in ("l", "m") else (rest,)  # lateral, medial: r_lwrist
                known = [_PLACES[each] for each in kept if rest != own and each in _PLACES]
                if known:
                    return known[0], _SIDES[letter]
    return None


def _joints(names: Sequence[str], positions: Floats) -> dict[str, Floats]:
    """Return the joints (T, 3) that markers tell, by the Kinect's names; NaN where they are lost."""
    known = np.where((positions == 0).all(axis=2, keepdims=True), np.nan, positions)
    found: dict[tuple[str, str], list[Floats]] = {}
    for index, place in enumerate(places_of(names)):
        if place is not None and np.isfinite(known[:, index]).any():
            found.setdefault(place, []).append(known[:, index])
    middle = {place: np.mean(each, axis=0) for place, each in found.items()}
    joints = {f"Hip{side}": middle["hip", side] for side in ("Left", "Right") if ("hip", side) in middle}
    joints |= _hips(middle) if len(joints) < 2 else {}
    across = _latest(joints["HipRight"] - joints["HipLeft"]) if len(joints) == 2 else np.zeros(3)
    for (side, sign), joint in itertools.product((("Left", 1.0), ("Right", -1.0)), _JOINTS):
        at = _joint(found, joint, side, sign * across)
        joints |= {} if at is None else {f"{joint.title()}{side}": at}
    heads = [each for (place, _), each in middle.items() if place == "head sides"]
    if len(heads) > 1:
        joints["Head"] = np.mean(heads, axis=0)
    if len(found.get(("neck", ""), ())) > 1:  # one alone is on the skin of the back, or of the chest
        joints["SpineShoulder"] = middle["neck", ""]
    return joints


def _joint(found: dict[tuple[str, str], list[Floats]], joint: str, side: str, inwards: Floats) -> Floats | None:
    """Return a joint (T, 3) from its markers; None without. A way across the hips tells where one is from outside."""
    centre, sides, outside, other = (found.get((f"{joint}{of}", side), []) for of in _OF_JOINT)
    markers = centre or sides + outside or other
    is_outside = len(markers) == len(outside) == 1 and not centre and not sides
    return np.mean(markers, axis=0) + is_outside * OUTER.get(joint, 0) * inwards if markers else None


def _latest(ways: Floats) -> Floats:
    """Return ways (T, 3) in which one that is NaN is the latest known one; zero before the first."""
    known = np.isfinite(ways).all(axis=1)
    latest: Floats = np.nan_to_num(ways[np.maximum.accumulate(np.where(known, np.arange(len(ways)), 0))])
    return latest


def _hips(middle: dict[tuple[str, str], Floats]) -> dict[str, Floats]:
    """Return the hips from the markers of the pelvis; none if these are missing."""
    backs = [each for (place, _), each in middle.items() if place in ("back", "sacrum")]
    if not backs or not {("front", "Left"), ("front", "Right")} <= middle.keys():
        return {}
    across = middle["front", "Right"] - middle["front", "Left"]
    width = np.linalg.norm(across, axis=1, keepdims=True)
    front = (middle["front", "Right"] + middle["front", "Left"]) / 2
    right = across / width
    backwards = np.mean(backs, axis=0) - front
    backwards -= np.einsum("ti,ti->t", backwards, right)[:, None] * right
    backwards /= np.linalg.norm(backwards, axis=1, keepdims=True)
    down = np.cross(right, backwards)
    out, back, below = BELL
    inner = front + width * (back * backwards + below * down)
    return {f"Hip{side}": inner + sign * out * width * right for side, sign in (("Left", -1.0), ("Right", 1.0))}
