"""Takes on the film's clock: what a character does at each frame, and where it stands."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.events import Cue
from capture.sensor_tilt import SensorTilt
from engine_bridge.film.scene import SceneError
from engine_bridge.performance.calibration import Calibration
from engine_bridge.performance.clip import load_timeline, solve
from engine_bridge.performance.settings import Settings
from puppetline.errors import PuppetError, SkeletonLogError

from ..refusals import refused
from .conftest import quiet

CHARACTER = '[[character]]\nname = "a"\npuppet = "LIMBED"\nposition = [1, 2]\nturn = 90\nheight = 1.5\n'
TAKE = '[[take]]\ncharacter = "a"\nfile = "TAKE"\n'


@pytest.fixture
def solved(take):
    """Return the control variables and the roots of the whole take, as `convert` computes them."""

    def of(prepared, log=take):
        return solve(prepared, load_timeline(log, Settings())[0], Settings())

    return of


def test_calibrations_and_mirroring_in_the_middle_of_a_take_are_those_of_convert(
    produced, solved, tmp_path, record_events, frames, dance
):
    first, *others = frames(dance(), 5.0)
    pose = Calibration(first.positions, SensorTilt(0.0, 1.0)).to_json()
    cues = [
        Cue(5.0, "stage", {"characters": {"a": {"user": first.user, "calibration": pose | {"mirror": False}}}}),
        Cue(6.0, "begin", {"character": "a", "calibration": pose | {"mirror": True}}),
    ]
    events = sorted([*cues, first, *others], key=lambda each: each.time)
    log = record_events(tmp_path / "mirrored.log", events)
    actor = produced(CHARACTER + TAKE.replace("TAKE", "mirrored.log")).actors[0]
    expected, plain = (solved(actor.prepared, *logs).R[:] for logs in ([log], []))
    assert np.abs(expected[55] - plain[55]).max() > 0.01
    for frame in (0, 29, 31, 45, 57):
        assert_array_equal(actor.pose(frame).R, expected[frame])


def test_a_part_of_a_take_is_what_convert_makes_of_it_begins_at_its_time_and_holds_its_ends(produced, solved):
    production = produced(CHARACTER + TAKE + "at = 0.5\nstart = 0.4\nstop = 1.2\n[film]\nseconds = 3")
    actor = production.actors[0]
    expected = solved(actor.prepared)
    assert (production.frames, len(expected.R)) == (90, 58)
    for frame, row in ((0, 12), (15, 12), (16, 13), (39, 36), (40, 36), (89, 36)):
        for name in ("R", "root", "bones"):
            assert_array_equal(getattr(actor.pose(frame), name), getattr(expected, name)[row])


def test_a_muted_take_is_not_played(produced):
    actor = produced(CHARACTER + TAKE + 'mute = true\n[[take]]\ncharacter = "a"\nfile = "TAKE"\nstart = 1').actors[0]
    assert actor.end == 28


def test_without_a_take_a_character_stays_at_rest_and_stands_on_the_floor_where_the_scene_says(produced):
    actor = produced(CHARACTER + "[film]\nseconds = 1").actors[0]
    assert_allclose(actor.pose(7).R, actor.prepared.model.rest_controls, atol=1e-7)
    assert (actor.pose(7).root == 0).all()
    linear = actor.to_stage(0)
    height = (actor.prepared.character.vertices @ linear[:3] + linear[3])[:, 1]
    assert [height.min(), height.max()] == pytest.approx([0, 1.5], abs=1e-9)
    assert_allclose([0.0, actor.footing.low, 0.0, 1] @ np.array(linear), [1, 0, 2], atol=1e-9)
    # a quarter turn to its left: what was in front, at +z, is at +x
    assert linear[2, 0] / actor.footing.scale == pytest.approx(1)


def steps(actor, frames):
    """Return how far a character goes over the floor from each frame to the next."""
    way = np.diff([actor.to_stage(frame)[3] for frame in range(frames)], axis=0)
    return np.linalg.norm(way[:, [0, 2]], axis=1)


def test_a_loop_goes_on_where_the_character_is(produced):
    production = produced(CHARACTER + TAKE + "start = 0.2\nstop = 1.5\nloop = 3\nfade = 0.2")
    actor = production.actors[0]
    assert production.frames == 3 * 40 - 2 * 6
    usual = steps(produced(CHARACTER + TAKE).actors[0], 58).max()
    assert steps(actor, production.frames).max() <= 2 * usual  # both takes move during a cross-fade


def test_a_cross_fade_moves_no_vertex_faster_than_the_way_between_the_poses(produced):
    text = CHARACTER + TAKE + "stop = 1\n" + TAKE + "start = 1.2\nfade = 0.3"
    actor = produced(text).actors[0]
    size = np.abs(np.diff([actor.pose(frame).R for frame in range(actor.end)], axis=0)).max(axis=(1, 2))
    cut = produced(text.replace("0.3", "0")).actors[0]
    jump = np.abs(cut.pose(31).R - cut.pose(30).R).max()
    begin = 31 - 9
    assert size[begin - 1 : begin + 10].max() < 0.35 * jump + np.median(size) * 3


def test_a_new_place_is_reached_during_the_cross_fade(produced):
    text = CHARACTER + TAKE + "stop = 1\n" + TAKE + "position = [3, 4]\nturn = -170\nfade = 0.5"
    actor = produced(text).actors[0]
    begin = 31 - 15
    places = [actor.place(frame) for frame in range(begin + 16)]
    assert_array_equal(places[begin - 1].position, [1, 0, 2])
    assert_array_equal(places[begin + 15].position, [3, 0, 4])
    turns = np.array([place.turn for place in places[begin - 1 :]])
    assert (turns[0], turns[-1]) == (90, -170)
    assert np.abs((np.diff(turns) + 180) % 360 - 180).max() < 15  # by the shorter way


def test_boxes_contain_the_character_and_lift_one_without_legs_onto_the_floor(produced):
    boxes = produced('[[character]]\nname = "a"\npuppet = "HANDLES"\n' + TAKE).extents(quiet)["a"].whole
    assert boxes.shape == (58, 2, 3)
    assert boxes[:, 0, 1].min() == pytest.approx(0, abs=1e-6)


@pytest.fixture
def loud(produced, tmp_path, record_events, frames, dance):
    """Produce a take whose first frame is at 5 s, and whose sound begins at another time of its clock."""

    def make(begin, more=""):
        first, *others = frames(dance(), 5.0)
        record_events(tmp_path / "loud.log", [first, Cue(5.0, "sound", {"file": "sound.wav", "at": begin}), *others])
        return produced(CHARACTER + TAKE.replace("TAKE", "loud.log") + more)

    return make


@pytest.mark.parametrize(("begin", "at", "start"), [(4.5, 2.0, 0.9), (5.6, 2.2, 0.0)])
def test_the_sound_beside_a_take_is_in_step_with_it(loud, write_wav, begin, at, start):
    file = write_wav(np.zeros(100))
    (sound,) = loud(begin, "at = 2\nstart = 0.4\nstop = 1.2").sounds
    assert sound.file == str(file)
    assert (sound.at, sound.start, sound.stop) == pytest.approx((at, start, 1.2 + 1 / 30 - (begin - 5)))


@pytest.mark.parametrize("content", [None, b"RIFF"])
def test_the_rest_is_played_if_the_sound_of_a_take_is_missing(loud, tmp_path, content):
    if content is not None:
        (tmp_path / "sound.wav").write_bytes(content)
    production = loud(5.0)
    assert production.sounds == ()
    (note,) = [each for each in production.notes if "sound" in each]
    assert note.startswith("a, loud: ")
    assert str(tmp_path / "sound.wav") in note


UNPLAYABLE = [
    (TAKE.replace("TAKE", "none.log"), SceneError, "[[take]] 1, file"),
    (TAKE.replace("TAKE", "LIMBED"), SkeletonLogError, "limbed.toml"),
    (TAKE + "user = 7", SkeletonLogError, "user"),
    (TAKE + "start = 9", SceneError, "[[take]] 1, start"),
]


@pytest.mark.parametrize(("text", "error", "where"), UNPLAYABLE)
def test_a_take_that_cannot_be_played_is_one_message_and_the_rest_plays(produced, text, error, where):
    assert where in refused(error, produced, CHARACTER + text).where
    production = produced(CHARACTER + text + "\n" + TAKE.replace('"TAKE"', '"TAKE"\nstart = 1'))
    (note,) = [each for each in production.notes if each.startswith("A take is left out. ")]
    assert where in note
    assert production.frames == 28


@pytest.mark.parametrize(
    ("text", "family", "where"),
    [
        (CHARACTER + TAKE + "at = 1\n" + TAKE + "at = 0.5", SceneError, "[[take]] 2, at"),
        ('[[character]]\nname = "a"\npuppet = "none.toml"\n[film]\nseconds = 1', PuppetError, "none.toml"),
    ],
)
def test_takes_in_another_order_than_their_times_and_a_missing_puppet_are_refused(produced, text, family, where):
    assert refused(family, produced, text).where.endswith(where)
