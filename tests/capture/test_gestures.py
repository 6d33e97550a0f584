"""Both hands held above the head: found where they are, and nowhere else in any real recording."""

from dataclasses import replace

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES

from capture.formats import read_log
from capture.gestures import HandsUp
from capture.skeleton import JOINT_INDEX, JOINTS, LOST
from puppetline.errors import PuppetlineError

from ..recordings import tracked_frame

REAL = {("joints_s04_e02.txt", second) for second in (96, 124, 136)}
"""Recordings in which somebody holds both hands up for two seconds, and the seconds when."""


def poses(script, fps=30):
    """Yield frames of a performer whose hands are at heights above the head, for seconds each."""
    stands = next(PERFORMANCES["kung_fu"]().frames()).positions
    time = 0.0
    for seconds, heights in script:
        for _ in range(round(seconds * fps)):
            positions = stands.copy()
            for side, height in zip(("left", "right"), heights, strict=True):
                for joint in ("wrist", "hand"):
                    positions[JOINT_INDEX[f"{joint}_{side}"], 1] = stands[JOINT_INDEX["head"], 1] + height
            yield tracked_frame(time, positions)
            time += 1 / fps


def found(frames, seconds=2.0):
    hands = HandsUp(seconds)
    return [round(frame.time, 1) for frame in frames if hands.step(frame)]


UP, DOWN, BESIDE = (0.3, 0.3), (-0.8, -0.8), (-0.1, -0.1)


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ([(1, DOWN), (3, UP), (1, DOWN), (3, UP)], [3.0, 7.0]),
        ([(1, DOWN), (1.9, UP), (1, DOWN)], []),
        ([(1, DOWN), (9, UP)], [3.0]),
        ([(1, DOWN), (3, UP), (1, BESIDE), (3, UP)], [3.0]),  # hands must come down between two gestures
        ([(1, DOWN), (9, (0.3, -0.8))], []),
        ([(1, DOWN), (1, UP), (0.2, BESIDE), (2, UP)], [3.0]),  # a sensor loses hands for a moment
        ([(1, DOWN), (1, UP), (0.6, BESIDE), (1.5, UP)], []),
    ],
)
def test_hands_are_held_for_two_seconds_and_come_down_before_they_count_again(script, expected):
    assert found(poses(script)) == expected


def test_hands_that_are_lost_are_no_gesture_and_wrists_stand_for_lost_hands():
    frames = list(poses([(1, DOWN), (3, UP)]))
    assert found(replace(each, confidence=np.full(20, LOST, np.float32)) for each in frames) == []
    known = np.array(["hand" not in joint for joint in JOINTS], np.float32)
    assert found(replace(each, confidence=known) for each in frames) == [3.0]


@pytest.mark.exhaustive
def test_no_real_recording_starts_anything_unless_somebody_gives_the_signal(real_data):
    starts, clips = set(), 0
    for path in sorted([*(real_data / "logs").rglob("*"), *(real_data / "bvh").rglob("*")]):
        try:
            performers = read_log(path) if path.is_file() else []
        except PuppetlineError:
            continue
        for clip in performers:
            clips += 1
            starts |= {(path.name, round(at - clip.times[0])) for at in found(clip.frames())}
    assert clips > 150
    assert starts == REAL
