import json
from dataclasses import replace

import numpy as np
import pytest

from capture.sensor_tilt import SensorTilt
from capture.sensors.diagnosis import FROZEN_FRAMES, Problem, describe, diagnose, status_line, summary
from capture.skeleton import JOINT_INDEX, JOINTS
from capture.trackers.picture import Picture

from .reports import LENS, WALK, frame, report_of

COLOR = np.full((480, 640, 3), 120, np.uint8)
DEPTH = np.full((480, 640), 3.0, np.float32)


def problems(*arguments, **attributes):
    """Return what is wrong in a report of these frames and attributes."""
    return [problem.what for problem in diagnose(report_of(*arguments, **attributes))]


def picture(color=COLOR, depth=DEPTH):
    return Picture(0.0, LENS, color, depth)


@pytest.mark.parametrize("shown", [None, picture(), picture(depth=None), picture(color=None)])
def test_a_performer_who_is_tracked_well_has_no_problem(shown):
    report = report_of(map(frame, range(60)), shown)
    assert diagnose(report) == []
    assert describe(report.performers[1]) == "user 1: 20 of 20 joints tracked, 2.78 m away, 30 frames per second"


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        ({"listens": True, "received": 0, "silent": 3.2}, ["No packet received for 3 s."]),
        ({"listens": False, "received": 0, "silent": 3.2}, ["No image received for 3 s."]),
        ({"listens": True, "received": 7}, ["Packets arrive, but without a performer."]),
        (
            {"listens": True, "received": 1007, "refused": {"unknown message": 1000, "not OSC": 7}},
            ["Packets arrived, but none were understood: not OSC (7 ×), unknown message (1000 ×)."],
        ),
        ({"picture": picture()}, ["No performer is in view."]),
        ({"picture": picture(COLOR * 0)}, ["The image is black.", "No performer is in view."]),
        ({"picture": picture(COLOR // 5)}, ["The image is dark.", "No performer is in view."]),
        ({"picture": picture(depth=DEPTH * 0)}, ["The sensor measures no depth.", "No performer is in view."]),
        (
            {"picture": picture(COLOR * 0, DEPTH * (np.arange(640) < 64).astype(np.float32))},
            ["The image is black.", "The sensor measures depth in 10% of the image.", "No performer is in view."],
        ),
    ],
)
def test_without_a_performer_causes_come_in_order_and_each_has_a_fix(attributes, expected):
    found = diagnose(report_of(**attributes))
    assert [problem.what for problem in found] == expected
    assert all(problem.fix for problem in found)


def test_an_error_and_performers_who_have_left_have_no_fix_of_their_own():
    assert diagnose(report_of(failure="freenect: found no Kinect")) == [Problem("freenect: found no Kinect")]
    assert problems(picture=picture(), gone={4, 2}) == [
        "No performer is in view.",
        "User 2 has left.",
        "User 4 has left.",
    ]


def test_a_pose_that_never_changes_is_a_problem():
    same = [replace(frame(0), time=number / 30) for number in range(FROZEN_FRAMES)]
    assert problems(same) == [f"User 1 does not move: {FROZEN_FRAMES} frames have exactly the same pose."]
    assert problems(same[1:]) == []
    assert problems([*same, frame(FROZEN_FRAMES)]) == []


def test_inferred_and_lost_joints_are_named_in_plain_words():
    confidence = np.ones(20, np.float32)
    confidence[JOINT_INDEX["foot_left"]] = 0
    assert problems([replace(frame(0), confidence=confidence)]) == ["User 1: lost joints: left foot."]
    confidence[:] = 1
    confidence[:8] = 0.5  # no more than what senders of 15 joints leave out
    assert problems([replace(frame(0), confidence=confidence)]) == []
    confidence[8] = 0.3
    (inferred,) = problems([replace(frame(0), confidence=confidence)])
    confidence[19] = 0  # lost, and so not inferred
    assert problems([replace(frame(0), confidence=confidence)])[1] == inferred
    assert inferred == (
        "User 1: 9 of 20 joints are inferred: hip center, spine, shoulder center, head, left shoulder, left elbow, "
        "left wrist, left hand, right shoulder."
    )


def test_joints_outside_the_image_are_named():
    head = WALK.positions[0, JOINT_INDEX["head"]]
    high = (0, 240 / 525 * head[2] - head[1] + 0.01, 0)  # the head is a centimetre above the upper edge
    assert problems([frame(0, moved=high)], picture()) == ["User 1: joints outside the image: head."]
    assert problems([frame(0, moved=high)]) == []


@pytest.mark.parametrize("away", [0.6, 5.0])
def test_a_distance_out_of_the_range_of_depth_is_a_problem(away):
    moved = frame(0, moved=(0, 0, away - np.median(WALK.positions[0, :, 2])))
    assert f"User 1 is {away:.1f} m away." in problems([moved], picture())
    assert f"User 1 is {away:.1f} m away." not in problems([moved], picture(depth=None))


def test_the_summary_is_json():
    half = picture(depth=DEPTH * (np.arange(640) < 320).astype(np.float32))
    report = report_of(map(frame, range(60)), half, sensor_tilt=SensorTilt(12.2, 1.304, -2.6))
    plain = json.loads(json.dumps(summary(report, [Problem("a", "b")]), allow_nan=False))
    assert plain["picture"] == {"width": 640, "height": 480, "brightness": 120.0, "depth_known": 0.5}
    assert plain["sensor"] == {"tilt": 12.2, "height": 1.304, "roll": -2.6}
    assert plain["reasons"] == [{"what": "a", "fix": "b"}]
    (performer,) = plain["performers"]
    assert performer["confidence"] == dict.fromkeys(JOINTS, 1.0)
    assert (performer["user"], performer["joints_seen"]) == (1, 20)
    assert performer["rate"] == pytest.approx(30)


def test_a_status_line_has_the_problem_then_the_fix_then_the_performers():
    still = report_of([replace(frame(0), time=number / 30) for number in range(FROZEN_FRAMES + 10)])
    assert status_line(still) == (
        f"User 1 does not move: {FROZEN_FRAMES + 10} frames have exactly the same pose. · "
        "Check whether the sender tracks a performer, or only shows a character at rest. · "
        f"user 1: 20 of 20 joints tracked, {still.performers[1].distance:.2f} m away, 30 frames per second"
    )
    well = report_of([frame(number, user) for number in range(20) for user in (2, 1)])
    performers = [describe(well.performers[user]) for user in (1, 2)]
    assert status_line(well) == " · ".join(["No problems found.", *performers])
    failed = report_of(failure="driver\x1b[2Jfail\red\n[bold]x[/]")
    assert status_line(failed) == "driver [2Jfail ed [bold]x[/]"


def test_joints_that_never_arrive_are_told_from_those_that_are_lost_now():
    def sent(step, names):
        seen = frame(step)
        known = np.isin(JOINTS, names)
        return replace(
            seen, positions=np.where(known[:, None], seen.positions, np.nan), confidence=known.astype(np.float32)
        )

    frames = [*(sent(step, ["head", "hand_left"]) for step in range(30)), sent(30, ["head"])]
    never, lost = diagnose(report_of(frames, listens=True))[:2]
    assert never.what.startswith("User 1: 18 of 20 joints never arrive: the sender sends 2.")
    assert lost.what == "User 1: lost joints: left hand."
    assert diagnose(report_of(frames, listens=False))[0].what.startswith("User 1: lost joints: hip center, spine,")
