"""Body graph of a file's skeleton."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from capture.bone_names import LEG_PARTS, JointMeaning, is_control, joint_meanings, joint_sides, ornaments
from capture.channels import FINGERS
from engine_bridge.puppet.skin_joints import Joint
from solver.anatomy.body_graph import LABELS, BodyGraph

ARM_PARTS = ("shoulder", "upperArm", "lowerArm", "hand", "palm", *FINGERS)
FACE_PARTS = ("eye", "jaw", "face")
PARTS: dict[str, tuple[str, ...]] = {
    "head": ("neck", "head", *FACE_PARTS),
    "arm": ARM_PARTS,
    "leg": LEG_PARTS,
    "wing": ("wing",),
    "tail": ("tail",),
    "ear": ("ear",),
    "trunk": ("hips", "spine", "chest", "upperChest", "trunk"),
}
"""Parts in the names of joints, by the labels for which they speak."""

LABEL_OF = {part: label for label, parts in PARTS.items() for part in parts}

LIMBS = np.isin(LABELS, ("arm", "leg", "wing"))
"""Which of the labels are limbs that a shoulder can carry."""

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

END_PARTS = ("foot", "toes", "hand", "palm")
"""Parts at the ends of legs and arms."""

BARE_SHARE = 0.005
"""Maximum share of vertices that follow a joint that moves nothing of its own: a root may have a few by mistake."""


@dataclass(frozen=True, eq=False)
class JointGraph:
    """Body graph, and the joints at its nodes.

    Attributes
    ----------
    graph : BodyGraph
    joints : list of Joint
        The joint at each node. `Joint.parent` is as in the file.
    meanings : list of JointMeaning or None
    """

    graph: BodyGraph
    joints: list[Joint]
    meanings: list[JointMeaning | None]


def joint_graph(joints: Sequence[Joint]) -> JointGraph | None:
    """Return the body graph of joints; None if there are none.

    Joints without vertices below them are dropped, if others have vertices. Parents may follow their children.
    """
    names = [joint.name for joint in joints]
    meanings = joint_meanings(names, [len(joint.vertices) > 0 for joint in joints])
    sides = [{"left": 1.0, "right": -1.0}.get(side or "", 0.0) for side in joint_sides(names)]
    joints = _with_empty_ornaments(joints, meanings)
    holds = np.array([len(joint.vertices) > 0 for joint in joints], dtype=bool)
    if not holds.any():
        holds = np.array([not is_control(joint.name) for joint in joints], dtype=bool)
    if not holds.any():
        return None
    used = set[int]()
    for index in np.flatnonzero(holds).tolist():
        while index >= 0 and index not in used:
            used.add(index)
            index = joints[index].parent
    parents = {index: joints[index].parent for index in used}
    _hang(joints, meanings, sides, parents)
    order = _ordered(parents)
    while len(order) > 1 and not len(joints[order[0]].vertices) and sum(parents[i] == order[0] for i in order) == 1:
        parents[order[1]] = -1
        del order[0]
    if len(joints[order[0]].vertices) > BARE_SHARE * _held(joints, order):
        _root_at_fork(parents, order[0])
        order = _ordered({index: parents[index] for index in order})
    rows = {index: row for row, index in enumerate(order)}
    chosen = [joints[index] for index in order]
    places = np.array([joint.place for joint in chosen])
    above = np.array([rows.get(parents[index], -1) for index in order], dtype=np.int64)
    children = [[row for row in range(len(order)) if above[row] == node] for node in range(len(order))]
    tips, radii = np.empty_like(places), np.empty(len(order))
    for row, joint in enumerate(chosen):
        tips[row], radii[row] = _extent(joint, places[children[row]], above[row] < 0)
    counts = np.array([len(joint.vertices) for joint in chosen], dtype=float)
    own = [meanings[index] for index in order]
    every = np.concatenate([places, *(joint.vertices for joint in chosen if len(joint.vertices))])
    graph = BodyGraph(
        places,
        above,
        tips,
        radii,
        counts / max(counts.sum(), 1.0),
        _votes(own, children),
        np.array([sides[index] for index in order]),
        np.array([_quarter(meaning) for meaning in own]),
        np.array([bool(meaning and meaning.part in FACE_PARTS) for meaning in own]),
        np.array([every.min(axis=0), every.max(axis=0)]),
    )
    return JointGraph(graph, chosen, own)


def _votes(meanings: Sequence[JointMeaning | None], children: Sequence[Sequence[int]]) -> NDArray[np.float64]:
    """Return the labels (n, 7) for which the names of nodes speak; a shoulder is of the limb that it carries."""
    votes = np.zeros((len(meanings), len(LABELS)))
    for row, meaning in reversed([*enumerate(meanings)]):
        if meaning is None or (meaning.side and meaning.part == "spine"):  # "back_claw_L" is of a limb
            continue
        carried = votes[children[row]].sum(axis=0) * LIMBS
        if meaning.part == "shoulder" and carried.any():
            votes[row, carried.argmax()] = 1.0
            continue
        label = "leg" if meaning.side and meaning.part == "hips" and children[row] else LABEL_OF.get(meaning.part)
        if label:
            votes[row, LABELS.index(label)] = 1.0
    return votes


def _with_empty_ornaments(joints: Sequence[Joint], meanings: Sequence[JointMeaning | None]) -> list[Joint]:
    """Return joints of which those of hair, clothes and the like hold nothing, nor do unknown ones that hang on them.

    What carries a part of the body is none of them, whatever its name.
    """
    parents = {index: joint.parent for index, joint in enumerate(joints)}
    carrying = {over for index, meaning in enumerate(meanings) if meaning for over in [index, *_above(parents, index)]}
    named = ornaments([joint.name for joint in joints])
    nothing = np.zeros((0, 3))
    return [
        replace(joint, vertices=nothing)
        if index not in carrying and any(named[over] for over in [index, *_above(parents, index)])
        else joint
        for index, joint in enumerate(joints)
    ]


def _root_at_fork(parents: dict[int, int], root: int) -> None:
    """Hang the joints above the first fork on it: the root may be the end of a body, such as the tail of a fish."""
    children = Counter(parents.values())
    row = [root]
    while children[row[-1]] == 1:
        row.append(next(index for index, parent in parents.items() if parent == row[-1]))
    if children[row[-1]]:
        parents |= dict(pairwise(row)) | {row[-1]: -1}


def _hang(
    joints: Sequence[Joint], meanings: Sequence[JointMeaning | None], sides: Sequence[float], parents: dict[int, int]
) -> None:
    """Hang branches that are far from their parents, above which nothing moves vertices, on the joint that they touch.

    Feet with inverse kinematics hang on the root, and parts of an armature may have no parent. Joints that share
    triangles touch; of other joints, those whose vertices are nearest do. A root at the place of another joint hangs on
    that. The body stays where it is: the largest branch with a trunk by its names, else the largest that is no arm or
    leg.
    """
    labels = [LABEL_OF.get(meaning.part) if meaning else None for meaning in meanings]
    total = _held(joints, list(parents))
    inner = {*parents.values()}
    bare = {index for index in parents if len(joints[index].vertices) <= BARE_SHARE * total * (index in inner)}
    firsts = [index for index in parents if index not in bare and bare.issuperset(_above(parents, index))]
    if not firsts:
        return
    shared = Counter(other for first in firsts for other in _above(parents, first))
    tops = {}
    for first in firsts:
        top = first
        while parents[top] >= 0 and shared[parents[top]] == 1:
            top = parents[top]
        tops[top] = first
    tops |= {index: index for index in parents if parents[index] in firsts and _is_apart(joints, parents, index)}
    group_of = {
        index: next(over for over in over_it if over in tops)
        for index in parents
        if not tops.keys().isdisjoint(over_it := [index, *_above(parents, index)])
    }
    groups = {top: [index for index in group_of if group_of[index] == top] for top in tops}
    held = {index: _thinned(joints[index].vertices) for index in group_of if len(joints[index].vertices)}
    size = float(np.ptp(np.concatenate(list(held.values())), axis=0).max())
    main = max(
        groups,
        key=lambda top: (
            any(labels[index] == "trunk" and not sides[index] for index in groups[top]),
            labels[tops[top]] not in ("arm", "leg"),
            _held(joints, groups[top]),
        ),
    )
    nearest: dict[int, list[tuple[float, int]]] = {}
    joined = dict(group_of)
    for top in sorted(groups, key=lambda top: _held(joints, groups[top])):
        parent = parents[top]
        first = next(index for index in (tops[top], *groups[top]) if index in held)
        side, label, meaning = sides[first], labels[first], meanings[first]
        contacts = sum((Counter(joints[index].contacts) for index in groups[top]), Counter[int]())
        allowed = {
            index
            for index in parents
            if joined.get(index) != top
            and side * sides[index] >= 0
            and labels[index] in (None, "trunk", label or labels[index])
            and (contacts[index] or label in (None, "trunk") or meanings[index] != meaning or index not in firsts)
            and not _is_beyond(meanings[index], meaning)
        }
        same = [each for each in allowed if np.allclose(joints[each].place, joints[top].place, 0, SAME_SHARE * size)]
        near = parent >= 0 and np.linalg.norm(joints[top].place - joints[parent].place) < NEAR_SHARE * size
        allowed &= held.keys()
        if top == main or near or not (allowed or (parent < 0 and same)):
            continue
        ends = [index for index in allowed.difference(parents.values()) if _is_end(meaning, meanings[index])]
        away, whole = _distances(first, ends or list(allowed), inner, contacts, held)
        if parent < 0 or not whole:  # a foot is beyond the last joint of its leg, far from all others
            away |= dict.fromkeys(same if parent < 0 else (), -np.inf)
            nearest[top] = sorted((distance, index) for index, distance in away.items())
            own = joined.get(nearest[top][0][1], -1)  # which does not hang on this branch
            joined = {index: own if group == top else group for index, group in joined.items()}
    while nearest:  # Prim's algorithm: what hangs on the body, the nearest first
        reached = {
            top: next((each for each in row if nearest.keys().isdisjoint([each[1], *_above(parents, each[1])])), None)
            for top, row in nearest.items()
        }
        found = [(place, top) for top, place in reached.items() if place]
        (_, parent), top = min(found, default=((0.0, -1), max(nearest, key=lambda top: _held(joints, groups[top]))))
        parents[top] = parent if found else parents[top]
        del nearest[top]
    main = [main, *_above(parents, main)][-1]
    for root in [index for index in parents if parents[index] < 0 and index != main]:
        parents[root] = main


def _is_apart(joints: Sequence[Joint], parents: dict[int, int], top: int) -> bool:
    """Return whether a branch does not touch the joint on which it hangs, but one that is much nearer."""
    own = [index for index in parents if top in (index, *_above(parents, index))]
    contacts = sum((Counter(joints[index].contacts) for index in own), Counter[int]())
    others = (contacts.keys() & parents.keys()).difference(own)
    away = {index: np.linalg.norm(joints[top].place - joints[index].place) for index in others | {parents[top]}}
    return parents[top] not in others and min(away.values()) < APART_RATIO * away[parents[top]]


def _distances(
    first: int, others: list[int], inner: set[int], contacts: Counter[int], held: dict[int, NDArray[np.float64]]
) -> tuple[dict[int, float], bool]:
    """Return how far a branch is from other joints, and whether it is a whole limb: it touches those with children.

    The distance of joints that it touches is less than 0: the more sides of triangles lead there, the less.
    """
    touching = {index: -float(contacts[index]) for index in others if contacts[index]}
    tree = cKDTree(held[first])
    away = {index: float(np.min(tree.query(held[index])[0])) for index in others}
    if touching:
        whole = sum(touching[index] for index in inner & touching.keys()) < INNER_SHARE * sum(touching.values())
        return away | touching, whole
    nearest = min((away[index] for index in inner & away.keys()), default=np.inf)
    return away, min(away.values(), default=0.0) > END_RATIO * nearest


def _quarter(meaning: JointMeaning | None) -> float:
    """Return 1 for a limb in front, −1 for one behind, 0 for others."""
    words = (meaning and meaning.quarter) or ""
    return float("front" in words) - float("hind" in words)


def _is_end(foot: JointMeaning | None, leg: JointMeaning | None) -> bool:
    """Return whether names say that a joint is the foot of a leg, or the hand of an arm."""
    if foot is None or leg is None or foot.part not in END_PARTS or leg.part in END_PARTS:
        return False
    same = LABEL_OF.get(foot.part) == LABEL_OF.get(leg.part)
    return same and (foot.side, foot.quarter) == (leg.side, leg.quarter)


def _is_beyond(one: JointMeaning | None, other: JointMeaning | None) -> bool:
    """Return whether names say that one joint is farther down the same limb than another.

    Beside a thigh, a leg is the shin; beside other joints, it may be any part of a leg.
    """
    if one is None or other is None or one.side is None or other.part == "leg":
        return False
    label, order = LABEL_OF.get(one.part), (*ARM_PARTS, *LEG_PARTS)
    if label not in ("arm", "leg") or label != LABEL_OF.get(other.part):
        return False
    same = (one.side, one.quarter) == (other.side, other.quarter)
    return same and order.index(one.part) > order.index(other.part)


def _held(joints: Sequence[Joint], indices: Sequence[int]) -> int:
    return sum(len(joints[index].vertices) for index in indices)


def _above(parents: dict[int, int], index: int) -> list[int]:
    """Return the joints above a joint."""
    found = []
    while (index := parents[index]) >= 0:
        found.append(index)
    return found


def _thinned(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return points[:: max(len(points) // MAX_CONTACT_VERTICES, 1)]


def _ordered(parents: dict[int, int]) -> list[int]:
    """Return joints, parents before their children."""
    children: dict[int, list[int]] = {}
    for index in sorted(parents):
        children.setdefault(parents[index], []).append(index)
    order = list(children.get(-1, []))
    for index in order:
        order += children.get(index, [])
    return order


def _extent(joint: Joint, children: NDArray[np.float64], top: bool) -> tuple[NDArray[np.float64], float]:
    """Return the end of a joint's vertices, and their median distance from its bone.

    The end at the top of a row of joints is away from the others.
    """
    if not len(joint.vertices):
        return joint.place, 0.0
    if top and len(children) == 1:
        children = 2 * joint.place - children
    center = (joint.vertices.min(axis=0) + joint.vertices.max(axis=0)) / 2
    aim = children[np.linalg.norm(children - joint.place, axis=1).argmax()] if len(children) == 1 else center
    way = (aim - joint.place) / max(float(np.linalg.norm(aim - joint.place)), 1e-12)
    beside = (joint.vertices - joint.place) - np.outer((joint.vertices - joint.place) @ way, way)
    reach = max(float(np.quantile((joint.vertices - joint.place) @ way, 0.95)), 0.0)
    return joint.place + reach * way, float(np.median(np.linalg.norm(beside, axis=1)))
