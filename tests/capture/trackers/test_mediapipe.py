"""MediaPipe on real images, with landmarks of a reference."""

import logging
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture import body
from capture.skeleton import JOINT_INDEX, JOINTS, OPPOSITE, PARENTS
from capture.trackers.mediapipe import LANDMARK_WEIGHTS, LOST_SECONDS, MediaPipePose
from capture.trackers.picture import Lens, Picture
from puppetline.errors import SourceError

from ..conftest import refused
from .conftest import HEIGHT

LENS = Lens(320, 240, 260.0)
RATE = 5  # images per second of the clip


@pytest.fixture
def tracker(camera):
    tracker = MediaPipePose()
    yield tracker
    tracker.close()


def joint(squats, name):
    """Return a joint, or the mean of both sides'."""
    names = [name] if name in JOINT_INDEX else [f"{name}_left", f"{name}_right"]
    return squats[:, [JOINT_INDEX[each] for each in names]].mean(axis=1)


def test_every_joint_is_a_mean_of_landmarks_and_both_sides_are_symmetric():
    assert_allclose(LANDMARK_WEIGHTS.sum(axis=1), 1)
    assert LANDMARK_WEIGHTS.min() == 0
    other_side = [0, 4, 5, 6, 1, 2, 3, 8, 7, 10, 9, *(k + 1 if k % 2 else k - 1 for k in range(11, 33))]
    assert_array_equal(LANDMARK_WEIGHTS[OPPOSITE], LANDMARK_WEIGHTS[:, other_side])


def test_projected_joints_are_where_the_reference_has_them(squats, clip):
    pictures, pixels, _ = clip
    error = np.linalg.norm(pictures[0].lens.project(squats) - pixels, axis=-1)
    tall = np.ptp(pixels[0, :, 1])
    assert np.median(error) < 0.01 * tall
    assert np.percentile(error, 95) < 0.03 * tall


def test_the_performer_has_the_given_height_bones_that_keep_their_lengths_and_feet_that_stay(squats):
    children, parents = ([JOINT_INDEX[name] for name in names] for names in (PARENTS, PARENTS.values()))
    lengths = np.linalg.norm(squats[:, children] - squats[:, parents], axis=-1)[RATE:]
    assert_allclose(lengths / np.median(lengths, axis=0), 1, atol=0.1)
    crown = joint(squats, "head")[:, 1] + body.HEAD_TOP_METRES
    soles = joint(squats, "ankle")[:, 1] - body.ANKLE_HEIGHT_METRES
    assert_allclose(np.sort(crown - soles)[-10:], HEIGHT, rtol=0.05)
    sunk, stay = (np.ptp(joint(squats, name)[RATE:, 1]) for name in ("hip_center", "ankle"))
    assert sunk > 0.3
    assert stay < sunk / 2


def test_knees_bend_as_in_the_reference(squats, clip):
    """Compare the angle at the knees, because the reference has another scale."""

    def bend(joints):
        hip, knee, ankle = (joints[:, JOINT_INDEX[f"{name}_left"]] for name in ("hip", "knee", "ankle"))
        thigh, shin = hip - knee, ankle - knee
        cosine = (thigh * shin).sum(axis=1) / np.linalg.norm(thigh, axis=1) / np.linalg.norm(shin, axis=1)
        return np.degrees(np.arccos(cosine))

    ours, theirs = bend(squats), bend(clip[2])
    assert np.ptp(theirs) > 60
    assert np.corrcoef(ours, theirs)[0, 1] > 0.95
    assert np.median(np.abs(ours - theirs)) < 10


def test_depth_determines_the_scale(squats, clip):
    """The same image with a flat depth of twice the distance shows a performer of twice the height."""
    picture, distance = clip[0][0], 2 * float(squats[0, 0, 2])
    board = np.full(picture.color.shape[:2], distance, np.float32)
    with closing(MediaPipePose(HEIGHT)) as tracker:
        (person,) = tracker.track(replace(picture, measured=board))
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
    assert_array_equal(missed.positions, first.positions)
    assert caplog.messages == ["MediaPipe pose: the image is black: uncover the lens, or switch on the light"]
    (again,) = shown(2.0, picture.color)
    assert again.user == first.user + 1


def test_absence_is_logged_once(tracker, caplog):
    room = np.random.default_rng(1).integers(90, 160, (240, 320, 3), dtype=np.uint8)
    with caplog.at_level(logging.WARNING):
        assert [tracker.track(Picture(k / 30, LENS, room, None)) for k in range(3)] == [[]] * 3
    assert caplog.messages == ["MediaPipe pose: no performer is in view, or too little of the body"]


def test_a_face_upside_down_is_not_measured_and_logged_once_and_it_comes_back(clip, camera, caplog):
    picture = clip[0][0]
    upside_down = np.ascontiguousarray(picture.color[::-1, ::-1])
    shown = [upside_down] * 4 + [picture.color] * 3
    with closing(MediaPipePose(face=True)) as tracker:
        people = [tracker.track(replace(picture, time=k / RATE, color=color)) for k, color in enumerate(shown)]
    assert {person.orientations is None for each in people[:4] for person in each} == {True}
    assert people[-1][0].orientations is not None
    said = "MediaPipe pose: the face is upside down and not measured: turn the camera or the video"
    assert caplog.messages.count(said) == 1


def test_depth_that_fails_late_also_without_a_performer_and_an_image_without_colours_are_errors(tracker):
    late = SourceError("realsense:", found="images", expected="aligned ones", fix="Plug it in again.")

    def depth():
        raise late

    assert refused(tracker.track, Picture(0.0, LENS, np.full((240, 320, 3), 120, np.uint8), depth)) is late
    refused(tracker.track, Picture(0.0, LENS, None, np.ones((240, 320), np.float32)))
