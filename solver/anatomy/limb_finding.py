"""Finds the limbs of a character from its shape alone.

Points inside the character vote for the limbs that they belong to (`solver.anatomy.voted_limbs`). Which of these the
body has is decided for all together (`solver.anatomy.limb_counts`). Here they get their names, by side and row, and
joints in the middle of the character.
"""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from types import MappingProxyType

import numpy as np
import scipy
from numpy.typing import NDArray

from solver.anatomy.limb_chain import LimbChain, Limbs, evenly, leg_names
from solver.anatomy.limb_counts import CountedBody, counted_bodies
from solver.anatomy.solid import Solid, solid_of
from solver.anatomy.voted_limbs import MIRROR, Points, VotedLimb, bend_of, voted_limbs, votes_of
from solver.surface.mesh import SolverMesh

MAX_ASYMMETRY = 0.06
"""Maximum distance between a limb and the mirror image of its counterpart at which the two are made equal. This and the
following constants are shares of the largest extent."""

MAX_CLAIM = 0.15
"""Maximum distance between an end that the user gives and that of a limb which is meant."""

MAX_GAP = 0.1
"""Maximum distance between the trunk or a neck and what follows it that is closed."""

MIN_HOCK = 0.1
"""Minimum bend of hind legs at a hock, as a share of the line from the knee to the foot. 85 of 100 rigs of animals have
it."""

MIN_OTHER_CHANCE = 0.02
"""Minimum probability of a body that is returned beside the likeliest one."""

MIN_NECK_SHARE = 0.3
"""Minimum length of a neck that is a limb, as a share of the trunk's length."""

STEPS, MIN_SKULL = 40, 16
"""Number of steps along a neck with its head, and the first step at which the head may be thickest."""

UPRIGHT_COSINE = np.cos(np.radians(50))
"""Minimum cosine between up and the direction to the middle of a head that is upright on the trunk."""

ON_HEAD = {"left ear": 3, "right ear": 3, "jaw": 2}
"""Limbs on the head that only a user gives, and their numbers of points: by its shape, an ear is not to be told from a
horn, nor a jaw that is closed from the head."""


def find_limbs(
    mesh: SolverMesh, basis: NDArray[np.float64], ends: Mapping[str, Points] = MappingProxyType({})
) -> Limbs:
    """Find a character's limbs.

    Parameters
    ----------
    mesh : SolverMesh
    basis : (3, 3) float64
        Rows are the mesh's directions of the character's left, up and front.
    ends : mapping of str to (3,) float64
        Ends of limbs that the user has given, by name; mesh file's coordinates.
    """
    finder = _Finder(solid_of(mesh).along(basis), {name: basis @ np.asarray(end) for name, end in ends.items()})
    (_, limbs), *others = finder.bodies()
    return Limbs(
        _chains(limbs, basis),
        tuple(_missing(limbs)),
        tuple((chance, _chains(other, basis)) for chance, other in others),
    )


def _chains(found: Mapping[str, Points], basis: NDArray[np.float64]) -> tuple[LimbChain, ...]:
    return tuple(LimbChain(name, points @ basis) for name, points in found.items())


def _missing(found: Mapping[str, Points]) -> Iterator[str]:
    """Yield notes on limbs that most bodies have."""
    for limb, others in (("leg", ("leg",)), ("arm", ("arm", "wing"))):
        few = sum("leg" in name for name in found) < 3
        if few and not any(word in name for name in found for word in others):
            yield (
                f"No {limb}s were found. If there are any, give where they end: "
                f"--limb 'left {limb}=X,Y,Z' --limb 'right {limb}=X,Y,Z'"
            )


def _with_hocks(pair: tuple[VotedLimb, ...]) -> list[Points]:
    """Return the joints of hind legs, with a hock each if they bend between the knee and the foot."""
    bends = [bend_of(leg) for leg in pair]
    if np.mean([bend for bend, _ in bends]) < MIN_HOCK:
        return [leg.joints for leg in pair]
    return [np.insert(leg.joints, 2, place, axis=0) for leg, (_, place) in zip(pair, bends, strict=True)]


class _Finder:
    """Names the limbs of a solid whose coordinates are left, up and front."""

    def __init__(self, solid: Solid, ends: Mapping[str, Points]) -> None:
        self.solid, self.ends = solid, ends
        self.size = float(np.ptp(solid.centers, axis=0).max()) + solid.size
        self.inside = scipy.spatial.cKDTree(solid.centers)
        self.voted = voted_limbs(votes_of(solid))
        self.given = {name: self._given(name, end) for name, end in ends.items() if name not in ON_HEAD}

    def bodies(self) -> Iterator[tuple[float, dict[str, Points]]]:
        """Yield each likely body, the likeliest first: its probability, and the points of its limbs by their names."""
        bodies = counted_bodies(self.voted, self.inside)
        for body in [body for body in bodies if body is bodies[0] or body.chance >= MIN_OTHER_CHANCE]:
            found = self._trunk_and_head(len(body.limbs["leg"])) | self._pair("arm", body) | self._legs(body)
            found |= self._pair("wing", body)
            if body.limbs["tail"]:
                found["tail"] = body.limbs["tail"][0][0].joints
            found |= {name: points for name, points in self.given.items() if name != "head"}
            yield body.chance, found | self._on_head(found["head"])

    def _of(self, part: str) -> list[VotedLimb]:
        return [limb for limb in self.voted if limb.part == part]

    def _given(self, name: str, end: Points) -> Points:
        """Return the limb that ends where the user says, whatever it was taken for; without one, a straight limb."""
        near = min(self.voted, key=lambda limb: float(np.linalg.norm(limb.joints[-1] - end)))
        if near.part != "trunk" and np.linalg.norm(near.joints[-1] - end) < MAX_CLAIM * self.size:
            self.voted.remove(near)
            return np.vstack([near.joints[:-1], end])
        trunk = evenly(self._of("trunk")[0].joints, 30)
        if "arm" in name or "wing" in name:
            trunk = trunk[15:]
        return evenly(np.array([trunk[np.linalg.norm(trunk - end, axis=1).argmin()], end]), 4)

    def _pair(self, part: str, body: CountedBody) -> dict[str, Points]:
        """Return the limbs of the largest pair by name; of a single arm, this one."""
        for pair in body.limbs[part][:1]:
            if len(pair) == 2:
                return self._sides(part, pair[0].joints, pair[1].joints)
            return {f"{'left' if pair[0].side > 0 else 'right'} {part}": pair[0].joints}
        return {}

    def _legs(self, body: CountedBody) -> dict[str, Points]:
        """Return the legs in rows from hind to front."""
        pairs = sorted(body.limbs["leg"], key=lambda pair: sum(float(leg.joints[[0, -1], 2].sum()) for leg in pair))
        found: dict[str, Points] = {}
        for name, pair in zip(leg_names(len(pairs)), pairs, strict=True):
            found |= self._sides(name, *(_with_hocks(pair) if name == "hind leg" else [leg.joints for leg in pair]))
        return found

    def _sides(self, limb: str, left: Points, right: Points) -> dict[str, Points]:
        """Return a left and a right limb by name; limbs that nearly mirror each other are made equal."""
        offset = np.array([left[0, 0] + right[0, 0], 0.0, 0.0])
        if np.linalg.norm(left - right * MIRROR - offset, axis=1).max() < MAX_ASYMMETRY * self.size:
            left = (left + right * MIRROR + offset) / 2
            right = left * MIRROR + offset
        return {f"left {limb}": left, f"right {limb}": right}

    def _trunk_and_head(self, legs: int) -> dict[str, Points]:
        """Return the trunk, the neck if it is a limb of its own, and the head, each from the end of the one before.

        A body with two pairs of legs may have a neck where an upright one has none.
        """
        trunk = self._of("trunk")[0].joints
        heads = sorted(self._of("head"), key=lambda each: float(np.linalg.norm(each.joints[-1] - trunk[-1])))
        if len(heads) > 1 and np.linalg.norm(heads[-2].joints[-1] - heads[-1].joints[0]) > MAX_GAP * self.size:
            heads = self._of("head")[:1]  # the others are no neck
        ways = [trunk[[0, 1, 3]], *(each.joints[[0, 1, 3]] for each in heads[-2:])]
        if "head" in self.ends:
            ways = [*ways[:2], self.given["head"][[0, 2, 3]]]
        elif len(ways) == 1:
            ways.append(self._above(trunk))
        elif len(ways) == 2:
            ways[1:] = self._with_neck(trunk, heads[0].joints, legs)
        for before, after in pairwise(ways):
            if np.linalg.norm(after[0] - before[-1]) < MAX_GAP * self.size:
                after[0] = before[-1] = (after[0] + before[-1]) / 2
        names = ("trunk", "neck", "head") if len(ways) > 2 else ("trunk", "head")
        return dict(zip(names, [*ways[:-1], ways[-1][[0, 2]]], strict=True))

    def _with_neck(self, trunk: Points, head: Points, legs: int) -> list[Points]:
        """Return a neck and a head, if the head is far from a trunk on which it is not upright; else the head."""
        way = evenly(head, STEPS + 1)
        step = float(np.linalg.norm(np.diff(head, axis=0), axis=1).sum()) / STEPS
        depth = self.solid.depth[self.inside.query(way)[1]]
        skull = MIN_SKULL + int(depth[MIN_SKULL:].argmax())
        length = skull * step - float(depth[skull])
        stands = way[skull] - way[0]
        upright = legs < 2 and stands[1] > UPRIGHT_COSINE * np.linalg.norm(stands)
        if upright or length < MIN_NECK_SHARE * np.linalg.norm(trunk[-1] - trunk[0]):
            return [head[[0, 1, 3]]]
        end = max(round(length / step), 2)
        return [evenly(way[: end + 1], 3), way[[end, (end + STEPS) // 2, STEPS]]]

    def _above(self, trunk: Points) -> Points:
        """Return the head of a body that shows none: from the trunk to what is farthest beyond it."""
        way = trunk[-1] - trunk[0]
        return evenly(np.array([trunk[-1], self.solid.centers[(self.solid.centers @ way).argmax()]]), 3)

    def _on_head(self, head: Points) -> dict[str, Points]:
        """Return ears and a jaw whose ends the user has given, straight from the middle of the head."""
        skull = head.mean(axis=0)
        inside = self.solid.depth[np.linalg.norm(self.solid.centers - skull, axis=1).argmin()]
        found = {}
        for name in [name for name in ON_HEAD if name in self.ends]:
            way = self.ends[name] - skull
            begin = min(float(inside / np.linalg.norm(way)), 0.5) if name != "jaw" else 0.0
            found[name] = evenly(skull + way * [[begin], [1.0]], ON_HEAD[name])
        return found
