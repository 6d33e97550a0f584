import numpy as np
import pytest

from capture.skeleton import JOINT_INDEX

from .conftest import WALK, known, message, message_of

JOINT_NAMES = {"Head": "head", "Neck": "shoulder_center", "Torso": "spine", "Pelvis": "hip_center"} | {
    f"{side}_{part}": f"{part}_{side}".lower()
    for side in ("Left", "Right")
    for part in ("Shoulder", "Elbow", "Wrist", "Hand", "Hip", "Knee", "Ankle", "Foot")
}
SYNC = message("NI_mate_sync", "i", 1)


def _joint(address, place, *extra):
    x, y, z = place
    return message(address, "fff" + "f" * len(extra), -x, y, -z, *extra)


@pytest.mark.parametrize(
    ("address", "user", "extra"),
    [
        *(("{}", 0, ()), ("/skeleton_{}", 0, ()), ("{}_2", 2, ()), ("{}12", 12, ()), ("2/{}", 2, ()), ("/3_{}", 3, ())),
        *(("User 4/{}", 4, ()), ("{}", 0, (0.5, 0.5, 0.5, 0.5)), ("{}", 0, np.eye(3).flatten().tolist())),
    ],
)
def test_a_walk_is_received_from_any_address_with_or_without_orientations(listen, address, user, extra):
    wire = listen()
    for pose in WALK[:3]:
        joints = (_joint(address.format(name), pose[JOINT_INDEX[ours]], *extra) for name, ours in JOINT_NAMES.items())
        frame = wire.frame(*joints, SYNC)
        assert frame.user == user
        np.testing.assert_allclose(frame.positions, pose, atol=1e-6)
        assert frame.confidence.tolist() == [1.0] * 20
    assert not wire.source.counts.refused


def test_the_sync_ends_the_frames_of_all_performers_though_joints_are_missing(listen):
    wire = listen()
    heads = [_joint(f"Head_{user}", (0.25, 1.0, 2.0)) for user in (1, 2)]
    hand = _joint("Left_Hand_1", (-0.5, 1.0, 2.0))
    assert {frame.user for frame in wire.events(hand, *heads, SYNC, count=2)} == {1, 2}
    frames = wire.events(*heads, SYNC, count=2)
    assert list(map(known, frames)) == [{"head": [0.25, 1.0, 2.0]}] * 2


@pytest.mark.parametrize(("largest", "expected"), [(-20.0, -20.0), (-20.5, -0.0205)])
def test_numbers_beyond_the_reach_of_sensors_are_millimetres(listen, largest, expected):
    assert known(listen().frame(_joint("Head", (0.0, largest, 0.0)), SYNC)) == {"head": [0.0, expected, 0.0]}


def test_messages_without_positions_are_ignored_and_unknown_joints_refused(listen):
    wire = listen()
    assert not wire.refused(message("Head", "ffff", 1.0, 0.0, 0.0, 0.0), message("Chest", "fff", 0.0, 1.0, 2.0))
    assert wire.refused(
        message("skeleton", "f" * 45, *[0.0] * 45),
        message("@bpy.data.objects['Cube']", "f", 1.0),
        message("?bpy.ops.render.render()", "f", 1.0),
        message("NI mate", "s", "quit"),
        *map(message_of, ("Head ff 1 2", "Head fsf 1 2 3")),
    ) == {"unknown message": 4, "wrong arguments": 2}
