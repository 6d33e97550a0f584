import pytest
from numpy.testing import assert_allclose

from capture.skeleton import JOINT_INDEX

from .conftest import TWENTY, WALK, kinect_sdk, known, message


def _joints(pose, **options):
    return [kinect_sdk(name, pose[JOINT_INDEX[ours]] * [1000, -1000, 1000], **options) for name, ours in TWENTY.items()]


@pytest.mark.parametrize("address", ["/joint", "/osceleton2/joint"])
def test_a_walk_of_single_datagrams_is_received(listen, address):
    wire = listen()
    for step, pose in enumerate(WALK):
        frame = wire.frame(*_joints(pose, address=address, time=1.7e12 + 33.3 * step))
        assert frame.user == 2
        assert_allclose(frame.positions, pose, atol=1e-6)
        assert frame.confidence.tolist() == [1.0] * 20
    assert (wire.source.counts.received, wire.source.counts.refused) == (20 * len(WALK), {})


def test_confidence_is_tracked_inferred_or_lost(listen):
    levels = {"head": 1.0, "neck": 0.5, "l_elbow": 0.1, "r_elbow": 7.0, "l_knee": -1.0}
    frame = listen().frame(*(kinect_sdk(name, (100.0, 200.0, 1500.0), level) for name, level in levels.items()))
    assert {name: frame.confidence[JOINT_INDEX[name]] for name in known(frame)} == {
        "head": 1.0,
        "shoulder_center": 0.5,
        "elbow_right": 1.0,
    }
    assert_allclose(known(frame)["head"], [0.1, -0.2, 1.5], rtol=1e-15)
    frame = listen("?units=cm").frame(kinect_sdk("head", (10.0, -20.0, 150.0)))
    assert_allclose(known(frame)["head"], [0.1, 0.2, 1.5], rtol=1e-15)


def test_hands_and_faces_are_not_needed(listen):
    assert not listen().refused(
        message("/osceleton2/hand", "iiiffffifd", 0, 1, 1, 0.0, 0.0, 0.0, 1.0, 2, 1.0, 5.0),
        message("/osceleton2/face_rotation", "iiiiid", 0, 1, 10, 20, 30, 5.0),
        *(message(address, "iiffffffd", 0, 1, *[0.0] * 6, 5.0) for address in ("/face", "/face_animation")),
    )
