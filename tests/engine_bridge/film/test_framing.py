"""Framing: everything that a camera shows is in the picture."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_bridge.film.framing import HEAD_ROOM, SIDE_ROOM, Shots, framed
from engine_bridge.film.scene import CameraTable
from engine_bridge.pictures.camera import Camera

SIZE = (1280, 720)


def in_picture(camera, points, size=SIZE):
    """Return points (n, 2) as shares of the picture from its top left corner."""
    clip = np.column_stack([points, np.ones(len(points))]) @ camera.matrix(size).astype(float)
    assert (clip[:, 3] > 0).all()
    return clip[:, :2] / clip[:, 3:] / 2 + 0.5


@given(st.integers(0, 1000), st.floats(-180, 180), st.floats(0, 80), st.floats(10, 90))
def test_the_nearest_camera_shows_all_points_with_room_around_them(seed, azimuth, elevation, field):
    points = np.random.default_rng(seed).normal(size=(12, 3)) * [2, 1, 1]
    a, e = np.radians([azimuth, elevation])
    towards = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    target, eye = framed(points, towards, field, SIZE)
    shown = in_picture(Camera(eye, target, field), points)
    low, high = shown.min(axis=0), shown.max(axis=0)
    room = np.array([SIDE_ROOM, HEAD_ROOM])
    assert (low >= room - 1e-4).all()
    assert (high <= 1 - room + 1e-4).all()
    is_outside = np.linalg.norm(eye - target) > (points - target).dot(towards).max() + 0.01
    if is_outside:  # else that is all that the eye has to be
        assert (np.abs(np.concatenate([low - room, 1 - room - high])) < 1e-3).sum() >= 2  # no camera is nearer


def boxes(frames, x):
    """A box of 1 m that is at x(k) in frame k."""
    middle = np.column_stack([[x(k) for k in range(frames)], np.full(frames, 0.5), np.zeros(frames)])
    return np.stack([middle - 0.5, middle + 0.5], axis=1)


def test_a_camera_that_follows_stays_nearer_and_moves_smoothly():
    walk = boxes(300, lambda k: 0 if k < 100 else min(k - 100, 100) / 20)
    still = Shots((), {"a": walk}, 30, SIZE)
    follow = Shots((CameraTable(shot="follow"),), {"a": walk}, 30, SIZE)
    eyes = np.array([follow.camera(frame).eye for frame in range(300)])
    assert eyes[:, 1].std() == 0
    assert (still.camera(0).eye == still.camera(299).eye).all()
    assert np.linalg.norm(eyes[0] - follow.camera(0).target) < np.linalg.norm(
        still.camera(0).eye - still.camera(0).target
    )
    assert np.abs(np.diff(eyes, axis=0, n=2)).max() < 0.2 * 0.05  # a step of 5 cm per frame begins within many frames
    for frame in range(0, 300, 7):
        shown = in_picture(follow.camera(frame), walk[frame])
        assert (shown > 0).all()
        assert (shown < 1).all()


def test_cameras_cut_at_their_times_and_show_whom_they_are_for():
    both = {"a": boxes(60, lambda k: -3), "b": boxes(60, lambda k: 3)}
    shots = Shots((CameraTable(show=("a",)), CameraTable(at=1.0, show=("b",))), both, 30, SIZE)
    assert shots.camera(29).target[0] == pytest.approx(-3, abs=0.3)
    assert shots.camera(30).target[0] == pytest.approx(3, abs=0.3)
    assert (shots.camera(30).eye == shots.camera(59).eye).all()
