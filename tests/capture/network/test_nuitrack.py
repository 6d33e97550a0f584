import math

import numpy as np
import pytest

from capture.network.osc import bundle
from capture.skeleton import JOINT_INDEX

from .conftest import FIFTEEN, WALK, assert_of_fifteen, known, message

WIDTH, HEIGHT = 2 * math.tan(math.radians(58.6 / 2)), 2 * math.tan(math.radians(45.6 / 2))


def _joint(name, x, y, millimetres):
    return message("/joint", "isfff", 4, name, x, y, millimetres)


def test_a_walk_is_received(listen):
    wire = listen()
    for pose in WALK:
        joints = []
        for name, ours in FIFTEEN.items():
            x, y, z = pose[JOINT_INDEX[ours]]
            joints.append(_joint(name, 0.5 + x / (z * WIDTH), 0.5 - y / (z * HEIGHT), 1000 * z))
        frame = wire.frame(bundle(*joints))
        assert frame.user == 4
        assert_of_fifteen(frame.positions, frame.confidence, pose)
    [lost] = wire.events(message("/lost_user", "i", 4))  # by OSCeleton's message
    assert lost.user == 4


def test_joints_equal_values_by_hand_and_without_its_mirror_sides_and_x_are_exchanged_once_more(listen):
    """A quarter of the image to the right and up; the image is 2.2446 m wide and 1.6815 m high at 2 m."""
    place = known(listen().frame(bundle(_joint("waist", 0.75, 0.25, 2000.0))))["hip_center"]
    np.testing.assert_allclose(place, [0.56114, 0.42037, 2.0], atol=1e-4)
    frame = listen("?mirrored=1").frame(bundle(_joint("l_hand", 0.25, 0.5, 2000.0)))
    assert known(frame).keys() == {"hand_right"}
    assert known(frame)["hand_right"][0] == pytest.approx(0.56114, abs=1e-4)
