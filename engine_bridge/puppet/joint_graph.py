"""Body graph of a file's skeleton."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from capture.bone_names import JointMeaning, is_control, joint_meanings, joint_sides, ornaments
from engine_bridge.puppet.joint_labels import FACE_PARTS, quarter_of, votes_of
from engine_bridge.puppet.loose_branches import BARE_SHARE, hang_loose_branches, held_count, joints_above
from engine_bridge.puppet.skin_joints import Joint
from solver.anatomy.body_graph import BodyGraph


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
    hang_loose_branches(joints, meanings, sides, parents)
    order = _ordered(parents)
    while len(order) > 1 and not len(joints[order[0]].vertices) and sum(parents[i] == order[0] for i in order) == 1:
        parents[order[1]] = -1
        del order[0]
    if len(joints[order[0]].vertices) > BARE_SHARE * held_count(joints, order):
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
        votes_of(own, children),
        np.array([sides[index] for index in order]),
        np.array([quarter_of(meaning) for meaning in own]),
        np.array([bool(meaning and meaning.part in FACE_PARTS) for meaning in own]),
        np.array([every.min(axis=0), every.max(axis=0)]),
    )
    return JointGraph(graph, chosen, own)


def _with_empty_ornaments(joints: Sequence[Joint], meanings: Sequence[JointMeaning | None]) -> list[Joint]:
    """Return joints of which those of hair, clothes and the like hold nothing, nor do unknown ones that hang on them.

    What carries a part of the body is none of them, whatever its name.
    """
    parents = {index: joint.parent for index, joint in enumerate(joints)}
    carrying = {
        over for index, meaning in enumerate(meanings) if meaning for over in [index, *joints_above(parents, index)]
    }
    named = ornaments([joint.name for joint in joints])
    nothing = np.zeros((0, 3))
    return [
        replace(joint, vertices=nothing)
        if index not in carrying and any(named[over] for over in [index, *joints_above(parents, index)])
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
