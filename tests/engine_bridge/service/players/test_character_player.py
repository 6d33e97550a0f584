from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.events import TICK_SECONDS, Cue, Lost
from capture.sensor_pose import SensorPose
from capture.sensor_tilt import SensorTilt
from capture.smoothing import JointFilter
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.service.players.player_settings import PlayerSettings
from engine_bridge.service.stages.stage import PREPARATION_SECONDS
from puppetline.errors import ServiceError

from ...refusals import refused
from ..stage_steps import apart, largest_step, level, phases, play, states, ticks, with_beginnings

EASE = PlayerSettings().ease
LEVEL = PlayerSettings(tilt=0.0, height=0.0)


@pytest.mark.parametrize("figure", ["prepared_blob", "limbed_figure"])
def test_frames_are_the_poses_of_a_motion_with_the_calibrations_at_their_times(make_stage, request, kung_fu, figure):
    """Limbs that follow directions can be calibrated before the performer has stood still for a second."""
    prepared = request.getfixturevalue(figure)
    stage = make_stage(player_settings=LEVEL, prepared=prepared)
    [player], frames, begun = stage.players, [], []
    for event in with_beginnings(stage, kung_fu):
        frames += stage.step(event, 0)
        if player.calibration is not None and all(player.calibration is not each for each, *_ in begun):
            begun.append((player.calibration, len(frames), event.time))
    since = [frames[number].time - kung_fu[0].time for _, number, _ in begun]
    if prepared.puppet.limbs:
        passing, still = since
        assert passing <= 0.4 + PREPARATION_SECONDS + 3 * TICK_SECONDS
        assert still <= 1.4 + PREPARATION_SECONDS
    else:
        [still] = since
        assert 0.9 + PREPARATION_SECONDS <= still <= 1.4
    assert phases(frames) == ["calibrating", "performing"]
    motion, smoothing = CharacterMotion(prepared), JointFilter(prepared.puppet.smoothing.parameters)
    for number, (event, frame) in enumerate(zip(kung_fu, frames, strict=True)):
        for calibration, first, time in begun:
            if number == first:
                motion.follow(time, motion.retargeting(calibration.rest))
        pose = motion.step(event)
        for name in ("R", "controls", "bones"):
            assert_array_equal(getattr(frame.pose, name), getattr(pose, name))
        assert_array_equal(frame.handles, pose.targets + pose.root)
        if frame.state == "calibrating":  # joints are filtered before the calibration as well
            seen = smoothing.step(event.time, event.positions, event.confidence)
        else:
            seen = motion.performer.joints
        assert_array_equal(frame.seen.positions, seen)


def largest_turn(frames):
    """Return the largest angle that a bone turns by from one frame to the next, radians."""
    R = np.array([frame.pose.bones[:, :3] for frame in frames])
    assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-9)
    trace = np.einsum("tbij,tbij->tb", R[1:], R[:-1])
    return np.arccos(np.clip((trace - 1) / 2, -1, 1)).max()


@pytest.mark.parametrize("figure", ["prepared_blob", "limbed_figure"])
def test_a_character_never_jumps_when_a_performer_comes_goes_and_returns(make_stage, request, kung_fu, moved, figure):
    prepared = request.getfixturevalue(figure)
    gone = kung_fu[150].time
    back = [moved(frame, time=frame.time + 2.0 + TICK_SECONDS) for frame in kung_fu[150:]]
    away = [Lost(kung_fu[149].time + 0.01, 1), *ticks(gone, 2.0)]
    steady = play(make_stage(prepared=prepared), kung_fu)["dog"]
    frames = play(make_stage(prepared=prepared), [*kung_fu[:150], *away, *back])["dog"]
    assert phases(frames) == ["calibrating", "performing", "leaving", "waiting", "calibrating", "performing"]
    assert largest_step(frames) <= 1.5 * largest_step(steady)
    assert np.abs(frames[149].pose.R - prepared.model.rest_controls).max() > 1e-2
    resting = next(frame for frame in reversed(frames) if frame.state == "waiting")
    assert_allclose(resting.pose.R, prepared.model.rest_controls, atol=1e-5)
    returned = next(frame.time for frame in frames if frame.time > gone + 2.0 and frame.state == "performing")
    assert returned - gone - 2.0 <= PREPARATION_SECONDS + 3 * TICK_SECONDS  # remembered: no second still second
    if prepared.puppet.limbs:
        assert largest_turn(frames) <= 1.5 * largest_turn(steady)
        assert_allclose(resting.pose.bones, np.broadcast_to(np.eye(4, 3), resting.pose.bones.shape), atol=1e-9)


def test_a_performer_can_be_calibrated_on_command_only(make_stage, kung_fu):
    stage = make_stage(player_settings=PlayerSettings(calibrate="command"))
    cue = Cue(kung_fu[99].time, "calibrate", {"character": "dog"})
    refused(ServiceError, stage.step, replace(cue, time=0.0), 0)  # nobody is there
    assert states(play(stage, kung_fu[:100])["dog"]) == {"calibrating"}
    assert play(stage, [cue, *kung_fu[100:]])["dog"][-1].state == "performing"


def test_a_mirrored_character_moves_its_other_hand_and_has_the_channels_of_the_other_side(make_stage, kung_fu):
    winking = [replace(frame, channels={"blink_left": 0.5, "voice": 0.25}) for frame in kung_fu]
    ours, theirs = (play(make_stage(), [Cue(0.0, "mirror", {"on": on}), *winking])["dog"] for on in (False, True))
    assert ours[-1].pose.channels == winking[0].channels
    assert theirs[-1].pose.channels == {"blink_right": 0.5, "voice": 0.25}
    plain, mirrored = (np.array([frame.pose.root for frame in frames]) for frames in (ours, theirs))
    assert_allclose(mirrored, plain * [-1, 1, 1], atol=1e-9)  # side to side is turned round, to and fro is not
    assert np.abs(plain[:, 0]).max() > 0.05


def test_a_joint_of_little_confidence_is_held_where_it_was(make_stage, kung_fu):
    unsure, gone, one = list(kung_fu), list(kung_fu), np.arange(20) == 7
    for number, frame in enumerate(kung_fu[100:110], 100):
        for frames, far, confidence in ((unsure, 3.0, 0.1), (gone, 0.0, 0.0)):
            sure = np.where(one, np.float32(confidence), frame.confidence)
            frames[number] = replace(frame, positions=frame.positions + far * one[:, None], confidence=sure)
    ours, theirs = (play(make_stage(), frames)["dog"] for frames in (unsure, gone))
    assert apart(ours, theirs, "pose.controls").max() == 0


def test_a_user_that_flickers_keeps_the_calibration(make_stage, kung_fu, moved):
    stage = make_stage()
    play(stage, kung_fu[:100])
    for times, back in enumerate((kung_fu[100:103], kung_fu[103:106], kung_fu[106:])):  # a moment, twice, then for good
        stage.step(Lost(back[0].time + times - 0.01, 1), 0)
        frames = play(stage, [moved(frame, time=frame.time + times + 1.0) for frame in back])["dog"]
    assert [frame.state for frame in frames].index("performing") <= 12


def test_a_calibration_that_fails_is_told_and_the_next_one_counts(make_stage, kung_fu, monkeypatch):
    stage = make_stage(player_settings=PlayerSettings(calibrate="at_once"))
    [player] = stage.players
    retarget, calls = player.motion.retargeting, []

    def stumbling(*arguments):
        calls.append(1)
        if len(calls) == 1:
            raise FloatingPointError("no body")
        return retarget(*arguments)

    monkeypatch.setattr(player.motion, "retargeting", stumbling)
    told = []
    for event in with_beginnings(stage, kung_fu[:100]):
        try:
            stage.step(event, 0)
        except ServiceError as error:
            told.append(error.where)
    assert len(told) == 1
    assert player.state == "performing"


TILTED = SensorPose.of_degrees(12.0, 0.0, 4.0, np.array([0.0, 1.3, 0.0]))
STANDS = level(-TICK_SECONDS)
"""How the sensor stands is known just before the first frame."""


def seen_from_above(frames):
    """Return frames as a sensor sees them that looks down and leans."""
    return [replace(frame, positions=(frame.positions - TILTED.position) @ TILTED.rotation) for frame in frames]


def test_a_sensor_that_sees_the_floor_is_set_upright_at_once_and_exactly(make_stage, kung_fu):
    """Joints are what a level sensor at the floor's height would have given, before and after the calibration."""
    upright = play(make_stage(player_settings=LEVEL), kung_fu)["dog"]
    tilted = play(make_stage(), [STANDS, *seen_from_above(kung_fu)])["dog"][-len(upright) :]
    assert [frame.state for frame in tilted] == [frame.state for frame in upright]
    assert apart(tilted, upright, "seen.positions").max() < 1e-9
    assert apart(tilted, upright, "pose.targets").max() < 1e-3  # the still second's medians


def test_the_sensors_settings_take_precedence_over_the_measured_floor(make_stage, kung_fu):
    stage = make_stage(player_settings=PlayerSettings(tilt=3.0, height=0.7))
    play(stage, [STANDS, *kung_fu[:60]])
    assert stage.players[0].sensor == SensorTilt(3.0, 0.7, 4.0)


def test_a_performer_keeps_the_calibration_when_the_sensor_is_moved(make_stage, kung_fu):
    stood, moment = level(-TICK_SECONDS, tilt=2.0, height=1.0), 120
    steady = play(make_stage(), [stood, *kung_fu])["dog"]
    moved_stage = make_stage()
    moved = play(moved_stage, [stood, *kung_fu[:moment], level(kung_fu[moment - 1].time), *kung_fu[moment:]])["dog"]
    assert steady[moment].state == "performing"
    assert apart(steady, moved, "pose.targets").max() == 0
    moved_stage.step(Cue(kung_fu[-1].time, "calibrate"), 0)
    moved_stage.step(Cue(kung_fu[-1].time, "begin"), 0)
    assert moved_stage.players[0].sensor == SensorTilt(12.0, 1.3, 4.0)


def test_a_performer_calibrated_before_the_floor_was_seen_is_set_upright_too(make_stage, kung_fu):
    """From then on, but for the easing, all is as if it had been seen from the start."""
    seen, moment, stage = seen_from_above(kung_fu), 100, make_stage()
    early = play(make_stage(), [STANDS, *seen])["dog"]
    late = play(stage, [*seen[:moment], level(seen[moment - 1].time), *seen[moment:]])["dog"]
    assert late[moment].state == "performing"
    assert stage.players[0].sensor == SensorTilt(12.0, 1.3, 4.0)
    settled = kung_fu[moment].time + PREPARATION_SECONDS + EASE + TICK_SECONDS
    since = next(k for k, frame in enumerate(late) if frame.time > settled)
    off = apart(early[-len(late) :], late, "pose.targets")[since:]
    assert len(off) > 60
    assert off.max() < 1e-3  # the filter has begun anew
    assert largest_step(late) <= 1.5 * largest_step(early)


@pytest.mark.parametrize(("tilt", "known"), [(None, True), (12.5, True), (20.0, False)])
def test_a_performer_who_returns_after_the_sensor_was_moved_is_calibrated_again(
    make_stage, kung_fu, moved, tilt, known
):
    """Not if it is only opened again."""
    stage, last = make_stage(), kung_fu[149].time
    between = [] if tilt is None else [level(last + 2.0, tilt=tilt)]
    back = moved(kung_fu[0], time=last + 2.0 + TICK_SECONDS)
    play(stage, [STANDS, *kung_fu[:150], *ticks(last, 2.0), *between, back])
    assert (stage.players[0].next_calibration is not None) == known
