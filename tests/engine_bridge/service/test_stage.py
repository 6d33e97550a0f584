import itertools
import json
from dataclasses import replace

import numpy as np
import pytest

from capture.clip import SkeletonClip
from capture.events import TICK_SECONDS, Cue, Lost, Tick
from capture.pose import Pose
from capture.recording import Recorder, as_recorded
from capture.sensor_tilt import SensorTilt
from capture.skeleton import SkeletonFrame
from capture.smoothing import JointFilter
from capture.timeline import resample
from engine_bridge.export.convert import convert
from engine_bridge.performance.performance import Performance
from engine_bridge.performance.settings import Settings
from engine_bridge.service.character_player import PlayerSettings
from engine_bridge.service.stage import StageSettings
from engine_bridge.service.stage_runner import PREPARATION_SECONDS
from puppetline.errors import ServiceError
from solver.motion.limbs import parents_first

EASE = PlayerSettings().ease

KEPT = "time", "positions", "confidence"


def with_beginnings(stage, events):
    """Go through events, and before each one the cues that a `StageRunner` gives a stage for a recording."""
    for event in events:
        for player in stage.players:
            if (
                player.next_calibration is not None
                and event.time >= player.next_calibration.asked + PREPARATION_SECONDS
            ):
                calibration = json.loads(json.dumps(player.next_calibration.to_json(), allow_nan=False))
                yield Cue(event.time, "begin", {"character": player.character.name, "calibration": calibration})
        yield event


def play(stage, events):
    """Step through events; return the frames of each character."""
    shown = {player.character.name: [] for player in stage.players}
    for event in with_beginnings(stage, events):
        for frame in stage.step(event, 0):
            shown[frame.character.name].append(frame)
    return shown


def with_beginnings_of(stage, events):
    """Return the events that a stage was given, cues of its calibrations among them."""
    given = []
    for event in with_beginnings(stage, events):
        given.append(event)
        stage.step(event, 0)
    return given


def replay(stage, events):
    """Step through the events of a take, which says itself when calibrations begin."""
    return [frame for event in events for frame in stage.step(event, 0)]


def beginning(stage):
    """Return the cue with which a take of a stage begins, as it is read back."""
    snapshot = json.loads(json.dumps(stage.snapshot(0.0), allow_nan=False))
    return Cue(snapshot["time"], "stage", snapshot)


def from_the_middle(make, events, cut):
    """Return the frames that a stage gives after an event, those of a take of it, and their seconds in the take."""
    stage, other = make(), make()
    replay(stage, events[:cut])
    begin = beginning(stage)
    ours, theirs = replay(stage, events[cut:]), replay(other, [begin, *events[cut:]])
    assert len(ours) == len(theirs) > 50
    for a, b in zip(ours, theirs, strict=True):
        assert (a.character.name, a.time, a.state, a.user) == (b.character.name, b.time, b.state, b.user)
    return ours, theirs, np.array([frame.time for frame in ours]) - begin.time


def apart(ours, theirs, what):
    """Return how far apart a value of frames is (T,)."""
    return np.array([np.abs(getattr(a, what) - getattr(b, what)).max() for a, b in zip(ours, theirs, strict=True)])


def ticks(start, seconds):
    return [Tick(start + k * TICK_SECONDS) for k in range(1, round(seconds / TICK_SECONDS) + 1)]


def largest_step(frames, diagonal):
    """Return how far any handle goes from one frame to the next, in diagonals."""
    return max(np.linalg.norm(b.targets - a.targets, axis=1).max() for a, b in itertools.pairwise(frames)) / diagonal


def test_a_character_rests_while_nobody_is_there(make_stage, blob_rig):
    frames = play(make_stage(), ticks(0.0, 1.0))["dog"]
    assert [frame.state for frame in frames] == ["waiting"] * 30
    assert [frame.sequence for frame in frames] == list(range(1, 31))
    for frame in frames:
        np.testing.assert_allclose(frame.R, blob_rig.model.rest_controls, atol=1e-5)
        np.testing.assert_array_equal(frame.root, 0)


def test_a_performer_is_calibrated_by_standing_still_and_then_plays_what_convert_would(make_stage, blob_rig, kung_fu):
    stage = make_stage(player_settings=PlayerSettings(tilt=0.0, height=0.0))
    frames = play(stage, kung_fu)["dog"]
    states = [frame.state for frame in frames]
    begun = states.index("performing")
    assert set(states[:begun]) == {"calibrating"}
    assert set(states[begun:]) == {"performing"}
    assert 0.9 + PREPARATION_SECONDS <= frames[begun].time <= 1.4
    # once it has eased in, it is the offline pipeline, frame by frame; only the deformation's warm start differs
    rest = next(player for player in stage.players).remembered()[kung_fu[0].user][0].rest
    performance = Performance(blob_rig.puppet, blob_rig.mesh, blob_rig.model, rest)
    for event, frame in zip(kung_fu[begun:], frames[begun:], strict=True):
        aim = performance.retargeting.step(event)
        if frame.time >= frames[begun].time + EASE:
            np.testing.assert_array_equal(frame.targets, aim.targets + aim.root)
            np.testing.assert_array_equal(frame.root, aim.root)
            np.testing.assert_array_equal(frame.joints, aim.joints)


def test_a_character_never_jumps_when_a_performer_comes_goes_and_returns(make_stage, blob_rig, kung_fu, moved):
    stage = make_stage()
    diagonal = blob_rig.mesh.diagonal
    steady = largest_step(play(make_stage(), kung_fu)["dog"], diagonal)
    gone = kung_fu[150].time
    events = [*kung_fu[:150], *ticks(gone, 2.0)]
    away = gone + 2.0
    events += [moved(frame, time=away + frame.time - kung_fu[150].time + TICK_SECONDS) for frame in kung_fu[150:]]
    frames = play(stage, events)["dog"]
    states = [state for state, _ in itertools.groupby(frame.state for frame in frames)]
    assert states == ["calibrating", "performing", "leaving", "waiting", "calibrating", "performing"]
    assert largest_step(frames, diagonal) <= 1.5 * steady
    back = next(frame.time for frame in frames if frame.time > away and frame.state == "performing")
    assert back - away <= PREPARATION_SECONDS + 3 * TICK_SECONDS  # remembered: no second still second


def test_a_performer_that_leaves_lets_the_character_come_to_rest(make_stage, blob_rig, kung_fu):
    stage = make_stage()
    frames = play(
        stage, [*kung_fu[:150], Lost(kung_fu[149].time + 0.01, kung_fu[0].user), *ticks(kung_fu[149].time, 2.0)]
    )["dog"]
    assert frames[-1].state == "waiting"
    np.testing.assert_allclose(frames[-1].R, blob_rig.model.rest_controls, atol=1e-5)
    assert np.abs(frames[149].R - blob_rig.model.rest_controls).max() > 1e-2


def directions(frames):
    """Return the rotations of the bones (T, b, 3, 3)."""
    return np.array([frame.motions[:, :3] for frame in frames])


def largest_turn(frames):
    """Return the largest angle that a bone turns by from one frame to the next, radians."""
    R = directions(frames)
    trace = np.einsum("tbij,tbij->tb", R[1:], R[:-1])
    return np.arccos(np.clip((trace - 1) / 2, -1, 1)).max()


def test_a_new_performer_drives_limbs_as_convert_does_after_a_moment(make_stage, limbed_rig, kung_fu):
    stage = make_stage(player_settings=PlayerSettings(tilt=0.0, height=0.0), rig=limbed_rig)
    (player,), frames, calibrations = stage.players, [], []
    for event in with_beginnings(stage, kung_fu):
        frames += stage.step(event, 0)
        if player.calibration is not None and all(player.calibration is not each for each, _ in calibrations):
            calibrations.append((player.calibration, len(frames)))
    (_, in_passing), (calibration, begun) = calibrations  # again as soon as they have stood still
    assert frames[in_passing].time - kung_fu[0].time <= 0.4 + PREPARATION_SECONDS + 3 * TICK_SECONDS
    assert frames[begun].time - kung_fu[0].time <= 1.4 + PREPARATION_SECONDS
    performance = Performance(limbed_rig.puppet, limbed_rig.mesh, limbed_rig.model, calibration.rest)
    for event, frame in zip(kung_fu[begun:], frames[begun:], strict=True):
        aim = performance.retargeting.step(event)
        if frame.time >= frames[begun].time + EASE:
            np.testing.assert_array_equal(frame.motions, aim.motions)
            np.testing.assert_array_equal(frame.root, aim.root)
            np.testing.assert_array_equal(frame.targets, aim.targets + aim.root)


def test_bones_ease_to_rest_and_back_without_a_jump(make_stage, limbed_rig, kung_fu, moved):
    stage, steady = make_stage(rig=limbed_rig), play(make_stage(rig=limbed_rig), kung_fu)["dog"]
    gone = kung_fu[150].time
    events = [*kung_fu[:150], *ticks(gone, 2.0)]
    away = gone + 2.0
    events += [moved(frame, time=away + frame.time - kung_fu[150].time + TICK_SECONDS) for frame in kung_fu[150:]]
    frames = play(stage, events)["dog"]
    resting = next(frame for frame in reversed(frames) if frame.state == "waiting")
    np.testing.assert_allclose(resting.motions, np.broadcast_to(np.eye(4, 3), resting.motions.shape), atol=1e-9)
    assert largest_turn(frames) <= 1.5 * largest_turn(steady)
    R = directions(frames)
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-9)


@pytest.mark.parametrize("cut", [15, 45, 90, 120, 200, 240])
def test_a_take_with_limbs_moves_the_bones_as_before_one_second_after_its_start(make_stage, limbed_rig, kung_fu, cut):
    """A foot that comes to rest in the first second may stand elsewhere until it is lifted, the character with it."""
    events = with_beginnings_of(make_stage(rig=limbed_rig), [as_recorded(frame) for frame in kung_fu])
    ours, theirs, times = from_the_middle(lambda: make_stage(rig=limbed_rig), events, cut)
    legs = [limb.name for limb in limbed_rig.puppet.limbs if "leg" in limb.name]
    assert len(legs) == 2
    bones = [limb.name not in legs for limb in parents_first(limbed_rig.puppet.limbs) for _ in limb.points[1:]]
    turned = np.array(
        [np.abs(a.motions - b.motions)[bones, :3].max() for a, b in zip(ours, theirs, strict=True)], dtype=float
    )
    assert turned[times > 1].max() < 0.02
    assert turned[times > 2].max(initial=0) < 1e-3
    assert apart(ours, theirs, "root")[times > 1].max() < 1e-2 * limbed_rig.mesh.diagonal


@pytest.mark.parametrize("cut", [20, 71, 78, 85, 300, 310, 318, 400])
def test_a_take_has_who_is_who_at_once_and_the_same_controls_one_second_after_its_start(
    make_stage, blob_rig, kung_fu, moved, cut
):
    friend = [moved(frame, time=frame.time + 0.011, user=7, by=(0.6, 0.0, 0.4)) for frame in kung_fu]
    both = [event for pair in zip(kung_fu, friend, strict=True) for event in pair]
    cues = [Cue(both[300].time + 1e-3, "mirror", {"character": "cat"}), *both[301:]]
    events = [as_recorded(e) if isinstance(e, SkeletonFrame) else e for e in [*both[:301], *cues]]
    events = with_beginnings_of(make_stage(("dog", "cat")), events)
    ours, theirs, times = from_the_middle(lambda: make_stage(("dog", "cat")), events, cut)
    off = apart(ours, theirs, "R") / blob_rig.mesh.diagonal
    assert off[times > 1].max() < 1e-3
    assert off[times > 3].max() < 1e-6
    if cut < 75:  # nobody was calibrated yet
        assert apart(ours, theirs, "targets").max() == 0
        assert off.max() < 1e-12


def test_a_take_treats_people_as_its_stage_did(make_stage, kung_fu, moved):
    stage, other = (
        make_stage(player_settings=PlayerSettings(ease=3.0), settings=StageSettings(people="queue", turn=6.0)),
        make_stage(),
    )
    second = [moved(frame, time=frame.time + 0.005, user=9) for frame in kung_fu]
    events = sorted([*kung_fu, *second], key=lambda event: event.time)
    given = with_beginnings_of(stage, events[:200])
    begin = beginning(stage)
    given = with_beginnings_of(stage, events[200:])
    assert stage.players[0].user == 9  # after six seconds, four of which are the take's
    frames = replay(other, [begin, *given])
    assert (frames[0].user, frames[-1].user) == (kung_fu[0].user, 9)
    assert other.snapshot(0.0)["direction"] == stage.snapshot(0.0)["direction"]
    assert other.snapshot(0.0)["characters"]["dog"]["manner"] == stage.snapshot(0.0)["characters"]["dog"]["manner"]


def test_a_take_gives_its_calibrations_to_other_puppets_of_the_same_name(make_stage, limbed_rig, kung_fu):
    stage, other = make_stage(("dog", "cat")), make_stage(rig=limbed_rig)
    given = with_beginnings_of(stage, kung_fu[:100])
    frames = replay(other, [beginning(stage), *kung_fu[100:]])
    assert {frame.state for frame in frames} == {"performing"}
    np.testing.assert_array_equal(other.players[0].calibration.rest, stage.players[0].calibration.rest)
    begun = make_stage(rig=limbed_rig)
    replay(begun, given)  # as well where the take was begun before
    np.testing.assert_array_equal(begun.players[0].calibration.rest, stage.players[0].calibration.rest)


def test_a_loop_resumes_at_the_times_of_each_pass(make_stage, kung_fu, moved):
    stage, other = make_stage(), make_stage()
    replay(stage, with_beginnings_of(make_stage(), kung_fu[:100]))
    begin = beginning(stage)
    first = replay(other, [begin, *kung_fu[100:], Lost(kung_fu[-1].time, 1)])
    later = 60.0
    again = [replace(begin, time=begin.time + later), *(moved(each, time=each.time + later) for each in kung_fu[100:])]
    second = replay(other, again)
    assert {frame.state for frame in second} == {"performing"}
    for a, b in zip(first[60:200], second[60:200], strict=True):
        np.testing.assert_allclose(a.targets, b.targets, atol=1e-9)


def test_two_people_get_a_character_each_in_the_order_in_which_they_came(make_stage, kung_fu, moved):
    second = [moved(frame, time=frame.time + 0.5, user=9) for frame in kung_fu]
    events = sorted([*kung_fu, *second], key=lambda event: event.time)
    stage = make_stage(("dog", "cat"))
    shown = play(stage, events)
    assert {frame.user for frame in shown["dog"]} == {kung_fu[0].user}
    assert {frame.user for frame in shown["cat"]} == {None, 9}
    # and each is what it would be alone: nobody disturbs anybody
    alone = play(make_stage(), kung_fu)["dog"]
    begun = next(frame.time for frame in alone if frame.state == "performing")
    for a, b in zip(alone, [frame for frame in shown["dog"] if frame.time <= alone[-1].time], strict=True):
        if a.time > begun + 1.1 * EASE:
            np.testing.assert_array_equal(a.targets, b.targets)


def test_the_queue_goes_on_when_somebody_leaves_or_their_turn_is_over(make_stage, kung_fu, moved):
    stage = make_stage(settings=StageSettings(people="queue", turn=6.0))
    second = [moved(frame, time=frame.time + 0.005, user=9) for frame in kung_fu]
    play(stage, sorted([*kung_fu, *second], key=lambda event: event.time))
    assert stage.players[0].user == 9  # after ten seconds: the second one's turn
    stage.step(Lost(kung_fu[-1].time + 0.02, 9), 0)
    assert stage.players[0].user == kung_fu[0].user


def test_the_nearest_takes_over_only_when_clearly_nearer_for_a_while(make_stage, kung_fu, moved):
    def user_after(nearer, seconds):
        stage = make_stage(settings=StageSettings(people="nearest"))
        play(stage, kung_fu[:60])
        rival = [
            moved(f, time=f.time + 0.005, user=9, by=(0, 0, -nearer)) for f in kung_fu[60:] if f.time < 2 + seconds
        ]
        play(stage, sorted([*kung_fu[60:], *rival], key=lambda event: event.time)[: 2 * len(rival)])
        return stage.players[0].user

    assert user_after(0.2, 6.0) == kung_fu[0].user
    assert user_after(1.0, 0.5) == kung_fu[0].user
    assert user_after(1.0, 3.0) == 9


def test_a_user_can_be_chosen_for_a_character(make_stage, kung_fu, moved):
    stage = make_stage()
    play(stage, [event for frame in kung_fu[:60] for event in (frame, moved(frame, time=frame.time + 0.005, user=9))])
    assert stage.players[0].user == kung_fu[0].user
    stage.step(Cue(kung_fu[60].time, "choose_user", {"character": "dog", "user": 9}), 0)
    assert stage.players[0].user == 9
    with pytest.raises(ServiceError, match="no user 12 in view of the sensor"):
        stage.step(Cue(kung_fu[60].time, "choose_user", {"character": "dog", "user": 12}), 0)
    with pytest.raises(ServiceError, match="no character 'horse'"):
        stage.step(Cue(kung_fu[60].time, "mirror", {"character": "horse"}), 0)


def test_a_performer_can_be_calibrated_on_command_only(make_stage, kung_fu):
    stage = make_stage(player_settings=PlayerSettings(calibrate="command"))
    assert {frame.state for frame in play(stage, kung_fu[:100])["dog"]} == {"calibrating"}
    stage.step(Cue(kung_fu[99].time, "calibrate", {"character": "dog"}), 0)
    assert play(stage, kung_fu[100:])["dog"][-1].state == "performing"
    empty = make_stage()
    with pytest.raises(ServiceError, match="no performer for dog"):
        empty.step(Cue(0.0, "calibrate", {"character": "dog"}), 0)


def test_a_mirrored_character_moves_its_other_hand(make_stage, kung_fu):
    plain, mirrored = make_stage(), make_stage()
    mirrored.step(Cue(0.0, "mirror", {"on": True}), 0)
    ours, theirs = ([frame.root for frame in play(stage, kung_fu)["dog"]] for stage in (plain, mirrored))
    # side to side is turned round, to and fro is not
    np.testing.assert_allclose(np.array(theirs), np.array(ours) * [-1, 1, 1], atol=1e-9)
    assert np.abs(ours).max(axis=0)[0] > 0.05


def test_a_joint_of_little_confidence_is_held_where_it_was(make_stage, kung_fu):
    stage, unseen = make_stage(), make_stage()
    doubtful = []
    for frame in kung_fu[100:110]:
        confidence, gone = frame.confidence.copy(), frame.confidence.copy()
        confidence[7], gone[7] = 0.1, 0.0
        wild = frame.positions.copy()
        wild[7] += 3.0
        doubtful.append(
            (
                SkeletonFrame(frame.time, frame.user, wild, confidence),
                SkeletonFrame(frame.time, frame.user, frame.positions, gone),
            )
        )
    ours = play(stage, [*kung_fu[:100], *(a for a, _ in doubtful), *kung_fu[110:]])["dog"]
    theirs = play(unseen, [*kung_fu[:100], *(b for _, b in doubtful), *kung_fu[110:]])["dog"]
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(a.controls, b.controls)


def test_frames_that_do_not_go_forward_are_left_out(make_stage, kung_fu, moved):
    stage, plain = make_stage(), make_stage()
    stuttering = [event for frame in kung_fu for event in (frame, moved(frame, by=(1.0, 0.0, 0.0)))]
    for a, b in zip(play(stage, stuttering)["dog"], play(plain, kung_fu)["dog"], strict=True):
        np.testing.assert_array_equal(a.controls, b.controls)


@pytest.mark.parametrize("state", ["performing", "leaving"])
def test_characters_loaded_anew_go_on_as_if_nothing_had_been(make_stage, make_player, kung_fu, blob_rig, state):
    plain, stage = make_stage(("dog", "cat")), make_stage(("dog", "cat"))
    cut = kung_fu[150].time
    rest = kung_fu[150:] if state == "performing" else ticks(cut, 2.0)
    away = [] if state == "performing" else [Lost(cut, 1)]
    for each in (plain, stage):
        each.step(Cue(0.0, "mirror", {"on": True}), 0)
    steady = largest_step(play(plain, [*kung_fu[:150], *away, *rest])["dog"], blob_rig.mesh.diagonal)
    before = play(stage, [*kung_fu[:150], *away, *rest[:5]])["dog"]
    stage.replace_players([make_player("dog"), make_player("horse")])
    after = play(stage, rest[5:])["dog"]
    assert after[0].sequence == before[-1].sequence + 1
    assert after[0].user == before[-1].user
    assert stage.players[0].mirror
    assert after[-1].state == ("performing" if state == "performing" else "waiting")
    assert largest_step([*before, *after], blob_rig.mesh.diagonal) <= 1.2 * steady


def test_a_turn_goes_on_over_a_reload(make_stage, make_player, kung_fu, moved):
    stage = make_stage(settings=StageSettings(people="queue", turn=60.0))
    late = [moved(frame, time=1000.0 + frame.time) for frame in kung_fu]
    rival = [moved(frame, time=frame.time + 0.005, user=9) for frame in late]
    events = sorted([*late, *rival], key=lambda event: event.time)
    play(stage, events[:100])
    stage.replace_players([make_player("dog")])
    assert {frame.user for frame in play(stage, events[100:])["dog"]} == {1}


def test_a_stall_of_the_service_costs_nobody_their_character(make_stage, kung_fu, moved):
    stage = make_stage(("dog", "cat"))
    both = [event for f in kung_fu for event in (f, moved(f, time=f.time + 0.01, user=9))]
    play(stage, both[:300])
    woken = [moved(event, time=event.time + 2.0) for event in both[300:]]
    shown = play(stage, woken)
    assert {frame.state for frame in [*shown["dog"], *shown["cat"]]} == {"performing"}


def test_a_pause_in_the_midst_of_easing_does_not_jump(make_stage, kung_fu, moved, blob_rig):
    stage = make_stage()
    steady = largest_step(play(make_stage(), kung_fu)["dog"], blob_rig.mesh.diagonal)
    begun = next(k for k, frame in enumerate(play(make_stage(), kung_fu)["dog"]) if frame.state == "performing")
    cut = begun + 5
    later = [moved(frame, time=frame.time + 0.45) for frame in kung_fu[cut:]]
    frames = play(stage, [*kung_fu[:cut], *ticks(kung_fu[cut - 1].time, 0.4), *later])["dog"]
    assert largest_step(frames, blob_rig.mesh.diagonal) <= 1.2 * steady


def test_a_user_that_flickers_keeps_the_calibration(make_stage, kung_fu, moved):
    stage = make_stage()
    play(stage, kung_fu[:100])
    time = kung_fu[99].time
    for back in (kung_fu[100:103], kung_fu[103:106], kung_fu[106:]):  # seen for a moment, twice, and then for good
        stage.step(Lost(time + 0.01, 1), 0)
        time += 1.0
        back = [moved(frame, time=time + frame.time - back[0].time) for frame in back]
        frames = play(stage, back)["dog"]
        time = back[-1].time
    assert [frame.state for frame in frames].index("performing") <= 12


def test_a_chosen_user_stays_even_if_others_are_nearer(make_stage, kung_fu, moved):
    stage = make_stage(settings=StageSettings(people="nearest"))
    near = [moved(frame, time=frame.time + 0.005, user=9, by=(0, 0, -1.5)) for frame in kung_fu]
    both = [event for pair in zip(kung_fu, near, strict=True) for event in pair]
    play(stage, both[:200])
    assert stage.players[0].user == 9
    stage.step(Cue(both[200].time, "choose_user", {"character": "dog", "user": 1}), 0)
    play(stage, both[200:])
    assert stage.players[0].user == 1
    stage.step(Cue(both[-1].time, "choose_user", {"character": "dog", "user": None}), 0)
    assert stage.players[0].user == 9


def test_a_calibration_that_fails_is_told_and_the_next_one_counts(make_stage, kung_fu, monkeypatch):
    stage = make_stage(player_settings=PlayerSettings(calibrate="at_once"))
    [player] = stage.players
    retarget, calls = player._retarget, []

    def stumbling(*arguments):
        calls.append(1)
        if len(calls) == 1:
            raise FloatingPointError("no body")
        return retarget(*arguments)

    monkeypatch.setattr(player, "_retarget", stumbling)
    told = []
    for event in with_beginnings(stage, kung_fu[:100]):
        try:
            stage.step(event, 0)
        except ServiceError as error:
            told.append(str(error))
    [line] = told
    assert "cannot be calibrated (FloatingPointError: no body)" in line
    assert player.state == "performing"


@pytest.mark.parametrize(
    "damage",
    [
        lambda said: said.pop("characters"),
        lambda said: said.update(characters=[]),
        lambda said: said.update(time="now"),
        lambda said: said.update(direction={"people": "each", "colour": 1}),
        lambda said: said.update(people=[["x"]]),
        lambda said: said["characters"]["dog"].pop("mirror"),
        lambda said: said["characters"]["dog"].update(user=7),
        lambda said: said["characters"]["dog"].update(calibration=[1]),
        lambda said: said["characters"]["dog"]["calibration"].update(rest=[[0.0, 1.0]] * 20),
        lambda said: said["characters"]["dog"]["calibration"].update(sensor={}),
        lambda said: said["characters"]["dog"].update(manner={"colour": 1}),
        lambda said: said["characters"]["dog"].update(remembered=[{}]),
    ],
)
def test_a_take_with_a_damaged_beginning_is_refused_and_changes_nothing(make_stage, kung_fu, damage):
    stage, other = make_stage(), make_stage()
    play(stage, kung_fu[:100])
    begin = beginning(stage)
    damage(begin.arguments)
    before = other.snapshot(0.0)
    with pytest.raises(ServiceError, match="a take with a damaged beginning"):
        other.step(begin, 0)
    assert other.snapshot(0.0) == before | {"time": begin.time}


@pytest.mark.parametrize("calibration", [[1], {}, {"rest": [[0.0]] * 20}, {"rest": [None] * 20, "sensor": {}}])
def test_a_damaged_calibration_of_a_take_is_refused_and_that_before_stays(make_stage, kung_fu, calibration):
    stage = make_stage()
    play(stage, kung_fu[:100])
    before = stage.players[0].calibration
    with pytest.raises(ServiceError, match="dog: found a damaged calibration in a take"):
        stage.step(Cue(kung_fu[99].time, "begin", {"calibration": calibration}), 0)
    assert stage.players[0].calibration is before


def test_joints_are_filtered_and_levelled_before_the_calibration_as_well(make_stage, kung_fu):
    frames = play(make_stage(), kung_fu[:40])["dog"]
    smoothing = JointFilter(frames[0].character.rig.puppet.smoothing.parameters)
    for event, frame in zip(kung_fu[:40], frames, strict=True):
        if frame.state == "calibrating":
            np.testing.assert_array_equal(frame.joints, smoothing.step(event.time, event.positions, event.confidence))


TILTED = Pose.of_degrees(12.0, 0.0, 4.0, np.array([0.0, 1.3, 0.0]))


def seen_from_above(frames):
    """Return frames as a sensor sees them that looks down and leans."""
    return [replace(frame, positions=(frame.positions - TILTED.position) @ TILTED.rotation) for frame in frames]


def level(time, **changed):
    return Cue(time, "level", {"tilt": 12.0, "roll": 4.0, "height": 1.3} | changed)


def test_a_sensor_that_sees_the_floor_is_set_upright_at_once_and_exactly(make_stage, kung_fu):
    """Joints are what a level sensor at the floor's height would have given, before and after the calibration."""
    upright = play(make_stage(player_settings=PlayerSettings(tilt=0.0, height=0.0)), kung_fu)["dog"]
    tilted = play(make_stage(), [level(kung_fu[0].time - TICK_SECONDS), *seen_from_above(kung_fu)])["dog"]
    assert [frame.state for frame in tilted[-len(upright) :]] == [frame.state for frame in upright]
    for one, other in zip(tilted[-len(upright) :], upright, strict=True):
        np.testing.assert_allclose(one.joints, other.joints, atol=1e-9)
        np.testing.assert_allclose(one.targets, other.targets, atol=1e-3)  # the still second's medians


def test_the_sensors_settings_take_precedence_over_the_measured_floor(make_stage, kung_fu):
    stage = make_stage(player_settings=PlayerSettings(tilt=3.0, height=0.7))
    play(stage, [level(kung_fu[0].time - TICK_SECONDS), *kung_fu[:60]])
    assert stage.players[0].level == SensorTilt(3.0, 0.7, 4.0)


def test_a_performer_keeps_the_calibration_when_the_sensor_is_moved(make_stage, kung_fu):
    stood, moment = level(kung_fu[0].time - TICK_SECONDS, tilt=2.0, height=1.0), 120
    steady = play(make_stage(), [stood, *kung_fu])["dog"]
    moved_stage = make_stage()
    moved = play(moved_stage, [stood, *kung_fu[:moment], level(kung_fu[moment - 1].time), *kung_fu[moment:]])["dog"]
    assert steady[moment].state == "performing"
    for one, other in zip(steady, moved, strict=True):
        np.testing.assert_array_equal(one.targets, other.targets)
    moved_stage.step(Cue(kung_fu[-1].time, "calibrate"), 0)
    moved_stage.step(Cue(kung_fu[-1].time, "begin"), 0)
    assert moved_stage.players[0].level == SensorTilt(12.0, 1.3, 4.0)


def test_a_performer_calibrated_before_the_floor_was_seen_is_set_upright_too(make_stage, blob_rig, kung_fu):
    """From then on, but for the easing, all is as if it had been seen from the start."""
    seen, moment = seen_from_above(kung_fu), 100
    early = play(make_stage(), [level(kung_fu[0].time - TICK_SECONDS), *seen])["dog"]
    late_stage = make_stage()
    late = play(late_stage, [*seen[:moment], level(seen[moment - 1].time), *seen[moment:]])["dog"]
    assert late[moment].state == "performing"
    assert late_stage.players[0].level == SensorTilt(12.0, 1.3, 4.0)
    settled = kung_fu[moment].time + PREPARATION_SECONDS + EASE + TICK_SECONDS
    pairs = [(e, la) for e, la in zip(early[-len(late) :], late, strict=True) if la.time > settled]
    assert len(pairs) > 60
    for one, other in pairs:
        np.testing.assert_allclose(one.targets, other.targets, atol=1e-3)  # the filter has begun anew
    assert largest_step(late, blob_rig.mesh.diagonal) <= 1.5 * largest_step(early, blob_rig.mesh.diagonal)


def test_a_performer_who_returns_after_the_sensor_was_moved_is_calibrated_again(make_stage, kung_fu, moved):
    last = kung_fu[149].time
    away = ticks(last, 2.0)
    back = [moved(frame, time=last + 2.0 + (k + 1) * TICK_SECONDS) for k, frame in enumerate(kung_fu[:60])]
    opened_again = level(last + 2.0, tilt=12.5)
    for between, known in (([], True), ([opened_again], True), ([level(last + 2.0, tilt=20.0)], False)):
        stage = make_stage()
        play(stage, [level(kung_fu[0].time - TICK_SECONDS), *kung_fu[:150], *away, *between, *back[:1]])
        assert (stage.players[0].next_calibration is not None) == known


@pytest.mark.parametrize("wrong", [{"tilt": "steep"}, {"height": None}, {"roll": float("nan")}, {"tilt": [1.0]}])
def test_a_sensor_that_stands_like_nothing_is_refused_and_counts_for_nothing(make_stage, wrong):
    stage = make_stage()
    with pytest.raises(ServiceError, match="a position of the sensor that is not understood"):
        stage.step(level(1.0, **wrong), 0)
    with pytest.raises(ServiceError, match="a position of the sensor that is not understood"):
        stage.step(Cue(1.0, "level", {}), 0)
    assert stage.players[0].level == SensorTilt()


def test_a_take_says_how_the_sensor_stands(make_stage, blob_rig, kung_fu):
    events = with_beginnings_of(make_stage(), [level(kung_fu[0].time - TICK_SECONDS), *seen_from_above(kung_fu)])
    ours, theirs, times = from_the_middle(make_stage, events, 100)
    assert apart(ours, theirs, "R")[times > 1].max() < 1e-3 * blob_rig.mesh.diagonal
    stage, other = make_stage(), make_stage()
    replay(stage, events[:100])
    replay(other, [beginning(stage)])
    assert other.players[0].level == stage.players[0].level == SensorTilt(12.0, 1.3, 4.0)


@pytest.mark.parametrize("tilt", [0.0, 15.0])
def test_a_take_from_the_middle_of_a_performance_is_converted_as_it_was_streamed(
    make_stage, blob_rig, blob_puppet, kung_fu, tmp_path, tilt
):
    sensor = Pose.of_degrees(tilt, 0.0, 0.0, np.array([0.0, 1.2, 0.0]))
    even = resample(SkeletonClip("", 1, *(np.array([getattr(each, what) for each in kung_fu]) for what in KEPT)))
    seen = [
        SkeletonFrame(time, 1, (positions - sensor.position) @ sensor.rotation, confidence)
        for time, positions, confidence in zip(even.times, even.positions, even.confidence, strict=True)
    ]
    stage = make_stage(player_settings=PlayerSettings(tilt=tilt, height=1.2))
    events = with_beginnings_of(make_stage(player_settings=PlayerSettings(tilt=tilt, height=1.2)), seen)
    cut = 100
    replay(stage, events[:cut])
    with Recorder(tmp_path / "take.log") as recorder:
        for event in (beginning(stage), *events[cut:]):
            recorder.write(as_recorded(event) if isinstance(event, SkeletonFrame) else event)
    streamed = replay(stage, events[cut:])

    def distance_to_stream(settings):
        """Return the largest distance of controls and root after a second, in diagonals, and the notes."""
        clip, summary = convert(tmp_path / "take.log", blob_puppet, tmp_path / "out.glb", settings)
        assert len(clip.frames) == len(streamed) > 60
        moved = [np.abs(a - b.R).max() for a, b in zip(clip.frames[:], streamed, strict=True)]
        travelled = [np.abs(a - b.root).max() for a, b in zip(clip.root, streamed, strict=True)]
        return max(*moved[30:], *travelled[30:]) / blob_rig.model.diagonal, summary.notes

    distance, notes = distance_to_stream(Settings())
    assert distance < 1e-4
    assert "The performer's calibration pose is the one in the take, which was in use when the take began." in notes
    assert distance_to_stream(Settings(rest_at=0.0))[0] > 0.1
