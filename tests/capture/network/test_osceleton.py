import numpy as np
import pytest

from capture.events import Lost
from capture.skeleton import JOINT_INDEX, OPPOSITE

MIRROR = np.array([-1.0, 1.0, 1.0])


def _nite(pose, name, *, mirror):
    """Return NiTE's measurement of one of its joints in millimetres.

    If `mirror` is false, the image is mirrored and NiTE names the sides correctly. If it is true, NiTE sees the
    camera's view, in which the performer's right is on the left, and swaps the names.
    """
    joint = JOINT_INDEX[name]
    return 1000 * (pose[OPPOSITE[joint]] * MIRROR if mirror else pose[joint])


def _on_screen(millimetres):
    x, y, z = millimetres
    return (1280 - x) / 2560, (960 - y) / 1920, z * 7.8125 / 10000


def _raw(millimetres):
    return tuple(millimetres)


LAYOUTS = {
    "default": lambda name, user, place: ("/joint", "sifff", name, user, *place),
    "quartz": lambda name, user, place: (f"/joint/{name}/{user}", "fff", *place),
    "doubles": lambda name, user, place: ("/joint", "shddd", name, user, *place),
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("scale", [_on_screen, _raw])
@pytest.mark.parametrize("mirror", [True, False])
def test_a_walk_is_received(listen, walk, fifteen, assert_of_fifteen, osc_message, osc_bundle, layout, scale, mirror):
    wire = listen("" if mirror else "?mirrored=0")
    for pose in walk:
        joints = [
            osc_message(*LAYOUTS[layout](name, 7, scale(_nite(pose, ours, mirror=mirror))))
            for name, ours in fifteen.items()
        ]
        assert_of_fifteen(wire.frame(osc_bundle(*joints)), 7, pose)
    assert not wire.source.counts.refused


@pytest.mark.parametrize("scale", [_on_screen, _raw])
@pytest.mark.parametrize("layout", ["animata", "flat quartz"])
def test_a_walk_without_depth_is_flat(listen, walk, fifteen, assert_of_fifteen, osc_message, osc_bundle, scale, layout):
    wire = listen()
    for pose in walk:
        joints = []
        for name, ours in fifteen.items():
            x, y, _ = scale(_nite(pose, ours, mirror=True))
            kitchen = ("/joint", "sff", f"{name}2", x, y)
            joints.append(osc_message(*kitchen if layout == "animata" else (f"/joint/{name}/2", "ff", x, y)))
        assert_of_fifteen(wire.frame(osc_bundle(*joints)), 2, pose * [1, 1, 0] + [0, 0, 2.5])


def test_one_joint_equals_values_by_hand(listen, osc_message, osc_bundle):
    head = osc_message("/joint", "sifff", "head", 1, 0.375, 0.25, 1.5625)
    left = osc_message("/joint", "sifff", "l_elbow", 1, 0.25, 0.5, 1.25)
    frame = listen().frame(osc_bundle(head, left))
    known = [JOINT_INDEX["head"], JOINT_INDEX["elbow_right"]]
    assert np.flatnonzero(frame.confidence).tolist() == known
    np.testing.assert_allclose(frame.positions[known], [[-0.32, 0.48, 2.0], [-0.64, 0.0, 1.6]], atol=1e-15)
    assert np.isnan(frame.positions[frame.confidence == 0]).all()


def test_units_can_be_configured_if_the_numbers_are_ambiguous(listen, osc_message, osc_bundle):
    head = osc_bundle(osc_message("/joint", "sifff", "head", 1, 0.5, 1.0, 2.0))
    place = listen("?units=m&mirrored=0").frame(head).positions[JOINT_INDEX["head"]]
    assert place.tolist() == [0.5, 1.0, 2.0]
    place = listen("?units=mm&mirrored=0&flip=xz").frame(head).positions[JOINT_INDEX["head"]]
    np.testing.assert_allclose(place, [-0.0005, 0.001, -0.002], rtol=1e-15)


def test_orientations_centres_of_mass_and_unused_joints_are_ignored(listen, osc_message, osc_bundle):
    wire = listen()
    frame = wire.frame(
        osc_message("/new_user", "i", 3),
        osc_bundle(osc_message("/user/3", "fff", 0.5, 0.5, 1.0)),
        osc_message("/new_skel", "i", 3),
        osc_bundle(
            osc_message("/orient", "sifffffffff", "head", 3, *[0.0] * 9),
            osc_message("/orient/head/3", "fffffffff", *[0.0] * 9),
            *(
                osc_message("/joint", "sifff", name, 3, 0.5, 0.5, 1.0)
                for name in ("l_collar", "l_fingertip", "r_finger")
            ),
            osc_message("/joint", "sifff", "head", 3, 0.5, 0.5, 1.0),
        ),
    )
    assert np.flatnonzero(frame.confidence).tolist() == [JOINT_INDEX["head"]]
    assert not wire.source.counts.refused


def test_a_lost_performer_is_reported_once_and_only_if_there_was_one(listen, osc_message, osc_bundle):
    wire = listen()
    head = osc_bundle(osc_message("/joint", "sifff", "head", 3, 0.5, 0.5, 1.0))
    gone = osc_message("/lost_user", "i", 3)
    frame = wire.frame(head)
    [lost] = wire.events(osc_message("/lost_user", "i", 4), gone, gone)
    assert isinstance(lost, Lost)
    assert lost.user == 3
    assert lost.time > frame.time
    assert wire.frame(head).time > lost.time


def test_a_hand_alone_has_a_scale_of_its_own_and_no_number(listen, osc_message, osc_bundle):
    wire = listen("?mirrored=0")
    hand = osc_message("/joint", "sifff", "l_hand", 0, (480 - 96) / 960, (320 - 160) / 640, 0.78125)
    frame = wire.frame(osc_message("/new_user", ""), osc_bundle(hand))
    np.testing.assert_allclose(frame.positions[JOINT_INDEX["hand_left"]], [0.096, 0.16, 1.0], atol=1e-7)
    [lost] = wire.events(osc_message("/lost_user", ""))
    assert lost.user == 0


@pytest.mark.parametrize(
    ("tags", "arguments", "reason"),
    [
        ("sifff", ("tail", 1, 0.5, 0.5, 1.0), "unknown joint"),
        ("sff", ("l_shoulder1x", 0.5, 0.5), "unknown joint"),
        ("sff", ("", 0.5, 0.5), "unknown joint"),
        ("siff", ("head", 1, 0.5, 0.5), "unknown message"),
        ("shfff", ("head", 2**31, 0.5, 0.5, 1.0), "wrong arguments"),
    ],
)
def test_unknown_joints_are_refused(listen, osc_message, tags, arguments, reason):
    wire = listen()
    assert wire.settle(osc_message("/joint", tags, *arguments)) == []
    assert wire.source.counts.refused == {reason: 1}


@pytest.mark.parametrize(("tags", "arguments"), [("s", ("1",)), ("ii", (1, 2)), ("f", (1.0,))])
def test_a_lost_performer_without_a_number_of_its_own_is_refused(listen, osc_message, tags, arguments):
    wire = listen()
    wire.settle(osc_message("/lost_user", tags, *arguments))
    assert wire.source.counts.refused == {"wrong arguments": 1}
