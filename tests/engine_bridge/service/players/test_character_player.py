import itertools
from dataclasses import replace

import numpy as np
import pytest

from capture.events import TICK_SECONDS, Cue, Lost
from capture.pose import Pose
from capture.sensor_tilt import SensorTilt
from capture.skeleton import SkeletonFrame
from capture.smoothing import JointFilter
from engine_bridge.performance.performance import Performance
from engine_bridge.service.players.character_player import PlayerSettings
from engine_bridge.service.stages.stage import PREPARATION_SECONDS
from puppetline.errors import ServiceError

from ..stage_steps import (
    apart,
    beginning,
    from_the_middle,
    largest_step,
    level,
    play,
    replay,
    ticks,
    with_beginnings,
    with_beginnings_of,
)

EASE = PlayerSettings().ease


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
            np.testing.assert_array_equal(frame.joints, performance.retargeting.joints)


def gone_for_a_while(frames, moved, *lost):
    """Return frames with a silence of two seconds in the middle."""
    gone = frames[150].time
    back = [moved(frame, time=frame.time + 2.0 + TICK_SECONDS) for frame in frames[150:]]
    return [*frames[:150], *lost, *ticks(gone, 2.0), *back]


def test_a_character_never_jumps_when_a_performer_comes_goes_and_returns(make_stage, blob_rig, kung_fu, moved):
    diagonal = blob_rig.mesh.diagonal
    steady = largest_step(play(make_stage(), kung_fu)["dog"], diagonal)
    frames = play(make_stage(), gone_for_a_while(kung_fu, moved, Lost(kung_fu[149].time + 0.01, 1)))["dog"]
    states = [state for state, _ in itertools.groupby(frame.state for frame in frames)]
    assert states == ["calibrating", "performing", "leaving", "waiting", "calibrating", "performing"]
    assert largest_step(frames, diagonal) <= 1.5 * steady
    assert np.abs(frames[149].R - blob_rig.model.rest_controls).max() > 1e-2
    resting = next(frame for frame in reversed(frames) if frame.state == "waiting")
    np.testing.assert_allclose(resting.R, blob_rig.model.rest_controls, atol=1e-5)
    away = kung_fu[150].time + 2.0
    back = next(frame.time for frame in frames if frame.time > away and frame.state == "performing")
    assert back - away <= PREPARATION_SECONDS + 3 * TICK_SECONDS  # remembered: no second still second


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
    steady = play(make_stage(rig=limbed_rig), kung_fu)["dog"]
    frames = play(make_stage(rig=limbed_rig), gone_for_a_while(kung_fu, moved))["dog"]
    resting = next(frame for frame in reversed(frames) if frame.state == "waiting")
    np.testing.assert_allclose(resting.motions, np.broadcast_to(np.eye(4, 3), resting.motions.shape), atol=1e-9)
    assert largest_turn(frames) <= 1.5 * largest_turn(steady)
    R = directions(frames)
    np.testing.assert_allclose(R @ np.swapaxes(R, -1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-9)


def test_a_performer_can_be_calibrated_on_command_only(make_stage, kung_fu):
    stage = make_stage(player_settings=PlayerSettings(calibrate="command"))
    assert {frame.state for frame in play(stage, kung_fu[:100])["dog"]} == {"calibrating"}
    stage.step(Cue(kung_fu[99].time, "calibrate", {"character": "dog"}), 0)
    assert play(stage, kung_fu[100:])["dog"][-1].state == "performing"
    empty = make_stage()
    with pytest.raises(ServiceError, match="no performer for dog"):
        empty.step(Cue(0.0, "calibrate", {"character": "dog"}), 0)


def test_a_mirrored_character_moves_its_other_hand_and_has_the_channels_of_the_other_side(make_stage, kung_fu):
    plain, mirrored = make_stage(), make_stage()
    mirrored.step(Cue(0.0, "mirror", {"on": True}), 0)
    winking = [replace(frame, channels={"blink_left": 0.5, "voice": 0.25}) for frame in kung_fu]
    played = [play(stage, winking)["dog"] for stage in (plain, mirrored)]
    assert played[0][-1].channels == winking[0].channels
    assert played[1][-1].channels == {"blink_right": 0.5, "voice": 0.25}
    ours, theirs = ([frame.root for frame in frames] for frames in played)
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
    assert stage.players[0].sensor == SensorTilt(3.0, 0.7, 4.0)


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
    assert moved_stage.players[0].sensor == SensorTilt(12.0, 1.3, 4.0)


def test_a_performer_calibrated_before_the_floor_was_seen_is_set_upright_too(make_stage, blob_rig, kung_fu):
    """From then on, but for the easing, all is as if it had been seen from the start."""
    seen, moment = seen_from_above(kung_fu), 100
    early = play(make_stage(), [level(kung_fu[0].time - TICK_SECONDS), *seen])["dog"]
    late_stage = make_stage()
    late = play(late_stage, [*seen[:moment], level(seen[moment - 1].time), *seen[moment:]])["dog"]
    assert late[moment].state == "performing"
    assert late_stage.players[0].sensor == SensorTilt(12.0, 1.3, 4.0)
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


def test_a_take_says_how_the_sensor_stands(make_stage, blob_rig, kung_fu):
    events = with_beginnings_of(make_stage(), [level(kung_fu[0].time - TICK_SECONDS), *seen_from_above(kung_fu)])
    ours, theirs, times = from_the_middle(make_stage, events, 100)
    assert apart(ours, theirs, "R")[times > 1].max() < 1e-3 * blob_rig.mesh.diagonal
    stage, other = make_stage(), make_stage()
    replay(stage, events[:100])
    replay(other, [beginning(stage)])
    assert other.players[0].sensor == stage.players[0].sensor == SensorTilt(12.0, 1.3, 4.0)
