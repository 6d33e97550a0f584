import numpy as np
import pytest

from capture.skeleton import JOINT_INDEX

JOINT_NAMES = {"Head": "head", "Neck": "shoulder_center", "Torso": "spine", "Pelvis": "hip_center"} | {
    f"{side}_{part}": f"{part}_{side}".lower()
    for side in ("Left", "Right")
    for part in ("Shoulder", "Elbow", "Wrist", "Hand", "Hip", "Knee", "Ankle", "Foot")
}


def _joints(pose, osc_message, address="{}", extra=()):
    for name, ours in JOINT_NAMES.items():
        x, y, z = pose[JOINT_INDEX[ours]]
        yield osc_message(address.format(name), "fff" + "f" * len(extra), -x, y, -z, *extra)


@pytest.mark.parametrize(
    ("address", "user"),
    [("{}", 0), ("/skeleton_{}", 0), ("{}_2", 2), ("{}12", 12), ("2/{}", 2), ("/3_{}", 3), ("User 4/{}", 4)],
)
def test_a_walk_is_received_from_any_address(listen, walk, osc_message, address, user):
    wire = listen()
    for pose in walk[:3]:
        frame = wire.frame(*_joints(pose, osc_message, address), osc_message("NI_mate_sync", "i", 1))
        assert frame.user == user
        np.testing.assert_allclose(frame.positions, pose, atol=1e-6)
        assert frame.confidence.tolist() == [1.0] * 20
    assert not wire.source.counts.refused


@pytest.mark.parametrize("extra", [(0.5, 0.5, 0.5, 0.5), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)])
def test_orientations_behind_a_position_are_not_needed(listen, walk, osc_message, extra):
    frame = listen().frame(*_joints(walk[0], osc_message, extra=extra), osc_message("/NI_mate_sync", "f", 1.0))
    np.testing.assert_allclose(frame.positions, walk[0], atol=1e-6)


def test_the_sync_ends_the_frames_of_all_performers_though_joints_are_missing(listen, osc_message):
    wire = listen()
    head = {user: osc_message(f"Head_{user}", "fff", -0.25, 1.0, -2.0) for user in (1, 2)}
    hand = osc_message("Left_Hand_1", "fff", 0.5, 1.0, -2.0)
    sync = osc_message("NI_mate_sync", "i", 1)
    assert {frame.user for frame in wire.events(head[1], hand, head[2], sync, count=2)} == {1, 2}
    frames = wire.events(head[1], head[2], sync, count=2)
    assert [np.flatnonzero(frame.confidence).tolist() for frame in frames] == [[JOINT_INDEX["head"]]] * 2
    assert frames[0].positions[JOINT_INDEX["head"]].tolist() == [0.25, 1.0, 2.0]


def test_millimetres_are_detected_by_their_size(listen, osc_message):
    frame = listen().frame(osc_message("Head", "fff", -250.0, 1000.0, -2000.0))
    assert frame.positions[JOINT_INDEX["head"]].tolist() == [0.25, 1.0, 2.0]


def test_messages_without_positions_are_ignored_and_unknown_joints_refused(listen, osc_message):
    wire = listen()
    wire.settle(osc_message("Head", "ffff", 1.0, 0.0, 0.0, 0.0), osc_message("Chest", "fff", 0.0, 1.0, 2.0))
    assert not wire.source.counts.refused
    wire.settle(
        osc_message("skeleton", "f" * 45, *[0.0] * 45),
        osc_message("@bpy.data.objects['Cube']", "f", 1.0),
        osc_message("?bpy.ops.render.render()", "f", 1.0),
        osc_message("NI mate", "s", "quit"),
        osc_message("Head", "ff", 1.0, 2.0),
        osc_message("Head", "fsf", 1.0, "2", 3.0),
    )
    assert wire.source.counts.refused == {"unknown message": 4, "wrong arguments": 2}
