from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from engine_bridge.puppet import joint_votes
from engine_bridge.puppet.joint_votes import JointVotes
from solver.anatomy.part_network import PARTS
from solver.anatomy.voted_limbs import Votes

from ...solver.anatomy.test_limb_finding import FIGURE
from ...solver.shapes import body_of

AXES = np.array([(0.0, 0, 1), (0, 1, 0), (-1, 0, 0)])
"""Left, up and front of a figure that looks to -x."""


@pytest.fixture
def joints():
    places = {"none": [], "left": [(0, 1, 1.0), (0, 1.1, 1)], "right": [(0, 1, -1.0)]}
    return SimpleNamespace(joints=[SimpleNamespace(vertices=np.reshape(each, (-1, 3))) for each in places.values()])


def test_each_point_counts_for_the_joint_whose_vertices_are_nearest(monkeypatch, joints):
    points = np.array([(0.9, 1, 0), (1.1, 1.05, 0), (-0.8, 1, 0.1)])  # left, up, front
    votes = Votes(points, np.eye(len(PARTS))[[1, 3, 5]], np.zeros((3, 4, 3)), 2.5)
    seen = []
    monkeypatch.setattr(joint_votes, "votes_of", lambda solid, sets: seen.append(solid) or votes)
    body = body_of(FIGURE, 0.06)
    found = JointVotes(joints, body)(AXES)
    assert_allclose(found.chances, [np.zeros(6), [0, 1, 0, 1, 0, 0], [0, 0, 0, 0, 0, 1]])
    assert_allclose(found.counts, [0, 2, 1])
    assert found.stands == 2.5
    low, high = (body.vertices @ AXES.T).min(axis=0), (body.vertices @ AXES.T).max(axis=0)
    assert ((seen[0].centers > low - 0.1) & (seen[0].centers < high + 0.1)).all(), "the way to see it"
