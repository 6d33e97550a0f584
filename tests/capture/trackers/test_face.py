"""Channels of drawn faces whose openings are known, and of the frames that follow each other."""

from contextlib import closing

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from capture.trackers.face import FACE_CHANNELS, NEUTRAL_SECONDS, FaceChannels, FaceMesh, HeadDirection, axes, measures

from .drawn_faces import draw, turn

MOUTH, SMILE, BLINK, BROW = (FACE_CHANNELS.index(name) for name in ("mouth_open", "smile", "blink_left", "brow_up"))
NEUTRAL = np.array([0.0, 0.6, 0.0, 0.3, 0.3, 0.32])
RATE = 30


@pytest.fixture
def mesh(camera):
    with closing(FaceMesh()) as mesh:
        yield mesh


def channels_of(mesh, faces, **view):
    """Return the channels (n, 6) of faces that follow the neutral face, each shown for a fifth of a second."""
    channels, rows = FaceChannels(), []
    seconds = [NEUTRAL_SECONDS + 0.1, *[0.2] * len(faces)]
    for face, start, shown in zip([{}, *faces], np.cumsum([0.0, *seconds]), seconds, strict=False):
        image = draw(**face, **view)
        for time in np.arange(start, start + shown, 1 / RATE):
            found = channels.step(time, measures(mesh.find(image)))
        rows.append(list(found.values()))
    return np.array(rows[1:])


@pytest.mark.slow
@pytest.mark.parametrize(("yaw", "size", "least"), [(0, 240, 0.95), (0, 120, 0.95), (-30, 240, 0.85), (30, 120, 0.85)])
def test_channels_of_drawn_faces_follow_their_openings(mesh, yaw, size, least):
    part = np.array([0.0, 0.5, 1.0, 0.2, 0.8, 0.0])
    for name, most, channel in (("opening", 3.0, MOUTH), ("smile", 0.8, SMILE), ("brow", 0.6, BROW)):
        found = channels_of(mesh, [{name: value} for value in most * part], yaw=yaw, size=size)
        assert np.corrcoef(found[:, channel], part)[0, 1] >= least, name
        assert found[[0, -1]].max() <= 0.05, name


@pytest.mark.slow
@pytest.mark.parametrize("yaw", [0, -30, 30])
def test_an_eye_that_blinks_is_told_from_the_other(mesh, yaw):
    found = channels_of(mesh, [{"blink": blink} for blink in ((1, 0), (0, 1), (0, 0), (1, 1))], yaw=yaw)
    assert_array_equal(found[:, BLINK : BLINK + 2] > 0.5, [[1, 0], [0, 1], [0, 0], [1, 1]])


@pytest.mark.slow
@pytest.mark.parametrize("view", [(-45, 0, 0), (-30, -15, 20), (20, 15, 10), (45, 0, 0), (0, 30, 0), (0, -30, 0)])
def test_the_axes_of_a_head_turn_as_the_drawn_one(mesh, view):
    straight = axes(mesh.find(draw(size=240)), np.array([0.0, 0, 1]))
    names = dict(zip(("yaw", "pitch", "roll"), view, strict=True))
    found = axes([mesh.find(draw(**names, size=240)) for _ in range(2)][-1], np.array([0.0, 0, 1])) @ straight.T
    wanted = (image := np.diag([-1.0, -1, -1])) @ turn(**names) @ image
    assert np.degrees(np.linalg.norm(Rotation.from_matrix(found @ wanted.T).as_rotvec())) < 8


def test_a_face_that_looks_straight_ahead_at_the_edge_of_the_image_does_not_look_at_the_sensor():
    """Its landmarks are seen as of a head that is turned by the angle of the ray."""
    landmarks = np.zeros((468, 3))
    landmarks[[33, 127], 0], landmarks[[263, 356], 0], landmarks[10, 1], landmarks[152, 1] = -1, 1, -1, 1
    assert_allclose(axes(landmarks, np.array([0.0, 0, 1])), np.eye(3), atol=1e-12)
    seen = landmarks @ Rotation.from_rotvec([0, -0.5, 0]).as_matrix().T
    assert_allclose(axes(seen, np.array([-np.tan(0.5), 0, 1])), np.eye(3), atol=1e-12)
    seen = landmarks @ Rotation.from_rotvec([-0.3, 0, 0]).as_matrix().T
    assert_allclose(axes(seen, np.array([0, np.tan(0.3), 1])), np.eye(3), atol=1e-12)


def test_the_bone_to_the_head_turns_with_the_face_and_keeps_its_mean_direction():
    head, bone = HeadDirection(), np.array([0.0, 0.3, -0.1])
    assert_allclose(head.turned(bone, np.eye(3)), bone)
    nod = Rotation.from_rotvec([-0.4, 0, 0]).as_matrix()
    for _ in range(2000):
        found = head.turned(nod @ bone, nod)
    assert_allclose(found, nod @ bone)
    assert_allclose(head.turned(2 * bone, np.eye(3)), 2 * bone, rtol=0.01)


def test_a_face_upside_down_or_of_no_person_has_no_landmarks(mesh):
    assert mesh.find(np.full((200, 200, 3), 128, np.uint8)) is None
    assert mesh.find(np.ascontiguousarray(draw()[::-1])) is None


def test_channels_are_unknown_before_the_neutral_face_follow_a_blink_of_0_1_s_and_fall_to_zero_without_a_face():
    channels, shut = FaceChannels(), NEUTRAL * np.where(np.isin(np.arange(6), (3, 4)), 0.1, 1)
    assert channels.step(0.0, NEUTRAL) == {}
    channels.step(NEUTRAL_SECONDS, NEUTRAL)
    blinks = [channels.step(NEUTRAL_SECONDS + k / RATE, shut) for k in range(1, 4)][-1]
    assert min(blinks["blink_left"], blinks["blink_right"]) > 0.5
    channels.step(NEUTRAL_SECONDS + 1, NEUTRAL + np.eye(6)[MOUTH])
    gone = [channels.step(NEUTRAL_SECONDS + 1 + k / RATE, None)["mouth_open"] for k in range(1, 30)]
    assert gone[0] > 0.7
    assert (np.diff(gone) < 0).all()
    assert gone[-1] < 0.01
