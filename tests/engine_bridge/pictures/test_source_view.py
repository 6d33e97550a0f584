from dataclasses import replace

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES

from capture.sensors.diagnosis import Problem, diagnose
from capture.sensors.picture_jpeg import shaded
from capture.sensors.source_report import SourceReport
from capture.skeleton import JOINT_INDEX, SkeletonFrame
from capture.trackers.picture import Lens, Picture
from engine_bridge.pictures.source_view import (
    INFERRED_COLOR,
    OK_COLOR,
    PANEL,
    PANEL_HEIGHT,
    PERFORMER_COLORS,
    PROBLEM_COLOR,
    draw,
)

GAP = 12
LENS = Lens(320, 240, 262.5)
POSE = PERFORMANCES["walk"]().positions[0]
BLUE = PERFORMER_COLORS[0]
USER = len(PERFORMER_COLORS)
"""User number that has the first colour."""


def report_of(confidence=1.0, picture=None, pose=POSE):
    report = SourceReport("test:", False, picture=picture)
    report.add(SkeletonFrame(0.0, USER, pose, np.full(20, 1, np.float32) * confidence))
    return report


def drawn(report, why=()):
    return np.asarray(draw(report, why)).astype(int)


def near(image, place, color):
    """Return whether the pixel at (right, down) has about that colour."""
    x, y = np.rint(place).astype(int)
    return bool(np.abs(image[y, x] - color).max() < 40)


def places_of(image, color):
    """Return the (n, 2) pixels right and down that have that colour."""
    return np.argwhere(np.abs(image - color).max(axis=2) < 8)[:, ::-1]


@pytest.fixture
def picture():
    return Picture(0.0, LENS, np.full((240, 320, 3), (90, 40, 140), np.uint8), np.full((240, 320), 4.0, np.float32))


def test_joints_are_drawn_where_the_lens_projects_them_on_colour_and_depth(picture):
    confidence = np.ones(20)
    confidence[JOINT_INDEX["knee_left"]] = 0.5
    image = drawn(report_of(confidence, picture))
    for panel, color in enumerate([(90, 40, 140), shaded(picture.depth)[0, 0]]):
        corner = np.array([GAP + panel * (640 + GAP), GAP])
        for name, index in JOINT_INDEX.items():
            place = corner + 2 * LENS.project(POSE[index])
            assert near(image, place, INFERRED_COLOR if name == "knee_left" else BLUE), name
        left = image[GAP + 100 : GAP + PANEL_HEIGHT, corner[0] : corner[0] + 150]
        np.testing.assert_array_equal(left, np.broadcast_to(color, left.shape))


def test_lost_joints_and_those_behind_the_sensor_are_not_drawn(picture):
    confidence = np.ones(20)
    confidence[[JOINT_INDEX[name] for name in ("wrist_left", "hand_left")]] = 0
    behind = POSE.copy()
    behind[JOINT_INDEX["head"], 2] = -1
    image, shown = drawn(report_of(confidence, picture, behind)), drawn(report_of(1, picture))
    hand, neck = ([GAP, GAP] + 2 * LENS.project(POSE[JOINT_INDEX[name]]) for name in ("hand_left", "shoulder_center"))
    for place in (hand, neck - [0, 15]):
        assert near(shown, place, BLUE)
        assert not near(image, place, BLUE)
    assert near(image, neck, BLUE)


def test_without_an_image_performers_are_drawn_from_the_front_with_the_right_hand_on_the_left():
    confidence = np.ones(20)
    confidence[JOINT_INDEX["hand_right"]] = 0.5
    front = drawn(report_of(confidence))[GAP : GAP + PANEL_HEIGHT, GAP : GAP + PANEL_HEIGHT]
    body, hand = places_of(front, BLUE), places_of(front, INFERRED_COLOR).mean(axis=0)
    assert hand[0] < body[:, 0].mean()
    assert hand[1] > body[:, 1].min()


def test_from_above_the_distances_to_the_sensor_are_true():
    image = drawn(report_of())
    above = image[GAP : GAP + PANEL_HEIGHT, 2 * GAP + PANEL_HEIGHT : 2 * GAP + 2 * PANEL_HEIGHT]
    # the view spans the sensor and the farthest joint
    size = POSE[:, 2].max()
    pixels = PANEL_HEIGHT / (1.3 * size)
    across = PANEL_HEIGHT / 2 + (POSE[:, 0].max() + POSE[:, 0].min()) / 2 * pixels
    sensor = np.array([across, PANEL_HEIGHT / 2 + size / 2 * pixels])
    for index in (JOINT_INDEX["foot_left"], JOINT_INDEX["foot_right"], JOINT_INDEX["head"]):
        assert near(above, sensor - POSE[index, [0, 2]] * pixels, BLUE)


def test_a_report_without_performers_is_drawn_too():
    image = drawn(SourceReport("osc:7110", True), [Problem("No packet received for 10 s.", "Start the sender.")])
    assert image.shape[:2] > (PANEL_HEIGHT, 2 * PANEL_HEIGHT)
    assert len(places_of(image[:PANEL_HEIGHT], PANEL)) > PANEL_HEIGHT * PANEL_HEIGHT
    assert len(places_of(image[:PANEL_HEIGHT], BLUE)) == 0


def test_problems_are_written_below_in_their_own_colour(picture):
    for shown, is_bad in ((replace(picture, color=picture.color * 0), True), (picture, False)):
        report = report_of(1, shown)
        words = drawn(report, diagnose(report))[PANEL_HEIGHT + GAP :]
        assert (len(places_of(words, PROBLEM_COLOR)) > 0) == is_bad
        assert is_bad or len(places_of(words, OK_COLOR)) > 0
