from dataclasses import replace
from functools import reduce
from operator import getitem

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES

from capture.events import TICK_SECONDS, Cue, Lost
from capture.recording import as_recorded
from capture.sensor_pose import SensorPose
from capture.skeleton import SkeletonFrame
from capture.timeline import resample
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings
from engine_bridge.service.players.player_settings import PlayerSettings
from engine_bridge.service.stages.stage import StageSettings
from puppetline.errors import ServiceError
from solver.motion.limbs import parents_first

from ...refusals import refused
from ..stage_steps import (
    apart,
    beginning,
    from_the_middle,
    largest_step,
    level,
    play,
    replay,
    states,
    ticks,
    with_beginnings_of,
)


@pytest.mark.parametrize("cut", [15, 120])
def test_a_take_with_limbs_moves_the_bones_as_before_one_second_after_its_start(
    make_stage, limbed_figure, kung_fu, cut
):
    """A foot that comes to rest in the first second may stand elsewhere until it is lifted, the character with it."""
    events = with_beginnings_of(make_stage(prepared=limbed_figure), [as_recorded(frame) for frame in kung_fu])
    ours, theirs, times = from_the_middle(lambda: make_stage(prepared=limbed_figure), events, cut)
    bones = ["leg" not in limb.name for limb in parents_first(limbed_figure.puppet.limbs) for _ in limb.points[1:]]
    assert bones.count(False) == 4
    turned = np.array([np.abs(a.pose.bones - b.pose.bones)[bones, :3].max() for a, b in zip(ours, theirs, strict=True)])
    assert turned[times > 1].max() < 0.02
    assert turned[times > 2].max(initial=0) < 1e-3
    assert apart(ours, theirs, "pose.root")[times > 1].max() < 1e-2 * limbed_figure.mesh.diagonal


@pytest.fixture
def together(kung_fu, moved):
    """Two performers in turn: one, and user 9 who stands beside and is seen a moment later each time."""

    def frames(since=0.0, by=(0.6, 0.0, 0.4), after=0.005):
        late = [moved(frame, time=frame.time + since) for frame in kung_fu]
        return [each for frame in late for each in (frame, moved(frame, time=frame.time + after, user=9, by=by))]

    return frames


@pytest.mark.parametrize("cut", [20, 78, 318])
def test_a_take_has_who_is_who_at_once_and_the_same_controls_one_second_after_its_start(
    make_stage, prepared_blob, together, cut
):
    both = [as_recorded(frame) for frame in together(after=0.011)]
    both.insert(0, level(-TICK_SECONDS))
    both.insert(302, Cue(both[301].time + 1e-3, "mirror", {"character": "cat"}))
    events = with_beginnings_of(make_stage(("dog", "cat")), both)
    ours, theirs, times = from_the_middle(lambda: make_stage(("dog", "cat")), events, cut)
    off = apart(ours, theirs, "pose.R") / prepared_blob.mesh.diagonal
    assert off[times > 1].max() < 1e-3
    assert off[times > 3].max() < 1e-6
    if cut < 75:  # nobody was calibrated yet
        assert apart(ours, theirs, "pose.targets").max() == 0
        assert off.max() < 1e-12


def test_a_take_treats_people_as_its_stage_did(make_stage, together):
    queue, events = StageSettings(people="queue", turn=6.0), together()
    stage, other = make_stage(player_settings=PlayerSettings(ease=3.0), settings=queue), make_stage()
    with_beginnings_of(stage, events[:200])
    begin = beginning(stage)
    frames = replay(other, [begin, *with_beginnings_of(stage, events[200:])])
    assert frames[0].user == 1  # after six seconds, four of which are the take's
    assert frames[-1].user == 9
    ours, theirs = (each.snapshot(0.0) for each in (stage, other))
    assert ours["direction"] == theirs["direction"]
    assert ours["characters"]["dog"]["manner"] == theirs["characters"]["dog"]["manner"]


def test_a_loop_resumes_at_the_times_of_each_pass(make_stage, kung_fu, moved):
    stage, other = make_stage(), make_stage()
    replay(stage, with_beginnings_of(make_stage(), kung_fu[:100]))
    begin = beginning(stage)
    first = replay(other, [begin, *kung_fu[100:], Lost(kung_fu[-1].time, 1)])
    later = [moved(each, time=each.time + 60.0) for each in kung_fu[100:]]
    second = replay(other, [replace(begin, time=begin.time + 60.0), *later])
    assert states(second) == {"performing"}
    assert apart(first[60:200], second[60:200], "pose.targets").max() < 1e-9


def test_a_loop_keeps_its_performer_and_calibration_and_each_pass_is_the_same(make_stage, kung_fu, moved):
    stage = make_stage(player_settings=PlayerSettings(calibrate="at_once"))
    period, passes = kung_fu[-1].time - kung_fu[0].time + TICK_SECONDS, []
    for number in range(3):
        frames = [moved(frame, time=frame.time + number * period) for frame in kung_fu]
        passes.append(play(stage, [*frames, Lost(frames[-1].time, 1, again=True)])["dog"])
    first, second, third = passes
    assert states(first) == {"calibrating", "performing"}
    assert {(frame.state, frame.user) for frame in second + third} == {("performing", 1)}
    eased = round(1.2 * PlayerSettings().ease / TICK_SECONDS)
    assert apart(second[eased:], third[eased:], "pose.targets").max() < 1e-9
    assert largest_step(first[-1:] + second + third) < 1.1 * largest_step(first)
    left = replay(stage, ticks(third[-1].time, 1.0))
    assert states(left) == {"leaving"}  # a performer who does not return
    assert left[0].time == pytest.approx(third[-1].time + StageSettings().lost_after, abs=3 * TICK_SECONDS)


def test_two_people_get_a_character_each_in_the_order_in_which_they_came(make_stage, kung_fu, moved):
    second = [moved(frame, time=frame.time + 0.5, user=9) for frame in kung_fu]
    events = sorted([*kung_fu, *second], key=lambda event: event.time)
    shown = play(make_stage(("dog", "cat")), events)
    assert {frame.user for frame in shown["dog"]} == {1}
    assert {frame.user for frame in shown["cat"]} == {None, 9}
    # and each is what it would be alone: nobody disturbs anybody
    alone = play(make_stage(), kung_fu)["dog"]
    both = [frame for frame in shown["dog"] if frame.time <= alone[-1].time]
    begun = next(k for k, frame in enumerate(alone) if frame.state == "performing")
    eased = begun + round(1.2 * PlayerSettings().ease / TICK_SECONDS)
    assert apart(alone, both, "pose.targets")[eased:].max() == 0


def test_a_user_can_be_chosen_for_a_character_and_stays_even_if_others_are_nearer(make_stage, together):
    stage = make_stage(settings=StageSettings(people="nearest"))
    [player], both = stage.players, together(by=(0, 0, -1.5))

    def choose(user, event):
        stage.step(Cue(event.time, "choose_user", {"character": "dog", "user": user}), 0)

    play(stage, both[:200])
    assert player.user == 9
    choose(1, both[200])
    play(stage, both[200:])
    assert player.user == 1
    choose(None, both[-1])
    assert player.user == 9


def test_frames_that_do_not_go_forward_are_left_out(make_stage, kung_fu, moved):
    stage, plain = make_stage(), make_stage()
    stuttering = [event for frame in kung_fu for event in (frame, moved(frame, by=(1.0, 0.0, 0.0)))]
    assert apart(play(stage, stuttering)["dog"], play(plain, kung_fu)["dog"], "pose.controls").max() == 0


@pytest.mark.parametrize(("state", "later"), [("performing", "performing"), ("leaving", "waiting")])
def test_characters_loaded_anew_go_on_as_if_nothing_had_been(make_stage, make_player, kung_fu, state, later):
    plain, stage = make_stage(("dog", "cat")), make_stage(("dog", "cat"))
    cut = kung_fu[150].time
    begin, rest = kung_fu[:150], kung_fu[150:]
    if state == "leaving":
        begin, rest = [*begin, Lost(cut, 1)], ticks(cut, 2.0)
    for each in (plain, stage):
        each.step(Cue(0.0, "mirror", {"on": True}), 0)
    steady = play(plain, [*begin, *rest])["dog"]
    before = play(stage, [*begin, *rest[:5]])["dog"]
    stage.replace_players([make_player("dog"), make_player("horse")])
    after = play(stage, rest[5:])["dog"]
    assert after[0].sequence == before[-1].sequence + 1
    assert after[0].user == before[-1].user
    assert stage.players[0].motion.mirror
    assert before[-1].state == state
    assert after[-1].state == later
    assert largest_step([*before, *after]) <= 1.2 * largest_step(steady)


def test_a_turn_goes_on_over_a_reload(make_stage, make_player, together):
    stage = make_stage(settings=StageSettings(people="queue", turn=60.0))
    events = together(since=1000.0)
    play(stage, events[:100])
    stage.replace_players([make_player("dog")])
    assert {frame.user for frame in play(stage, events[100:])["dog"]} == {1}


def test_a_stall_of_the_service_costs_nobody_their_character(make_stage, moved, together):
    stage, both = make_stage(("dog", "cat")), together()
    play(stage, both[:300])
    shown = play(stage, [moved(event, time=event.time + 2.0) for event in both[300:]])
    assert states(shown["dog"]) == states(shown["cat"]) == {"performing"}


def test_a_take_with_a_damaged_beginning_is_refused_and_changes_nothing(make_stage, kung_fu):
    stage, other = make_stage(), make_stage()
    play(stage, kung_fu[:100])
    before = other.snapshot(0.0)
    for place, damage in (
        ((), {"characters": None}),
        ((), {"time": "now"}),
        ((), {"people": [["x"]]}),
        (("direction",), {"colour": 1}),
        (("characters", "dog"), {"calibration": {"rest": [[0.0, 1.0]] * 20}}),
        (("characters", "dog"), {"remembered": [{}]}),
        (("characters", "dog", "calibration"), {"sensor": {}}),
        (("characters", "dog", "manner"), {"colour": 1}),
    ):
        begin = beginning(stage)
        reduce(getitem, place, begin.arguments).update(damage)
        refused(ServiceError, other.step, begin, 0)
        assert other.snapshot(0.0) == before | {"time": begin.time}


def test_a_cue_that_does_not_fit_is_refused_and_changes_nothing(make_stage, kung_fu):
    stage, time = make_stage(), kung_fu[99].time
    play(stage, kung_fu[:100])
    before = stage.snapshot(0.0)
    stands = {"tilt": "steep"}, {"height": None}, {"roll": float("nan")}, {"tilt": [1.0]}
    damaged = [1], {"rest": [[0.0]] * 20}, {"rest": [None] * 20, "sensor": {}}
    for cue in (
        *(level(time, **each) for each in stands),
        Cue(time, "level", {}),
        *(Cue(time, "begin", {"calibration": each}) for each in damaged),
        Cue(time, "choose_user", {"character": "dog", "user": 12}),
        Cue(time, "mirror", {"character": "horse"}),
    ):
        refused(ServiceError, stage.step, cue, 0)
        assert stage.snapshot(0.0) == before


@pytest.mark.parametrize(
    ("cut", "tilt", "cue"), [(0, 0.0, "mirror"), (0, 0.0, "calibrate"), (100, 0.0, None), (100, 15.0, None)]
)
def test_a_take_is_converted_as_it_was_streamed(
    make_stage, prepared_blob, blob_puppet, record_events, tmp_path, cut, tilt, cue
):
    """Whole or from the middle, and although a client mirrors or calibrates the character again."""
    sensor = SensorPose.of_degrees(tilt, 0.0, 0.0, np.array([0.0, 1.2, 0.0]))
    even = resample(PERFORMANCES["kung_fu"]())
    frames = [
        as_recorded(SkeletonFrame(time, 1, (positions - sensor.position) @ sensor.rotation, confidence))
        for time, positions, confidence in zip(even.times, even.positions, even.confidence, strict=True)
    ]
    stage, other = (make_stage(player_settings=PlayerSettings(tilt=tilt, height=1.2)) for _ in range(2))
    if cue is not None:
        frames.insert(150, Cue(frames[150].time, cue, {"on": True} if cue == "mirror" else {}))
    events = with_beginnings_of(other, frames)
    replay(stage, events[:cut])
    record_events(tmp_path / "take.log", [beginning(stage), *events[cut:]])
    shown = [frame for frame in replay(stage, events[cut:]) if frame.user == 1]
    streamed = [*{frame.time: frame.pose for frame in shown}.values()]  # a cue shows it again

    def convert_take(settings):
        """Return the largest distance of controls and root to the stream's once eased, in diagonals, and the notes."""
        clip, summary = convert(tmp_path / "take.log", blob_puppet, tmp_path / "out.glb", settings)
        assert len(clip.motion) == len(streamed) > 60
        converted = [clip.motion[number] for number in range(len(streamed))]
        off = [apart(converted, streamed, what)[90 if cut == 0 else 30 :].max() for what in ("R", "root")]
        return max(off) / prepared_blob.model.diagonal, " ".join(summary.notes)

    distance, notes = convert_take(Settings())
    assert distance < 1e-4
    assert ("It was calibrated or mirrored again at" in notes) == (cue is not None)
    assert ("which was in use when the take began" in notes) == (cut > 0)
    assert cut == 0 or convert_take(Settings(rest_at=0.0))[0] > 0.1
