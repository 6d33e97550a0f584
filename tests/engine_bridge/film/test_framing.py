"""Framing: everything that a camera shows is in the picture."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from engine_bridge.character import examples
from engine_bridge.film import scene as scenes
from engine_bridge.film.framing import HEAD_ROOM, SIDE_ROOM, Extent, Shots, framed
from engine_bridge.film.production import CROWN_SHARE, UPPER_SHARE, produce
from engine_bridge.film.scene import CameraTable
from engine_bridge.pictures.camera import Camera

from ..conftest import in_picture
from .conftest import placed, quiet

SIZE = (1280, 720)

LARGE = ("biped", "pegasus")
"""Examples with many vertices: to frame these takes longer than to frame all others."""


@given(st.integers(0, 1000), st.floats(-180, 180), st.floats(0, 80), st.floats(10, 90))
def test_the_nearest_camera_shows_all_points_with_room_around_them(seed, azimuth, elevation, field):
    points = np.random.default_rng(seed).normal(size=(12, 3)) * [2, 1, 1]
    a, e = np.radians([azimuth, elevation])
    towards = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    target, eye = framed(points, towards, field, SIZE)
    shown, room = in_picture(Camera(eye, target, field), points, SIZE), [SIDE_ROOM, HEAD_ROOM]
    left = np.concatenate([shown.min(axis=0) - room, 1 - np.array(room) - shown.max(axis=0)])
    assert (left >= -1e-4).all()
    is_outside = np.linalg.norm(eye - target) > (points - target).dot(towards).max() + 0.01
    if is_outside:  # else that is all that the eye has to be
        assert (np.abs(left) < 1e-3).sum() >= 2  # no camera is nearer


def boxes(frames, x):
    """A box of 1 m that is at x(k), or always at x, in frame k, with a head that fills it."""
    middle = np.array([[x(k) if callable(x) else x, 0.5, 0] for k in range(frames)])
    return Extent(*[np.stack([middle - 0.5, middle + 0.5], axis=1)] * 3)


BOTH = {"a": boxes(60, -3), "b": boxes(60, 3)}


def camera(shots, frame):
    """Return the only camera of a frame."""
    (only,) = shots.views(frame)
    assert only.share == 1
    return only.camera


def test_a_camera_that_follows_stays_nearer_and_moves_smoothly():
    walk = boxes(300, lambda k: 0 if k < 100 else min(k - 100, 100) / 20)
    still = Shots((), {"a": walk}, 30, SIZE)
    follow = Shots((CameraTable(shot="follow"),), {"a": walk}, 30, SIZE)
    cameras = [camera(follow, frame) for frame in range(300)]
    eyes, wide = np.array([each.eye for each in cameras]), camera(still, 0)
    assert eyes[:, 1].std() == 0
    assert (wide.eye == camera(still, 299).eye).all()
    assert np.linalg.norm(eyes[0] - cameras[0].target) < np.linalg.norm(wide.eye - wide.target)
    assert np.abs(np.diff(eyes, axis=0, n=2)).max() < 0.2 * 0.05  # a step of 5 cm per frame begins within many frames
    shown = np.array([in_picture(cameras[frame], walk.whole[frame], SIZE) for frame in range(0, 300, 7)])
    assert ((shown > 0) & (shown < 1)).all()


def test_a_cross_fade_mixes_both_cameras():
    shots = Shots((CameraTable(show=("a",)), CameraTable(at=1.0, show=("b",), fade=0.3)), BOTH, 30, SIZE)
    shares = [[view.share for view in shots.views(frame)] for frame in range(29, 41)]
    assert shares == [[1.0], *([1 - k / 10, k / 10] for k in range(1, 10)), [1.0], [1.0]]
    before, after = shots.views(33)
    assert (before.shot, after.shot) == (0, 1)
    assert (before.camera.eye == camera(shots, 29).eye).all()
    assert (after.camera.eye == camera(shots, 39).eye).all()


def test_without_an_azimuth_nobody_else_stands_in_the_way():
    both = {
        "a": boxes(9, 0),
        "b": Extent(*(np.add(each, [0.6, 0, 2.2]) for each in boxes(9, 0))),
    }  # in front, to the right
    assert camera(Shots((CameraTable(show=("a",)),), both, 30, SIZE), 0).eye[0] < 0
    behind = camera(Shots((CameraTable(show=("a",), shot="over the shoulder"),), both, 30, SIZE), 0)
    looks = (behind.target - behind.eye)[[0, 2]]
    assert looks[1] < 0  # from b, which is in front of a, towards a
    cosine = looks @ [-0.6, -2.2] / np.linalg.norm(looks) / np.hypot(0.6, 2.2)
    assert 17 < np.degrees(np.arccos(cosine)) < 29  # past a shoulder, not through the head
    assert behind.eye[2] > 2.2


def test_a_character_without_an_extent_does_not_count_where_views_are_compared():
    front = Extent(*np.tile([[-0.1, 0, 1.4], [0.1, 1, 1.6]], (3, 5, 1, 1)))
    both = {"a": boxes(5, 0), "front": front}
    point = {"point": Extent(*np.zeros((3, 5, 2, 3)))}
    alone = Shots((CameraTable(show=("a",)),), both, 30, SIZE)
    assert_allclose(
        camera(Shots((CameraTable(show=("a", "point")),), both | point, 30, SIZE), 0).eye, camera(alone, 0).eye
    )


def outside(production):
    """Return how many of all vertices of all frames that the shots are for are outside the picture."""
    shots = Shots(production.scene.camera, production.extents(quiet), production.fps, SIZE)
    begins = [round(table.at * production.fps) for table in production.scene.camera[1:]]
    count = 0
    for actor in production.actors:
        up = actor.prepared.character.vertices @ actor.footing.basis[1]
        crown = up > up.min() + CROWN_SHARE * np.ptp(up)
        for frame, vertices in enumerate(placed(actor, range(production.frames))):
            table = production.scene.camera[int(np.searchsorted(begins, frame, side="right"))]
            if table.show and actor.name not in table.show:
                continue
            if table.shot == "close":
                high = vertices[:, 1] > vertices[:, 1].max() - UPPER_SHARE * actor.footing.height
                vertices = vertices[crown | high]
            shown = in_picture(shots.views(frame)[-1].camera, vertices, SIZE)
            count += ((shown < 0) | (shown > 1)).any(axis=1).sum()
    return count


@pytest.mark.parametrize("seed", range(20))
def test_no_vertex_of_whom_a_shot_shows_is_outside_the_picture_in_any_frame(produced, seed):
    """Twenty scenes that are made at random."""
    rng = np.random.default_rng(seed)
    text = "[film]\nfps = 10\n"
    names = ["a", "b", "c"][: rng.integers(1, 4)]
    for name in names:
        x, z = rng.uniform(-2, 2, 2)
        puppet = rng.choice(["LIMBED", "HANDLES"])
        text += f'[[character]]\nname = "{name}"\npuppet = "{puppet}"\nturn = {rng.uniform(-180, 180)}\n'
        text += f"height = {rng.uniform(0.3, 3)}\n" + (f"position = [{x}, {z}]\n" if rng.random() < 0.6 else "")
        text += f'[[take]]\ncharacter = "{name}"\nfile = "TAKE"\nat = {rng.uniform(0, 0.5)}\n'
    for number, shot in enumerate(rng.permutation(["wide", "close", "follow", "over the shoulder"])):
        show = [str(each) for each in rng.choice(names, rng.integers(1, len(names) + 1), replace=False)]
        show = show if rng.random() < 0.7 or shot == "over the shoulder" else []
        text += f'[[camera]]\nat = {0.5 * number}\nshot = "{shot}"\nshow = {show}\nfade = {rng.choice([0, 0.2])}\n'
        text += f"field_of_view = {rng.uniform(15, 70)}\nelevation = {rng.uniform(0, 40)}\n"
    assert outside(produced(text)) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.exhaustive if name in LARGE else ()) for name in examples.MOTIONS]
)
def test_no_vertex_of_an_example_is_outside_the_picture_in_any_frame(tmp_path, name):
    log, puppet = examples.prepare(name, tmp_path)
    puppet.write_text(f"{puppet.read_text()}\n[solver]\nfields = 5\nisolines = 6\n")  # a quick model
    text = f'[film]\nfps = 10\n[[character]]\nname = "it"\npuppet = "{puppet.name}"\n[[take]]\ncharacter = "it"\n'
    text += (
        f'file = "{log.name}"\n[[camera]]\n[[camera]]\nat = 3\nshot = "follow"\n[[camera]]\nat = 6\nshot = "close"\n'
    )
    (tmp_path / "scene.toml").write_text(text)
    assert outside(produce(tmp_path / "scene.toml", scenes.load(tmp_path / "scene.toml"), quiet)) == 0
