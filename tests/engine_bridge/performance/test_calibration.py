from dataclasses import replace
from operator import attrgetter

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.events import Cue
from capture.formats import read_log
from capture.sensor_tilt import SensorTilt
from capture.skeleton import JOINT_INDEX, LOST, TRACKED, SkeletonFrame
from engine_bridge.performance.calibration import Calibration, RecentFrames, of_performer, same_body
from engine_bridge.performance.clip import load_timeline, resting_pose
from engine_bridge.performance.settings import Settings


def after(positions, confidence=TRACKED, fps=30.0):
    """Return what is remembered after frames with these joints."""
    last, confidence = RecentFrames(), np.broadcast_to(np.float32(confidence), positions.shape[:2])
    for k, place in enumerate(positions):
        last.add(SkeletonFrame(k / fps, 1, place, confidence[k]))
    return last


@pytest.mark.parametrize("fps", [10.0, 30.0, 120.0])
def test_a_second_of_noise_about_one_pose_is_still_and_gives_that_pose(standing, fps):
    noise = np.random.default_rng(1).normal(0, 0.01, (round(1.1 * fps), 20, 3))
    last = after(standing + noise, fps=fps)
    assert last.is_still()
    assert np.linalg.norm(last.pose() - standing, axis=1).max() < 0.02


@pytest.fixture
def still(standing):
    """A second of joints (33, 20, 3) that do not move."""
    return np.tile(standing, (33, 1, 1))


def test_less_than_a_second_is_not_enough(still):
    assert not after(still[:20]).is_still()
    assert not RecentFrames().is_still()


@pytest.mark.parametrize(
    ("joints", "way", "is_still"),
    [(["wrist_left", "hand_left", "wrist_right", "hand_right"], 0.15, False), (["foot_left"], 0.5, True)],
)
def test_slow_motion_of_both_arms_is_not_still_and_one_wild_joint_is(still, joints, way, is_still):
    for name in joints:
        still[:, JOINT_INDEX[name], 1] += np.linspace(0, way, 33)
    assert after(still).is_still() == is_still


def test_joints_that_are_lost_are_left_out(still):
    confidence, hand = np.full((33, 20), TRACKED), JOINT_INDEX["hand_left"]
    standing = still[0].copy()
    still[::2, hand] = 1e3
    confidence[::2, hand] = LOST
    last = after(still, confidence)
    assert last.is_still()
    assert_allclose(last.pose(), standing)
    confidence[:, 4:] = LOST
    assert not after(still, confidence).is_still()  # four joints say nothing


def test_a_body_is_known_again_in_another_pose_and_another_body_is_not(standing, dance):
    assert same_body(standing, dance(30)[20])
    assert not same_body(standing, 0.75 * standing)


SENSOR = SensorTilt(10.0, 1.2)


@pytest.fixture
def write_take(record_events, frames, standing, tmp_path):
    """Write a take of users who stand beside each other for two seconds, and of cues."""

    def write(*cues, users=(1,)):
        still = {user: frames(np.tile(standing + np.array([2.0 * user, 0, 0]), (60, 1, 1))) for user in users}
        events = [replace(frame, user=user) for user, seen in still.items() for frame in seen]
        (tmp_path / "take.log").unlink(missing_ok=True)  # a recorder would continue it
        return record_events(tmp_path / "take.log", sorted([*cues, *events], key=attrgetter("time")))

    return write


@pytest.fixture
def calibration(standing):
    """Make calibrations in JSON's types."""

    def make(offset=0.0, user=1):
        return Calibration(standing + np.array([2.0 * user, offset, 0]), SENSOR).to_json() | {"mirror": False}

    return make


def opening(**characters):
    return Cue(0.0, "stage", {"time": 0.0, "characters": characters})


def begin(time, calibration, character="dog"):
    return Cue(time, "begin", {"character": character, "calibration": calibration})


def found(log, user=1):
    clips = read_log(log)
    calibrations, notes = of_performer(clips, next(clip for clip in clips if clip.user == user))
    return calibrations[0].calibration.to_json() if calibrations else None, notes


def same(found, made):
    return found == {name: made[name] for name in ("rest", "sensor")}


def test_the_calibration_in_use_at_the_beginning_is_used_or_else_the_first_later_one(write_take, calibration):
    first, second = calibration(0.1), calibration(0.2)
    started, waiting = ({"user": 1, "calibration": pose} for pose in (first, None))
    for cues, expected, words in (
        ([opening(dog=started), begin(1.0, second)], first, ["when the take began", "again at 1.00 s"]),
        ([opening(dog=waiting), begin(0.5, first), begin(1.0, second)], first, ["at 0.50 s", "again at 1.00 s"]),
        # a part of a take, as the studio writes it
        ([opening(dog=started), begin(0.0, second)], second, ["at 0.00 s"]),
    ):
        used, notes = found(write_take(*cues))
        assert same(used, expected)
        assert [word for word, note in zip(words, notes, strict=True) if word not in note] == []


def test_later_calibrations_and_mirroring_follow_in_their_order_and_repetitions_do_not(write_take, calibration):
    start, later = calibration(0.1), calibration(0.2)
    cues = begin(0.4, start), begin(0.8, start | {"mirror": True}), begin(1.2, later | {"mirror": True})
    (clip,) = read_log(write_take(opening(dog={"user": 1, "calibration": start}), *cues))
    calibrations, _ = of_performer([clip], clip)
    assert [(each.time, each.mirror) for each in calibrations] == [(0.0, False), (0.8, True), (1.2, True)]
    assert [same(each.calibration.to_json(), start) for each in calibrations] == [True, True, False]


def test_each_performer_has_a_calibration_of_their_own(write_take, calibration):
    one, two = calibration(0.1, user=1), calibration(0.1, user=2)
    state = opening(dog={"user": 1, "calibration": one}, cat={"user": None, "calibration": None})
    log = write_take(state, begin(0.5, two, "cat"), users=(1, 2, 3))
    assert same(found(log, 1)[0], one)
    assert same(found(log, 2)[0], two)
    assert found(log, 3) == (None, ())


def test_a_performer_who_was_chosen_for_a_character_has_its_calibration(write_take, calibration):
    remembered = calibration(user=1)  # which fits where another performer is now
    chosen = Cue(0.4, "choose_user", {"character": "dog", "user": 2})
    log = write_take(opening(dog={"user": None}), chosen, begin(0.5, remembered), users=(1, 2))
    assert same(found(log, 2)[0], remembered)
    assert found(log, 1)[0] is None


def test_the_timeline_is_level_and_has_the_calibration_unless_another_time_is_asked_for(
    write_take, calibration, standing
):
    used = calibration(0.1)
    log = write_take(opening(dog={"user": 1, "calibration": used}))
    timeline, _ = load_timeline(log, Settings())
    expected = SENSOR.upright(standing + np.array([2.0, 0, 0]))
    assert_allclose(timeline.positions[0], expected, atol=1e-4)
    assert_allclose(resting_pose(timeline, Settings()), SENSOR.upright(np.array(used["rest"])), atol=1e-12)
    assert_array_equal(timeline.part(3, 9).rest, timeline.rest)
    at_start = Settings(rest_at=0.0)
    timeline, notes = load_timeline(log, at_start)
    assert notes == ()
    assert_allclose(resting_pose(timeline, at_start), standing + np.array([2.0, 0, 0]), atol=1e-4)


LEVEL = {"tilt": 0, "height": 0, "roll": 0}
POINTS = ([0, 0, 0], None, [1e300, 0, 0], [10**400, 0, 0], ["a", "b", "c"])
DAMAGED = [None, "rest", {}, {"rest": []}, *({"rest": [point] * 20, "sensor": LEVEL} for point in POINTS)]


@pytest.mark.parametrize("damaged", DAMAGED)
def test_a_damaged_calibration_is_ignored_with_a_note(write_take, damaged):
    used, notes = found(write_take(begin(0.5, damaged)))
    assert used is None
    assert notes == ("A calibration in the take is damaged and was ignored.",)


CUES_OF_OTHER_FORMS = [
    Cue(0.0, "stage", {}),
    Cue(0.0, "stage", {"characters": [1, 2]}),
    Cue(0.0, "stage", {"characters": {"dog": None, "cat": {"user": [], "calibration": None}}}),
    Cue(0.0, "choose_user", {"character": [], "user": {}}),
]


def test_cues_of_other_forms_are_ignored(write_take, calibration):
    good = calibration()
    unnamed = begin(0.5, good, ["dog"])
    assert same(found(write_take(*CUES_OF_OTHER_FORMS, unnamed))[0], good)
    damaged = begin(0.2, None), begin(0.3, 7)
    used, notes = found(write_take(*CUES_OF_OTHER_FORMS, *damaged, unnamed, users=(1, 2)))
    assert same(used, good)
    assert notes[0] == "2 calibrations in the take are damaged and were ignored."
