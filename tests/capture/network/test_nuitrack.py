import math

import numpy as np
import pytest

from capture.skeleton import JOINT_INDEX

WIDTH, HEIGHT = 2 * math.tan(math.radians(58.6 / 2)), 2 * math.tan(math.radians(45.6 / 2))


def _projected(place):
    """Return a position in Nuitrack's mirrored image, and its depth in millimetres."""
    x, y, z = place
    return 0.5 + x / (z * WIDTH), 0.5 - y / (z * HEIGHT), 1000 * z


def test_a_walk_is_received(listen, walk, fifteen, assert_of_fifteen, osc_message, osc_bundle):
    wire = listen()
    for pose in walk:
        joints = [
            osc_message("/joint", "isfff", 4, name, *_projected(pose[JOINT_INDEX[ours]]))
            for name, ours in fifteen.items()
        ]
        assert_of_fifteen(wire.frame(osc_bundle(*joints)), 4, pose)


def test_one_joint_equals_values_by_hand(listen, osc_message, osc_bundle):
    waist = osc_bundle(osc_message("/joint", "isfff", 1, "waist", 0.75, 0.25, 2000.0))
    place = listen().frame(waist).positions[JOINT_INDEX["hip_center"]]
    # a quarter of the image to the right and up; the image is 2.2446 m wide and 1.6815 m high at 2 m
    np.testing.assert_allclose(place, [0.56114, 0.42037, 2.0], atol=1e-4)


def test_without_its_mirror_sides_and_x_are_exchanged_once_more(listen, osc_message, osc_bundle):
    hand = osc_bundle(osc_message("/joint", "isfff", 1, "l_hand", 0.25, 0.5, 2000.0))
    frame = listen("?mirrored=1").frame(hand)
    assert np.flatnonzero(frame.confidence).tolist() == [JOINT_INDEX["hand_right"]]
    assert frame.positions[JOINT_INDEX["hand_right"], 0] == pytest.approx(0.56114, abs=1e-4)


def test_lost_performers_are_reported_by_osceletons_message(listen, osc_message, osc_bundle):
    wire = listen()
    wire.frame(osc_bundle(osc_message("/joint", "isfff", 9, "head", 0.5, 0.5, 2000.0)))
    [lost] = wire.events(osc_message("/lost_user", "i", 9))
    assert lost.user == 9
