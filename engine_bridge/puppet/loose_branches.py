"""Branches of a skeleton that hang far from what they belong to, as feet with inverse kinematics hang on the root."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import cKDTree

from capture.bone_names import JointMeaning
from engine_bridge.puppet.joint_labels import LABEL_OF, is_beyond, is_end
from engine_bridge.puppet.skin_joints import Joint

MAX_CONTACT_VERTICES = 400
"""Number of a joint's vertices with which its distance to others is measured."""

NEAR_SHARE = 0.05
"""Maximum distance between a joint and its parent that are near each other, as a share of the body's size."""

SAME_SHARE = 0.002
"""Maximum distance of joints at one place, as a share of the body's size."""

END_RATIO = 0.5
"""Maximum distance of a foot from the last joint of its leg, as a share of that from joints that have others below
them."""

APART_RATIO = 0.5
"""Maximum distance of a branch from a joint that it touches, as a share of that from the joint on which it hangs, if it
does not touch that."""

INNER_SHARE = 0.2
"""Share of the contacts of a branch, above which it is a whole limb if they are with joints that have others below."""

BARE_SHARE = 0.005
"""Maximum share of vertices that follow a joint that moves nothing of its own: a root may have a few by mistake."""

Carriers = list[tuple[float, int]]
"""Joints on which a branch can hang, the nearest first, with their distances."""


def hang_loose_branches(
    joints: Sequence[Joint], meanings: Sequence[JointMeaning | None], sides: Sequence[float], parents: dict[int, int]
) -> None:
    """Hang branches that are far from their parents, above which nothing moves vertices, on the joint that they touch.

    Joints that share triangles touch; of other joints, those whose vertices are nearest do. A root at the place of
    another joint hangs on that. The body stays where it is: the largest branch with a trunk by its names, else the
    largest that is no arm or leg.

    Parameters
    ----------
    joints : sequence of Joint
    meanings : sequence of JointMeaning or None
        What the name of each joint says.
    sides : sequence of float
        1 for a left joint, −1 for a right one, 0 for others.
    parents : dict
        The parent of each joint that is used, −1 for none; changed in place.
    """
    branches = _Branches(joints, meanings, sides, parents)
    if not branches.groups:
        return
    body = branches.body()
    _attach(parents, branches.carriers(body), branches.size_of)
    top = [body, *joints_above(parents, body)][-1]
    for root in [index for index in parents if parents[index] < 0 and index != top]:
        parents[root] = top


def held_count(joints: Sequence[Joint], indices: Sequence[int]) -> int:
    """Return the number of vertices that follow some of the joints."""
    return sum(len(joints[index].vertices) for index in indices)


def joints_above(parents: dict[int, int], index: int) -> list[int]:
    """Return the joints above a joint, the next one first."""
    found = []
    while (index := parents[index]) >= 0:
        found.append(index)
    return found


class _Branches:
    """Branches of a skeleton, by the joints at their tops, and what each can hang on.

    Attributes
    ----------
    groups : dict
        The joints of each branch.
    """

    def __init__(
        self,
        joints: Sequence[Joint],
        meanings: Sequence[JointMeaning | None],
        sides: Sequence[float],
        parents: dict[int, int],
    ) -> None:
        self._joints, self._meanings, self._sides, self._parents = joints, meanings, sides, parents
        self._labels = [LABEL_OF.get(meaning.part) if meaning else None for meaning in meanings]
        self._inner = {*parents.values()}
        self._firsts = self._first_joints()
        self._tops = self._topmost()
        self._group_of = {
            index: next(over for over in way if over in self._tops)
            for index in parents
            if not self._tops.keys().isdisjoint(way := [index, *joints_above(parents, index)])
        }
        self.groups = {top: [index for index, own in self._group_of.items() if own == top] for top in self._tops}
        self._held = {
            index: joint.vertices[:: max(len(joint.vertices) // MAX_CONTACT_VERTICES, 1)]
            for index in self._group_of
            if len((joint := joints[index]).vertices)
        }
        self._size = float(np.ptp(np.concatenate([*self._held.values()]), axis=0).max()) if self._held else 0.0

    def size_of(self, top: int) -> int:
        """Return the number of vertices that follow a branch."""
        return held_count(self._joints, self.groups[top])

    def body(self) -> int:
        """Return the branch that stays where it is."""
        return max(
            self.groups,
            key=lambda top: (
                any(self._labels[index] == "trunk" and not self._sides[index] for index in self.groups[top]),
                self._labels[self._tops[top]] not in ("arm", "leg"),
                self.size_of(top),
            ),
        )

    def carriers(self, body: int) -> dict[int, Carriers]:
        """Return where each branch that is far from its parent can hang; none hangs on one that hangs on itself."""
        found: dict[int, Carriers] = {}
        joined = dict(self._group_of)
        for top in sorted(self.groups, key=self.size_of):
            others = {index for index in self._parents if joined.get(index) != top}
            if top != body and (away := self._distances(top, others)):
                found[top] = sorted((distance, index) for index, distance in away.items())
                own = joined.get(found[top][0][1], -1)
                joined = {index: own if group == top else group for index, group in joined.items()}
        return found

    def _first_joints(self) -> list[int]:
        """Return the joints that move vertices, and above which none does."""
        total = held_count(self._joints, list(self._parents))
        bare = {
            index
            for index in self._parents
            if len(self._joints[index].vertices) <= BARE_SHARE * total * (index in self._inner)
        }
        return [
            index
            for index in self._parents
            if index not in bare and bare.issuperset(joints_above(self._parents, index))
        ]

    def _topmost(self) -> dict[int, int]:
        """Return the top of each branch, and its first joint that moves vertices."""
        shared = Counter(over for first in self._firsts for over in joints_above(self._parents, first))
        tops = {}
        for first in self._firsts:
            top = first
            while self._parents[top] >= 0 and shared[self._parents[top]] == 1:
                top = self._parents[top]
            tops[top] = first
        below = [index for index, parent in self._parents.items() if parent in self._firsts]
        return tops | {index: index for index in below if self._is_apart(index)}

    def _is_apart(self, top: int) -> bool:
        """Return whether a branch does not touch the joint on which it hangs, but one that is much nearer."""
        own = [index for index in self._parents if top in (index, *joints_above(self._parents, index))]
        others = (self._contacts(own).keys() & self._parents.keys()).difference(own)
        parent, place = self._parents[top], self._joints[top].place
        away = {index: np.linalg.norm(place - self._joints[index].place) for index in others | {parent}}
        return parent not in others and min(away.values()) < APART_RATIO * away[parent]

    def _contacts(self, indices: Sequence[int]) -> Counter[int]:
        """Return how many sides of triangles some joints share with each other joint."""
        return sum((Counter(self._joints[index].contacts) for index in indices), Counter[int]())

    def _distances(self, top: int, others: set[int]) -> dict[int, float]:
        """Return how far a branch is from the joints on which it can hang; none if it stays where it is."""
        parent, place = self._parents[top], self._joints[top].place
        first = next(index for index in (self._tops[top], *self.groups[top]) if index in self._held)
        contacts = self._contacts(self.groups[top])
        allowed = [index for index in self._parents if index in others and self._can_hang(first, index, contacts)]
        if parent >= 0 and np.linalg.norm(place - self._joints[parent].place) < NEAR_SHARE * self._size:
            return {}
        same = [each for each in allowed if np.allclose(self._joints[each].place, place, 0, SAME_SHARE * self._size)]
        allowed = [each for each in allowed if each in self._held]
        has_end = [
            each for each in allowed if each not in self._inner and is_end(self._meanings[first], self._meanings[each])
        ]
        away, is_whole = self._measured(first, has_end or allowed, contacts)
        if parent < 0:
            return away | dict.fromkeys(same, -np.inf)
        return {} if is_whole else away  # a foot is beyond the last joint of its leg, far from all others

    def _can_hang(self, first: int, other: int, contacts: Counter[int]) -> bool:
        """Return whether names and sides allow that a branch hangs on a joint."""
        label, meaning = self._labels[first], self._meanings[first]
        return (
            self._sides[first] * self._sides[other] >= 0
            and self._labels[other] in (None, "trunk", label or self._labels[other])
            and (
                bool(contacts[other])
                or label in (None, "trunk")
                or self._meanings[other] != meaning
                or other not in self._firsts
            )
            and not is_beyond(self._meanings[other], meaning)
        )

    def _measured(self, first: int, others: list[int], contacts: Counter[int]) -> tuple[dict[int, float], bool]:
        """Return how far a branch is from other joints, and whether it is a whole limb: it touches those with children.

        The distance of joints that it touches is less than 0: the more sides of triangles lead there, the less.
        """
        touching = {index: -float(contacts[index]) for index in others if contacts[index]}
        tree = cKDTree(self._held[first])
        away = {index: float(np.min(tree.query(self._held[index])[0])) for index in others}
        if touching:
            inner = sum(touching[index] for index in self._inner & touching.keys())
            return away | touching, inner < INNER_SHARE * sum(touching.values())
        nearest = min((away[index] for index in self._inner & away.keys()), default=np.inf)
        return away, min(away.values(), default=0.0) > END_RATIO * nearest


def _attach(parents: dict[int, int], carriers: dict[int, Carriers], size_of: Callable[[int], int]) -> None:
    """Hang branches on what hangs on the body already, the nearest first (Prim's algorithm).

    If none can, the largest one stays where it is.
    """
    while carriers:
        reached = {
            top: next(
                (each for each in row if carriers.keys().isdisjoint([each[1], *joints_above(parents, each[1])])), None
            )
            for top, row in carriers.items()
        }
        found = [(nearest, top) for top, nearest in reached.items() if nearest]
        if found:
            (_, parent), top = min(found)
            parents[top] = parent
        else:
            top = max(carriers, key=size_of)
        del carriers[top]
