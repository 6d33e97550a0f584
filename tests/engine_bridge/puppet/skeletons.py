"""Skeletons of bodies as tables of joints."""

import numpy as np
from numpy.testing import assert_array_equal

from engine_bridge.puppet.rig_limbs import limbs_of_joints
from engine_bridge.puppet.skin_joints import Joint

UP, FRONT = np.eye(3)[1:]
SIDES = (("left", 1), ("right", -1))
NO_VERTICES = np.zeros((0, 3))


def rows(table):
    """Return by its first word the numbers of each line of a table, and its last word, which is the parent's name."""
    lines = map(str.split, table.strip().splitlines())
    return {name: (np.array(numbers, dtype=float), parent) for name, *numbers, parent in lines}


def joints_at(table):
    """Make joints from lines of name, parent, place and, if they are elsewhere, places of its vertices; parents first.

    A line with {side}, {s}, {S} or {n} is one of the left side, and of the right one as its mirror image. No vertex
    follows a joint that has ~ before its name.
    """
    joints = []
    for line in filter(str.strip, table.splitlines()):
        for side, sign in SIDES if "{" in line else SIDES[:1]:
            filled = line.format(side=side, s=side[0], S=side[0].upper(), n=int(sign < 0))
            name, parent, *numbers = filled.split()
            above = [number for number, joint in enumerate(joints) if joint.name == parent] or [-1]
            place, *held = np.array(numbers, dtype=float).reshape(-1, 3) * [sign, 1, 1]
            vertices = NO_VERTICES if name[0] == "~" else np.array(held or [place])
            joints.append(Joint(name.removeprefix("~"), above[-1], place, vertices))
    return joints


def points_of(joints):
    """Return the points of each limb of joints, which may be a table for `joints_at`."""
    return limbs_of_joints(joints_at(joints) if isinstance(joints, str) else joints).limbs.points


def assert_stands(found, up=UP, front=FRONT):
    """Assert in which directions the likeliest body has up and front."""
    body = found.bodies[0][1]
    assert_array_equal([body.up, body.front], [up, front])
