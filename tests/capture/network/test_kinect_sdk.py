import numpy as np
import pytest

from capture.skeleton import JOINT_INDEX

ADDRESSES = ["/joint", "/osceleton2/joint"]


def _joints(pose, names, osc_message, address, time, *, user=2, confidence=1.0):
    for name, ours in names.items():
        x, y, z = 1000 * pose[JOINT_INDEX[ours]]
        yield osc_message(address, "siiffffd", name, 0, user, x, -y, z, confidence, time)


@pytest.mark.parametrize("address", ADDRESSES)
def test_a_walk_of_single_datagrams_is_received(listen, walk, twenty, osc_message, address):
    wire = listen()
    for step, pose in enumerate(walk):
        frame = wire.frame(*_joints(pose, twenty, osc_message, address, 1.7e12 + 33.3 * step))
        assert frame.user == 2
        np.testing.assert_allclose(frame.positions, pose, atol=1e-6)
        assert frame.confidence.tolist() == [1.0] * 20
    assert wire.source.counts.received == 20 * len(walk)
    assert not wire.source.counts.refused


def test_confidence_is_tracked_inferred_or_lost(listen, osc_message):
    levels = {"head": 1.0, "neck": 0.5, "l_elbow": 0.1, "r_elbow": 7.0, "l_knee": -1.0}
    frame = listen().frame(
        *(
            osc_message("/joint", "siiffffd", name, 0, 1, 100.0, 200.0, 1500.0, level, 5.0)
            for name, level in levels.items()
        )
    )
    known = {name: frame.confidence[index] for name, index in JOINT_INDEX.items() if frame.confidence[index]}
    assert known == {"head": 1.0, "shoulder_center": 0.5, "elbow_right": 1.0}
    np.testing.assert_allclose(frame.positions[JOINT_INDEX["head"]], [0.1, -0.2, 1.5], rtol=1e-15)


def test_two_performers_in_each_others_datagrams_are_separated(listen, walk, twenty, osc_message):
    wire = listen()
    one = list(_joints(walk[0], twenty, osc_message, "/joint", 1.0, user=0))
    other = list(_joints(walk[5], twenty, osc_message, "/joint", 1.0, user=5))
    frames = wire.events(*(datagram for pair in zip(one, other, strict=True) for datagram in pair), count=2)
    assert [frame.user for frame in frames] == [0, 5]
    np.testing.assert_allclose(frames[0].positions, walk[0], atol=1e-6)
    np.testing.assert_allclose(frames[1].positions, walk[5], atol=1e-6)


def test_hands_and_faces_are_not_needed(listen, osc_message):
    wire = listen()
    wire.settle(
        osc_message("/osceleton2/hand", "iiiffffifd", 0, 1, 1, 0.0, 0.0, 0.0, 1.0, 2, 1.0, 5.0),
        osc_message("/osceleton2/face_rotation", "iiiiid", 0, 1, 10, 20, 30, 5.0),
        osc_message("/face", "iiffffffd", 0, 1, *[0.0] * 6, 5.0),
        osc_message("/face_animation", "iiffffffd", 0, 1, *[0.0] * 6, 5.0),
    )
    assert not wire.source.counts.refused


def test_centimetres_can_be_configured(listen, osc_message):
    frame = listen("?units=cm").frame(osc_message("/joint", "siiffffd", "head", 0, 1, 10.0, -20.0, 150.0, 1.0, 5.0))
    np.testing.assert_allclose(frame.positions[JOINT_INDEX["head"]], [0.1, 0.2, 1.5], rtol=1e-15)
