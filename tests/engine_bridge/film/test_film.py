"""Films of scene files: frames, sound in step with the picture, parts, drafts, and files that are whole or absent."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character import own_targets
from engine_bridge.film import drawing
from engine_bridge.film import film as films
from engine_bridge.film.drawing import Canvas
from engine_bridge.film.film import make_video
from engine_bridge.film.scene import SceneError
from engine_bridge.film.sound import SAMPLE_RATE
from engine_bridge.film.video import VideoWriter
from puppetline.errors import OutputError

from ..refusals import refused
from .conftest import placed, quiet

av = pytest.importorskip("av", reason="the extra film is not installed")

SCENE = """
[film]
size = [64, 48]
fps = 20

[[character]]
name = "a"
puppet = "LIMBED"
position = [-1, 0]
height = 1.5

[[character]]
name = "b"
puppet = "HANDLES"
position = [1, 0]
height = 1.5

[[take]]
character = "a"
file = "TAKE"

[[take]]
character = "b"
file = "TAKE"
at = 0.5
"""
FRAMES = 10 + 39

SHOTS = """
[[title]]
text = "a"
seconds = 1

[[bubble]]
character = "a"
text = "a"
at = 0.5

[[camera]]

[[camera]]
at = 1
shot = "follow"
fade = 0.5
"""


def read_video(path):
    """Return the frames (n, h, w, 3) of a video, their times, and its sound (n, 2) from time 0 on."""
    with av.open(str(path)) as file:
        frames = [(frame.time, frame.to_ndarray(format="rgb24")) for frame in file.decode(video=0)]
    sound = np.zeros((0, 2))
    with av.open(str(path)) as file:
        if file.streams.audio:
            blocks = list(file.decode(audio=0))
            assert blocks[0].time == pytest.approx(0, abs=1e-3)
            sound = np.concatenate([block.to_ndarray() for block in blocks], axis=1).T
    return np.array([frame for _, frame in frames]), np.array([time for time, _ in frames]), sound


def test_every_frame_of_the_longest_take_is_in_the_video_and_every_second_one_in_a_gif(write_scene, tmp_path):
    path = write_scene(SCENE)
    summary, gif = (make_video(path, tmp_path / name, 0, None, False, quiet) for name in ("film.mp4", "film.gif"))
    film, times, sound = read_video(tmp_path / "film.mp4")
    assert summary.frames == len(film) == FRAMES
    assert film.shape[1:] == (48, 64, 3)
    assert_allclose(times, np.arange(FRAMES) / 20, atol=1e-3)
    assert not len(sound)
    assert np.ptp(film, axis=0).max() > 60  # somebody moves
    frames, _, _ = read_video(tmp_path / "film.gif")
    assert (gif.fps, len(frames)) == (10, FRAMES // 2 + 1)
    assert np.abs(frames[3].astype(int) - film[6]).mean() < 6


@pytest.mark.parametrize(("ending", "start"), [("mp4", 0.5), ("webm", 0.0)])
def test_a_clap_is_heard_when_it_is_seen(write_scene, write_wav, tmp_path, ending, start):
    """A white title of one frame is the clap in the picture."""
    clap = np.zeros(3 * SAMPLE_RATE)
    at = round(1.25 * SAMPLE_RATE)
    clap[at : at + 200] = 0.9 * np.sin(np.arange(200) / 4)
    write_wav(clap)
    text = SCENE.replace("[film]", '[background]\ncolor = "black"\n[floor]\nshow = false\n[film]')
    title = '[[title]]\ntext = "####"\nat = 1.25\nseconds = 0.04\nfade = 0\nsize = 1.0\n'
    path = write_scene(text + title + '[[sound]]\nfile = "sound.wav"\n')
    make_video(path, tmp_path / f"film.{ending}", start, None, False, quiet)
    frames, times, sound = read_video(tmp_path / f"film.{ending}")
    assert_allclose(times, np.arange(len(times)) / 20, atol=1e-3)
    seen = times[frames.mean(axis=(1, 2, 3)).argmax()]
    heard = np.flatnonzero(np.abs(sound[:, 0]) > 0.3)[0] / SAMPLE_RATE
    assert seen == pytest.approx(1.25 - start, abs=1e-3)
    assert heard == pytest.approx(1.25 - start, abs=0.01)


@pytest.mark.slow
def test_a_part_shows_the_same_frames_as_the_whole_film(write_scene, tmp_path, monkeypatch):
    monkeypatch.setattr(drawing, "processor_count", lambda: 1)
    shown = []
    look, draw = films._Frames.__getitem__, Canvas.draw
    monkeypatch.setattr(films._Frames, "__getitem__", lambda frames, frame: (frame, look(frames, frame)))
    monkeypatch.setattr(
        Canvas, "draw", lambda canvas, frame: shown.append((frame[0], draw(canvas, frame[1]))) or shown[-1][1]
    )
    path = write_scene(SCENE + '[[title]]\ntext = "a"\n[[camera]]\nshot = "follow"\n[[camera]]\nat = 1\nshow = ["b"]\n')
    make_video(path, tmp_path / "whole.mp4", 0, None, False, quiet)
    whole, shown[:] = dict(shown), []
    make_video(path, tmp_path / "part.mp4", 0.9, 1.2, False, quiet)
    assert [frame for frame, _ in shown] == list(range(18, 24))
    for frame, pixels in shown:
        assert_array_equal(pixels[..., :3], whole[frame][..., :3])


def test_a_character_is_drawn_where_its_take_has_it_with_its_mouth_open_when_it_speaks(produced, talking, monkeypatch):
    actor = produced(SCENE.replace("LIMBED", str(talking(False)))).actors[0]
    pose = actor.pose(0)
    surface, shown = films._Surface(actor), []
    for frame in (0, 20):
        assert_allclose(surface.at(frame)[0], *placed(actor, [frame]), atol=1e-5)
    for value in (0.0, 1.0, 0.0):
        speaking = replace(pose, channels={"voice": value})
        monkeypatch.setattr(actor, "pose", lambda _, speaking=speaking: speaking)
        shown.append(surface.at(0)[0])
    moved = np.linalg.norm(shown[1] - shown[0], axis=1) / actor.footing.scale
    expected = np.linalg.norm(own_targets.displacements(actor.prepared.character, "jaw"), axis=1)
    assert_allclose(moved, expected, atol=0.05 * expected.max())
    assert_array_equal(shown[2], shown[0])


def test_an_interrupt_leaves_no_file(write_scene, tmp_path):
    calls = itertools.count()

    def stop(step, _share):
        if step == "Filming" and next(calls) == 5:
            raise KeyboardInterrupt

    path = write_scene(SCENE)
    with pytest.raises(KeyboardInterrupt):
        make_video(path, tmp_path / "film.mp4", 0, None, False, stop)
    assert {each.name for each in tmp_path.iterdir()} == {"scene.toml"}


def test_several_threads_draw_the_same_frames_as_one(write_scene, tmp_path, monkeypatch):
    path, add, frames = write_scene(SCENE + SHOTS), VideoWriter.add, {1: [], 3: []}
    for count, drawn in frames.items():

        def keep(writer, pixels, sound, drawn=drawn):
            drawn.append(pixels.copy())
            add(writer, pixels, sound)

        monkeypatch.setattr(drawing, "processor_count", lambda count=count: count)
        monkeypatch.setattr(VideoWriter, "add", keep)
        make_video(path, tmp_path / f"{count}.mp4", 0, None, False, quiet)
    assert len(frames[1]) > 10
    assert_array_equal(np.stack(frames[3])[..., :3], np.stack(frames[1])[..., :3])


@pytest.mark.parametrize(
    ("text", "output", "start", "where", "kind"),
    [
        ('[background]\npicture = "none.png"', "film.mp4", 0, "scene.toml, [background], picture", SceneError),
        ('[[title]]\ntext = "a"\nfont = "none.ttf"', "film.mp4", 0, "scene.toml, [[title]] 1, font", SceneError),
        ("", "film.mp4", 3, "scene.toml", SceneError),
        ("", "film.avi", 0, "film.avi", OutputError),
    ],
)
def test_what_cannot_be_filmed_is_refused_before_the_work(write_scene, tmp_path, text, output, start, where, kind):
    path, steps = write_scene(SCENE + text), []
    error = refused(kind, make_video, path, tmp_path / output, start, None, False, lambda *step: steps.append(step[0]))
    assert error.where.endswith(where)
    assert "Filming" not in steps
