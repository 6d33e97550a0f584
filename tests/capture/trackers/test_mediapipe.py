"""MediaPipe on real images, with landmarks of a reference."""

import json
import logging
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from capture import body
from capture.sensors.camera import Options, Video
from capture.skeleton import JOINT_INDEX, JOINTS, OPPOSITE, PARENTS
from capture.trackers.mediapipe import LANDMARK_WEIGHTS, LOST_SECONDS, MediaPipePose
from capture.trackers.picture import Lens, Picture
from puppetline.errors import SourceError

HEIGHT = 1.65
RATE = 5  # images per second of the clip


@dataclass(frozen=True)
class Squats:
    """A clip of squats, the joints found in it, and joints of the reference landmarks in pixels and in metres."""

    pictures: list[Picture]
    positions: NDArray[np.float32]
    confidence: NDArray[np.float32]
    pixels: NDArray[np.float64]
    world: NDArray[np.float64]


@pytest.fixture(scope="module")
def clip(camera, real_data):
    folder = real_data / "video" / "tfjs"
    video = Video("video:squats", folder / "pose_squats.mp4", Options("squats"))
    pictures = [video.read(1.0) for _ in range(65)]
    video.close()
    reference = [json.loads((folder / f"pose_squats{kind}.full.json").read_text()) for kind in ("", "_3d")]
    return pictures, LANDMARK_WEIGHTS @ np.array(reference[0])[..., :2], LANDMARK_WEIGHTS @ np.array(reference[1])


@pytest.fixture(scope="module")
def squats(clip):
    pictures, pixels, world = clip
    tracker = MediaPipePose(HEIGHT)
    people = [tracker.track(picture) for picture in pictures]
    tracker.close()
    tracker.close()
    assert [[person.user for person in each] for each in people] == [[1]] * len(pictures)
    positions, confidence = (
        np.stack([getattr(each[0], name) for each in people]) for name in ("positions", "confidence")
    )
    return Squats(pictures, positions, confidence, pixels, world)


@pytest.fixture
def tracker(camera):
    tracker = MediaPipePose()
    yield tracker
    tracker.close()


def joint(squats, name):
    return squats.positions[:, JOINT_INDEX[name]]


def test_every_joint_is_a_mean_of_landmarks_and_both_sides_are_symmetric():
    np.testing.assert_allclose(LANDMARK_WEIGHTS.sum(axis=1), 1)
    assert LANDMARK_WEIGHTS.min() == 0
    other_side = [0, 4, 5, 6, 1, 2, 3, 8, 7, 10, 9, *(k + 1 if k % 2 else k - 1 for k in range(11, 33))]
    np.testing.assert_array_equal(LANDMARK_WEIGHTS[OPPOSITE], LANDMARK_WEIGHTS[:, other_side])


def test_projected_joints_are_where_the_reference_has_them(squats):
    lens = squats.pictures[0].lens
    error = np.linalg.norm(lens.project(squats.positions) - squats.pixels, axis=-1)
    tall = np.ptp(squats.pixels[0, :, 1])
    assert np.median(error) < 0.01 * tall
    assert np.percentile(error, 95) < 0.03 * tall


def test_bones_keep_their_lengths_after_the_first_second(squats):
    children, parents = ([JOINT_INDEX[name] for name in names] for names in (PARENTS, PARENTS.values()))
    lengths = np.linalg.norm(squats.positions[:, children] - squats.positions[:, parents], axis=-1)[RATE:]
    np.testing.assert_allclose(lengths / np.median(lengths, axis=0), 1, atol=0.1)


def test_an_upright_performer_has_the_given_height(squats):
    crown = joint(squats, "head")[:, 1] + body.HEAD_TOP_METRES
    soles = (joint(squats, "ankle_left") + joint(squats, "ankle_right"))[:, 1] / 2 - body.ANKLE_HEIGHT_METRES
    upright = np.sort(crown - soles)[-10:]
    np.testing.assert_allclose(upright, HEIGHT, rtol=0.05)


def test_the_performer_faces_the_camera_upright_with_the_right_side_at_positive_x(squats):
    for limb in ("shoulder", "hip", "knee", "ankle"):
        assert (joint(squats, f"{limb}_right")[:, 0] > joint(squats, f"{limb}_left")[:, 0]).all()
    assert (joint(squats, "head")[:, 1] > joint(squats, "hip_center")[:, 1]).all()
    toes = (joint(squats, "foot_left") + joint(squats, "foot_right") - joint(squats, "ankle_left")) - joint(
        squats, "ankle_right"
    )
    assert np.median(toes[:, 2]) < 0


def test_knees_bend_as_in_the_reference(squats):
    """Compare the angle at the knees, because the reference has another scale."""

    def bend(joints):
        hip, knee, ankle = (joints[:, JOINT_INDEX[f"{name}_left"]] for name in ("hip", "knee", "ankle"))
        thigh, shin = hip - knee, ankle - knee
        cosine = (thigh * shin).sum(axis=1) / np.linalg.norm(thigh, axis=1) / np.linalg.norm(shin, axis=1)
        return np.degrees(np.arccos(cosine))

    ours, theirs = bend(squats.positions), bend(squats.world)
    assert np.ptp(theirs) > 60
    assert np.corrcoef(ours, theirs)[0, 1] > 0.95
    assert np.median(np.abs(ours - theirs)) < 10


def test_the_hips_sink_in_a_squat_while_the_feet_stay(squats):
    sunk = np.ptp(joint(squats, "hip_center")[RATE:, 1])
    stay = np.ptp((joint(squats, "ankle_left") + joint(squats, "ankle_right"))[RATE:] / 2, axis=0)
    assert sunk > 0.3
    assert stay[1] < sunk / 2


def test_depth_determines_the_scale(squats, clip):
    """The same image with a flat depth of twice the distance shows a performer of twice the height."""
    picture = clip[0][0]
    distance = float(squats.positions[0, 0, 2]) * 2
    board = np.full(picture.color.shape[:2], distance, np.float32)
    tracker = MediaPipePose(HEIGHT)
    (person,) = tracker.track(replace(picture, measured=board))
    tracker.close()
    assert body.height(person.positions.astype(float)) == pytest.approx(2 * HEIGHT, rel=0.1)
    assert person.positions[0, 2] == pytest.approx(distance, abs=0.15)


def test_a_short_absence_loses_the_joints_and_a_longer_one_the_performer(clip, tracker, caplog):
    picture = clip[0][0]
    black = np.zeros_like(picture.color)

    def shown(time, color):
        return tracker.track(replace(picture, time=time, color=color))

    (first,) = shown(0.0, picture.color)
    with caplog.at_level(logging.WARNING):
        (missed,) = shown(LOST_SECONDS, black)
        assert shown(LOST_SECONDS + 0.01, black) == []
    assert (missed.user, missed.confidence.tolist()) == (first.user, [0.0] * len(JOINTS))
    np.testing.assert_array_equal(missed.positions, first.positions)
    assert caplog.messages == ["MediaPipe pose: the image is black: uncover the lens, or switch on the light"]
    (again,) = shown(2.0, picture.color)
    assert again.user == first.user + 1


def test_absence_is_logged_once(tracker, caplog):
    room = np.random.default_rng(1).integers(90, 160, (240, 320, 3), dtype=np.uint8)
    with caplog.at_level(logging.WARNING):
        assert [tracker.track(Picture(k / 30, Lens(320, 240, 260.0), room, None)) for k in range(3)] == [[]] * 3
    assert caplog.messages == ["MediaPipe pose: no performer is in view, or too little of the body"]


def test_a_face_upside_down_is_not_measured_and_logged_once_and_it_comes_back(clip, camera, caplog):
    tracker, picture = MediaPipePose(face=True), clip[0][0]
    upside_down = np.ascontiguousarray(picture.color[::-1, ::-1])
    shown = [upside_down] * 4 + [picture.color] * 3
    people = [tracker.track(replace(picture, time=k / RATE, color=color)) for k, color in enumerate(shown)]
    tracker.close()
    assert {person.orientations is None for each in people[:4] for person in each} == {True}
    assert people[-1][0].orientations is not None
    said = "MediaPipe pose: the face is upside down and not measured: turn the camera or the video"
    assert caplog.messages.count(said) == 1


def test_depth_that_fails_late_is_an_error_also_without_a_performer(tracker):
    def depth():
        raise SourceError("realsense:", found="images", expected="aligned ones", fix="Plug it in again.")

    with pytest.raises(SourceError, match="expected aligned ones"):
        tracker.track(Picture(0.0, Lens(320, 240, 260.0), np.full((240, 320, 3), 120, np.uint8), depth))


def test_an_image_without_colours_is_an_error(tracker):
    with pytest.raises(SourceError, match="an image without colours"):
        tracker.track(Picture(0.0, Lens(4, 3, 4.0), None, np.ones((3, 4), np.float32)))
