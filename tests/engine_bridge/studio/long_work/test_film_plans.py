"""Plans of films for the page: at each frame, what the film itself shows."""

import os

import numpy as np
import pytest

from engine_bridge.film import scene as scenes
from engine_bridge.film.drawing import Canvas
from engine_bridge.film.film import first_frame, make_video
from engine_bridge.film.framing import Shots
from engine_bridge.film.production import produce
from engine_bridge.puppet import puppet_file
from engine_bridge.studio.long_work import film_plans

from ...film.conftest import quiet, write_scene  # noqa: F401 - a fixture

SCENE = """
film = {{ size = [320, 180], fade_in = 0.2 }}

[[character]]
name = "a"
puppet = "LIMBED"
position = [-1, 0]
turn = 30

[[character]]
name = "b"
puppet = "LIMBED"

[[take]]
character = "a"
file = "TAKE"

[[camera]]
show = ["a"]

[[camera]]
at = 0.5
shot = "close"
show = ["b"]
fade = 0.2

[[title]]
text = "One"
at = 0.1
seconds = 0.5
fade = 0.0

[[bubble]]
character = "a"
text = "{words}"
seconds = 0.4
"""


@pytest.fixture
def planned(write_scene):  # noqa: F811
    """Write a scene; return its plan and its production."""

    def make(words="Boo!"):
        path = write_scene(SCENE.format(words=words))
        plan = film_plans.plan_for_page(path, quiet)
        return plan, produce(path, scenes.load(path), quiet)

    return make


def test_every_moment_has_the_cameras_places_titles_and_darkness_of_its_frame(planned):
    plan, production = planned()
    shots = Shots(production.scene.camera, production.extents(quiet), production.fps, plan.size)
    assert plan.step == 1 / production.fps
    assert len(plan.moments) == production.frames
    for frame, moment in enumerate(plan.moments):
        views = shots.views(frame)
        assert [view.shot for view in moment.views] == [view.shot for view in views]
        assert sum(view.share for view in moment.views) == pytest.approx(1, abs=1e-3)
        for view, (camera, _, share) in zip(moment.views, views, strict=True):
            found = *view.eye, *view.target, view.share
            np.testing.assert_allclose(found, [*camera.eye, *camera.target, share], atol=1e-4)
        assert moment.titles == [float(0.1 <= frame / production.fps <= 0.6)]
        assert moment.brightness == pytest.approx(min(frame / (0.2 * production.fps), 1), abs=1e-4)
        for actor in production.actors:
            *position, turn = moment.places[actor.name]
            walked = actor.pose(frame).root @ actor.footing.linear(turn)
            np.testing.assert_allclose(np.add(position, walked), actor.to_stage(frame)[3], atol=1e-3)


def test_a_bubble_is_in_the_picture_while_its_character_says_it(planned):
    plan, production = planned("How do you do?")
    (shape,) = plan.bubbles
    assert " ".join(line for line, _ in shape.lines) == "How do you do?"
    assert 0 < max(width for _, width in shape.lines) < 2 * shape.half[0]
    for frame, moment in enumerate(plan.moments):
        shown = [bubble for view in moment.views for bubble in view.bubbles]
        assert len(shown) == len(moment.views) * (0 < frame / production.fps < 0.4)
        for bubble in shown:
            assert (np.subtract(bubble.middle, shape.half) >= -1e-3).all()
            assert (np.add(bubble.middle, shape.half) <= 1 + 1e-3).all()


def test_only_takes_and_meshes_that_changed_are_solved_again_also_for_the_film_itself(
    planned, limbed_puppet, monkeypatch, tmp_path
):
    before, production = planned()
    monkeypatch.setattr("engine_bridge.film.production.produce", None)
    after, _ = planned("Hello!")
    assert before.bubbles != after.bubbles
    assert [each.places for each in before.moments] == [each.places for each in after.moments]
    made = make_video(production.path, tmp_path / "film.gif", 0.0, 0.2, False, quiet)
    assert (made.frames, made.notes) == (3, production.notes)  # a .gif has at most 15 frames per second
    mesh = limbed_puppet.parent / puppet_file.load(limbed_puppet).character.mesh
    os.utime(mesh, ns=(0, mesh.stat().st_mtime_ns + 1))
    with pytest.raises(TypeError, match="'NoneType' object is not callable"):
        planned()


def test_the_first_frame_is_that_of_the_film(planned, tmp_path, monkeypatch):
    _, production = planned()
    drawn, draw = [], Canvas.draw
    monkeypatch.setattr(Canvas, "draw", lambda *each: drawn.append(draw(*each)) or drawn[-1])
    monkeypatch.setattr("engine_bridge.film.drawing.processor_count", lambda: 1)
    first = first_frame(production.path, quiet)
    make_video(production.path, tmp_path / "film.mp4", 0.0, 0.2, False, quiet)
    np.testing.assert_array_equal(first[..., :3], drawn[1][..., :3])


def test_a_long_film_has_every_nth_frame(planned, monkeypatch):
    whole, production = planned()
    monkeypatch.setattr(film_plans, "MAX_MOMENTS", 10)
    plan, _ = planned()
    step = -(-production.frames // 10)
    assert plan.step == pytest.approx(step / production.fps)
    assert plan.moments == whole.moments[::step]
