"""Graphs of bodies, made by hand."""

import numpy as np

from solver.anatomy.body_graph import LABELS, BodyGraph

TABLE = """
pelvis  -       0    1     0
spine   pelvis  0    1.25  0
chest   spine   0    1.45  0
neck    chest   0    1.55  0
head    neck    0    1.65  0.02
arm     chest   0.2  1.45  0
elbow   arm     0.45 1.43 -0.02
wrist   elbow   0.7  1.43  0
hip     pelvis  0.1  0.95  0
knee    hip     0.1  0.5   0.03
ankle   knee    0.1  0.08 -0.02
toes    ankle   0.1  0.02  0.12
"""
PERSON = {name: (parent, np.array(place, float)) for name, parent, *place in map(str.split, TABLE.strip().splitlines())}
"""Parent and place of the joints in the middle and on the left; y is up, z the front, x the left. 1.8 m tall."""

ENDS = {"head": (0, 1.8, 0.02), "wrist": (0.88, 1.43, 0), "toes": (0.1, 0.0, 0.2)}
"""Ends beyond the last joints."""


def person(votes=None, sides=None, quarters=None, order=None, more=None, turn=None, scale=1.0, shift=(0, 0, 0)):
    """Return the graph of a person in a T-pose, and its joints' names, in `order` where that is given.

    Names may vote for a label, or tell a side or what is in front. `more` joints have a parent, a place and an end;
    `turn` are the axes of the new coordinates as rows.
    """
    joints = {}
    for name, (parent, place) in PERSON.items():
        for side, sign in (("", 1),) if place[0] == 0 else (("left ", 1), ("right ", -1)):
            above = side + parent if side + parent in joints else parent
            joints[side + name] = (above, place * [sign, 1, 1], np.multiply(ENDS.get(name, place), [sign, 1, 1]))
    joints |= more or {}
    names = list(joints) if order is None else order
    turn = np.eye(3) if turn is None else np.asarray(turn, float)

    def placed(points):
        return scale * np.array(points, float) @ turn.T + shift

    places, tips = placed([joints[name][1] for name in names]), placed([joints[name][2] for name in names])
    parents = np.array([names.index(joints[name][0]) if joints[name][0] in joints else -1 for name in names])
    said = np.zeros((len(names), len(LABELS)))
    for name, label in (votes or {}).items():
        said[names.index(name), LABELS.index(label)] = 1.0
    corners = placed([(-0.9, 0, -0.12), (0.9, 1.8, 0.2)])
    graph = BodyGraph(
        places,
        parents,
        tips,
        np.full(len(names), 0.06 * scale),
        np.full(len(names), 1 / len(names)),
        said,
        np.array([(sides or {}).get(name, 0.0) for name in names]),
        np.array([(quarters or {}).get(name, 0.0) for name in names]),
        np.zeros(len(names), bool),
        np.array([corners.min(axis=0), corners.max(axis=0)]),
    )
    return graph, names
