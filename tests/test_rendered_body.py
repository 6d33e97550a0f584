"""The performer on whom trackers are measured (benchmarks/rendered_body.py): what is taken for the truth is in it."""

import numpy as np
import pytest
from puppetline.examples.performances import clean

pytestmark = pytest.mark.slow

WAVING = 120
DEEPEST = 0.2
"""Metres from skin to joint, from any side: half of the head, which is larger than life, the shoulders from aside."""


@pytest.fixture(scope="module")
def body(rendered_body):
    return rendered_body.Body()


@pytest.fixture(scope="module")
def waving():
    return clean("walk").positions[WAVING]


@pytest.mark.parametrize(("distance", "angle"), [(1.5, 0.0), (2.5, 45.0), (3.5, 0.0)])
def test_depth_at_a_joint_is_that_of_the_skin_before_it(rendered_body, body, waving, distance, angle):
    shot = rendered_body.Studio(body, distance, angle).shoot(0.0, waving)
    column, row = np.floor(rendered_body.LENS.project(shot.joints)).astype(int).T
    shown = (row >= 0) & (row < rendered_body.LENS.height) & (column >= 0) & (column < rendered_body.LENS.width)
    assert shown.sum() >= 10
    beneath = shot.joints[shown, 2] - shot.picture.depth[row[shown], column[shown]]
    assert (beneath > 0).all()
    near_side = np.array(["right" in name or name == "head" for name in rendered_body.NAMES])[shown]
    assert (beneath[near_side | (angle == 0)] < DEEPEST).all()  # the other arm and leg are behind the body


def test_bones_point_where_the_performers_do_and_keep_their_length(rendered_body, body, waving):
    _, at_rest = body.posed(clean("walk").positions[0])
    _, joints = body.posed(waving)
    seen = rendered_body.to_character_axes(waving)[rendered_body.KINECT]
    for side in ("left", "right"):
        for start, end in (("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle")):
            a, b = (rendered_body.NAMES.index(f"{joint}_{side}") for joint in (start, end))
            bone, theirs = joints[b] - joints[a], seen[b] - seen[a]
            assert bone @ theirs == pytest.approx(np.linalg.norm(bone) * np.linalg.norm(theirs))
            assert np.linalg.norm(bone) == pytest.approx(np.linalg.norm(at_rest[b] - at_rest[a]))
