"""Named joints along the limbs of a puppet.

A limb of a humanoid has the joints of VRM (`engine_bridge.puppet.humanoid_bones`), any other limb those of its own
name: `tail_1`, `wing_left_1`. A handle is a joint of its own. If a limb has fewer bones than VRM has joints, the
further joints are along its last bone and move with it, so that an animator can turn them.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.motion.limbs import TRUNK, Limb, bones_of, distance_from_segment, parents_first

LIMB_JOINTS: dict[str, tuple[str, ...]] = {
    TRUNK: ("hips", "spine", "chest", "upperChest"),
    "neck": ("neck",),
    "head": ("neck", "head"),
    **{
        f"{side} arm": tuple(f"{side}{bone}" for bone in ("UpperArm", "LowerArm", "Hand")) for side in ("left", "right")
    },
    **{
        f"{side} leg": tuple(f"{side}{bone}" for bone in ("UpperLeg", "LowerLeg", "Foot", "Toes"))
        for side in ("left", "right")
    },
}
"""VRM's joints for each limb of a puppet file, root to tip; a joint belongs to the first limb that lists it."""

ROOT = "root"
"""Name of the joint above all others, where one is needed; it does not move."""

MIDDLE_LIMBS = (TRUNK, "neck", "head")
"""Limbs in the middle of the body. Their further joints are at equal intervals before the tip, those of others beyond
it."""

MIN_UPPER_CHEST_BONES = 4
"""Minimum number of the trunk's bones with which there is an upper chest."""

TOES_SHARE = 0.6
"""Position of the toes on the last bone of a leg without a bone of their own."""

COLLAR_SHARE = 0.25
"""Position of a collar bone's start, as a share of the way from the end of the trunk to the upper arm."""

SIDED = re.compile(r"(left|right) (.+)")


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint at rest.

    Attributes
    ----------
    name : str
    parent : int
        Row of the parent, −1 for none.
    bone : int
        Bone of the puppet that the joint moves with, or the number of bones plus that of a handle; −1 for a joint that
        does not move.
    head, tail : (3,) float64
        Mesh file's coordinates; equal for a joint at the tip of a limb.
    limb : str
        Name of its limb; empty for a root or a handle.
    """

    name: str
    parent: int
    bone: int
    head: NDArray[np.float64]
    tail: NDArray[np.float64]
    limb: str = ""


def joints_of(limbs: Sequence[Limb], handles: Iterable[tuple[str, NDArray[np.float64]]] = ()) -> list[Joint]:
    """Return the joints of limbs and handles, parents before their children.

    If several bones have no parent, or there is no bone at all, they hang on a joint `ROOT` that does not move.

    Parameters
    ----------
    limbs : sequence of Limb
    handles : iterable of (str, (3,) float64), optional
        Names and positions.

    Returns
    -------
    list of Joint
        With distinct names.
    """
    return _Builder(parents_first(limbs), list(handles)).joints


class _Builder:
    """Adds the joints of one limb after the other."""

    def __init__(self, limbs: list[Limb], handles: list[tuple[str, NDArray[np.float64]]]) -> None:
        self.joints: list[Joint] = []
        self._limbs = {limb.name: limb for limb in limbs}
        bones = bones_of(limbs)
        tops = int((bones.parents < 0).sum()) + (0 if limbs else len(handles))
        if tops > 1:
            self._add(ROOT, -1, -1, np.zeros(3), np.zeros(3))
        first = 0
        for limb in limbs:
            self._add_limb(limb, first, int(bones.parents[first]))
            first += len(limb.points) - 1
        for number, (name, place) in enumerate(handles):
            near = self._nearest(self.joints, place) if limbs else min(tops, 2) - 2
            self._add(_identifier(name), near, len(bones) + number, place, place)

    def _add(
        self, name: str, parent: int, bone: int, head: NDArray[np.float64], tail: NDArray[np.float64], limb: str = ""
    ) -> int:
        taken = {joint.name for joint in self.joints}
        unique, number = name, 2
        while unique in taken:
            unique, number = f"{name}_{number}", number + 1
        self.joints.append(Joint(unique, parent, bone, head, tail, limb))
        return len(self.joints) - 1

    def _add_limb(self, limb: Limb, first: int, parent_bone: int) -> None:
        """Add a limb whose first bone and that bone's parent have these numbers."""
        on = self._parent_row(limb, parent_bone)
        if limb.name.endswith(" arm") and TRUNK in self._limbs and limb.name in LIMB_JOINTS:
            end = self._limbs[TRUNK].points[-1]
            collar = end + COLLAR_SHARE * (limb.points[0] - end)
            side = limb.name.split()[0]
            on = self._add(f"{side}Shoulder", on, parent_bone, collar, limb.points[0], limb.name)
        for name, number, head, tail in _chain(limb, taken={joint.name for joint in self.joints}):
            on = self._add(name, on, first + number, head, tail, limb.name)

    def _parent_row(self, limb: Limb, parent_bone: int) -> int:
        """Return the joint on which a limb hangs."""
        if parent_bone < 0:
            return 0 if self.joints and self.joints[0].name == ROOT else -1
        own = [joint for joint in self.joints if joint.bone == parent_bone and not joint.name.endswith("Shoulder")]
        return self._nearest(own, limb.points[0])

    def _nearest(self, joints: Sequence[Joint], place: NDArray[np.float64]) -> int:
        """Return the row of the joint whose segment is nearest to a position; of equal ones the last."""
        nearest = min(reversed(joints), key=lambda joint: distance_from_segment(place, joint.head, joint.tail))
        return next(row for row, joint in enumerate(self.joints) if joint is nearest)


def _chain(limb: Limb, taken: set[str]) -> Iterator[tuple[str, int, NDArray[np.float64], NDArray[np.float64]]]:
    """Yield the joints along a limb: name, number of its bone in the limb, head and tail."""
    count = len(limb.points) - 1
    names = _names(limb, count, taken)
    steps = max(len(names) - count + (limb.name in MIDDLE_LIMBS), 1)
    heads = []
    for number in range(len(names)):
        bone = min(number, count - 1)
        share = TOES_SHARE if names[number].endswith("Toes") and number > bone else (number - bone) / steps
        heads.append((bone, limb.points[bone] + share * (limb.points[bone + 1] - limb.points[bone])))
    for name, (bone, head), after in zip(names, heads, [*heads[1:], None], strict=True):
        tail = limb.points[bone + 1] if after is None or after[0] != bone else after[1]
        yield name, bone, head, tail


def _names(limb: Limb, bones: int, taken: set[str]) -> list[str]:
    """Return the names of a limb's joints, at least one per bone."""
    names = [name for name in LIMB_JOINTS.get(limb.name, ()) if name not in taken]
    if limb.name == TRUNK and bones < MIN_UPPER_CHEST_BONES:
        names.remove("upperChest")
    if names and names[-1].endswith("Toes") and bones < len(names) - 1:  # a leg without a foot has no toes
        names.pop()
    if names:
        return [*names, *(f"{names[-1]}_{number}" for number in range(2, bones - len(names) + 2))]
    base = _identifier(limb.name)
    return [f"{base}_{number}" for number in range(1, bones + 1)]


def _identifier(name: str) -> str:
    """Return a name with its side last: ``wing_left`` for "left wing"."""
    sided = SIDED.fullmatch(name)
    return re.sub(r"\s+", "_", f"{sided[2]} {sided[1]}" if sided else name)
