import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.events import Lost
from capture.network.osc import bundle
from capture.skeleton import JOINT_INDEX, mirrored

from .conftest import FIFTEEN, WALK, assert_of_fifteen, known, message, message_of, osceleton


def _on_screen(millimetres):
    x, y, z = millimetres
    return (1280 - x) / 2560, (960 - y) / 1920, z * 7.8125 / 10000


LAYOUTS = {
    "default": lambda name, place: ("/joint", "sifff", name, 2, *place),
    "quartz": lambda name, place: (f"/joint/{name}/2", "fff", *place),
    "doubles": lambda name, place: ("/joint", "shddd", name, 2, *place),
    "animata": lambda name, place: ("/joint", "sff", f"{name}2", *place[:2]),
    "flat quartz": lambda name, place: (f"/joint/{name}/2", "ff", *place[:2]),
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("scale", [_on_screen, tuple])
@pytest.mark.parametrize("mirror", [True, False])
def test_a_walk_is_received_and_without_depth_it_is_flat(listen, layout, scale, mirror):
    """If `mirror` is false, the image is mirrored and NiTE names the sides correctly. If it is true, NiTE sees the
    camera's view, in which the performer's right is on the left, and swaps the names.
    """
    wire = listen("" if mirror else "?mirrored=0")
    for pose in WALK:
        seen = 1000 * (mirrored(pose) if mirror else pose)
        joints = [message(*LAYOUTS[layout](name, scale(seen[JOINT_INDEX[ours]]))) for name, ours in FIFTEEN.items()]
        frame = wire.frame(bundle(*joints))
        assert frame.user == 2
        flat = layout in ("animata", "flat quartz")
        assert_of_fifteen(frame.positions, frame.confidence, pose * [1, 1, 0] + [0, 0, 2.5] if flat else pose)
    assert not wire.source.counts.refused


def test_joints_equal_values_by_hand(listen):
    frame = listen().frame(bundle(osceleton("head", 1, 0.375, 0.25, 1.5625), osceleton("l_elbow", 1, 0.25, 0.5, 1.25)))
    places = known(frame)
    assert places.keys() == {"head", "elbow_right"}
    assert_allclose([*places.values()], [[-0.32, 0.48, 2.0], [-0.64, 0.0, 1.6]], atol=1e-15)
    assert np.isnan(frame.positions[frame.confidence == 0]).all()


@pytest.mark.parametrize(
    ("options", "expected"), [("units=m", [0.5, 1.0, 2.0]), ("units=mm&flip=xz", [-0.0005, 0.001, -0.002])]
)
def test_units_can_be_configured_if_the_numbers_are_ambiguous(listen, options, expected):
    frame = listen(f"?mirrored=0&{options}").frame(bundle(osceleton("head", 1, 0.5, 1.0, 2.0)))
    assert_allclose(known(frame)["head"], expected, rtol=1e-15)


def test_orientations_centres_of_mass_and_unused_joints_are_ignored(listen):
    wire = listen()
    joints = [osceleton(name, 3, 0.5, 0.5, 1.0) for name in ("l_collar", "l_fingertip", "r_finger", "head")]
    turns = message("/orient", "si" + 9 * "f", "head", 3, *[0.0] * 9), message("/orient/head/3", 9 * "f", *[0.0] * 9)
    users = message("/new_user", "i", 3), message("/new_skel", "i", 3), message("/user/3", "fff", 0.5, 0.5, 1.0)
    # in any case, and a string of another type
    joints.append(osceleton("L_Collar", 3, 0.5, 0.5, 1.0).replace(b",s", b",S"))
    frame = wire.frame(*users, bundle(*turns, *joints))
    assert known(frame).keys() == {"head"}
    assert not wire.source.counts.refused


def test_a_lost_performer_is_reported_once_and_only_if_there_was_one(listen):
    wire, head, gone = listen(), bundle(osceleton("head", 3, 0.5, 0.5, 1.0)), message("/lost_user", "i", 3)
    frame = wire.frame(head)
    [lost] = wire.events(message("/lost_user", "i", 4), gone, gone)
    assert (type(lost), lost.user) == (Lost, 3)
    assert wire.frame(head).time > lost.time > frame.time


def test_a_hand_alone_has_a_scale_of_its_own_and_no_number(listen):
    wire = listen("?mirrored=0")
    hand = osceleton("l_hand", 0, (480 - 96) / 960, (320 - 160) / 640, 0.78125)
    frame = wire.frame(message("/new_user", ""), bundle(hand))
    assert_allclose(known(frame)["hand_left"], [0.096, 0.16, 1.0], atol=1e-7)
    [lost] = wire.events(message("/lost_user", ""))
    assert lost.user == 0


REFUSED = {
    "unknown joint": ["/joint sifff tail 1 0.5 0.5 1", "/joint sff l_shoulder1x 0.5 0.5"],
    "unknown message": ["/joint siff head 1 0.5 0.5"],
    "wrong arguments": [
        *("/joint shfff head 2147483648 0.5 0.5 1", "/lost_user s 1", "/lost_user ii 1 2", "/lost_user f 1")
    ],
}


def test_unknown_joints_and_lost_performers_without_a_number_are_refused(listen):
    lines = [line for each in REFUSED.values() for line in each]
    assert listen().refused(*map(message_of, lines)) == {reason: len(each) for reason, each in REFUSED.items()}
