import numpy as np
import pytest

from capture.formats import bvh, bvh_parser
from capture.formats.skeleton_joints import REQUIRED, _choose_nodes
from capture.skeleton import JOINTS
from capture.skeleton_shape import shape_of

from .formats.bvh_files import BODY


def of_body(node, parent=-1, at=(0, 0, 0)):
    """Yield name, parent's name and position of each node of `BODY`."""
    name, offset, children = node
    here = np.add(at, offset)
    yield name, parent, here
    for child in children:
        yield from of_body(child, name, here)


def test_a_body_is_labelled_by_its_shape_as_by_its_names_in_any_axes():
    nodes = [(name or f"{parent} end", parent, at) for name, parent, at in of_body(BODY)]
    names = [name for name, _, _ in nodes]
    parents = [-1 if parent == -1 else names.index(parent) for _, parent, _ in nodes]
    rest = np.array([at for _, _, at in nodes])
    expected = _choose_nodes([name if not name.endswith(" end") else "" for name in names], list(rest[:, None]))
    for axes in (np.eye(3), np.eye(3)[[1, 2, 0]], np.diag([-1.0, 1, -1])):
        found = shape_of(parents, 0.3 * rest @ axes.T, [name.endswith(" end") for name in names])
        assert found.legs == 2
        assert {joint: found.joints.get(joint) for joint in expected if joint != "spine"} == {
            joint: node for joint, node in expected.items() if joint != "spine"
        }


def test_a_body_without_sides_has_no_legs():
    assert shape_of(range(-1, 5), np.outer(range(6), [0.0, 1, 0]), [False] * 6).legs == 0


@pytest.mark.parametrize("name", ["cmu_01_01_hops", "jumping_jacks", "makehuman_walk1", "wave_hello"])
def test_real_skeletons_are_labelled_as_by_their_names(real_data, name):
    nodes, values, *_ = bvh_parser.parse(real_data / "bvh" / f"{name}.bvh")
    motion = bvh.motion_of(nodes, values[:2])
    named = _choose_nodes(motion.names, motion.positions)
    shape = shape_of(motion.parents, motion.rest, [not each for each in motion.names])
    same = 0.01 * np.ptp(motion.rest)
    apart = {joint: np.abs(motion.rest[shape.joints[joint]] - motion.rest[named[joint]]).max() for joint in REQUIRED}
    assert set(REQUIRED) <= shape.joints.keys() <= set(JOINTS)
    assert max(apart.values()) < same
