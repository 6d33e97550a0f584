import numpy as np
import pytest
from PIL import ImageFont
from puppetline.examples.performances import PERFORMANCES

from capture.sensors.source_report import Reason, Sight, reasons
from capture.skeleton import JOINT_INDEX, SkeletonFrame
from capture.trackers.picture import Lens, Picture
from engine_bridge.pictures import source_view
from engine_bridge.pictures.source_view import GUESSED, HEIGHT, PANEL, PERFORMERS, draw, shaded

GAP = 12
LENS = Lens(320, 240, 262.5)
POSE = PERFORMANCES["walk"]().positions[0]
BLUE = PERFORMERS[0]
USER = len(PERFORMERS)
"""Whose colour is the first."""


def sight_of(confidence=1.0, picture=None, pose=POSE):
    sight = Sight("test:", False, picture=picture)
    sight.take(SkeletonFrame(0.0, USER, pose, np.full(20, 1, np.float32) * confidence))
    return sight


def drawn(sight, why=()):
    return np.asarray(draw(sight, why)).astype(int)


def near(image, place, color):
    """Say whether a pixel at (right, down) is of that colour, or mostly."""
    x, y = np.rint(place).astype(int)
    return bool(np.abs(image[y, x] - color).max() < 40)


def places_of(image, color):
    """Return the (n, 2) pixels right and down that are of that colour."""
    return np.argwhere(np.abs(image - color).max(axis=2) < 8)[:, ::-1]


@pytest.fixture
def picture():
    return Picture(0.0, LENS, np.full((240, 320, 3), (90, 40, 140), np.uint8), np.full((240, 320), 4000, np.uint16))


def test_joints_are_drawn_where_the_lens_sees_them_in_colour_and_in_depth(picture):
    sure = np.ones(20)
    sure[JOINT_INDEX["knee_left"]] = 0.5
    image = drawn(sight_of(sure, picture))
    for panel in range(2):
        corner = np.array([GAP + panel * (640 + GAP), GAP])
        for name, index in JOINT_INDEX.items():
            place = corner + 2 * LENS.project(POSE[index])
            assert near(image, place, GUESSED if name == "knee_left" else BLUE), name
    background = [(90, 40, 140), shaded(picture.depth)[0, 0]]
    for panel, color in enumerate(background):
        left = GAP + panel * (640 + GAP)
        np.testing.assert_array_equal(
            image[GAP + 100 : GAP + HEIGHT, left : left + 150], np.broadcast_to(color, (380, 150, 3))
        )


def test_what_is_not_known_is_not_drawn(picture):
    sure = np.ones(20)
    sure[[JOINT_INDEX[name] for name in ("wrist_left", "hand_left")]] = 0
    image = drawn(sight_of(sure, picture))
    shown = drawn(sight_of(1, picture))
    hand = [GAP, GAP] + 2 * LENS.project(POSE[JOINT_INDEX["hand_left"]])
    assert near(shown, hand, BLUE)
    assert near(image, hand, (90, 40, 140))


def test_a_joint_behind_the_sensor_is_not_drawn(picture):
    behind = POSE.copy()
    behind[JOINT_INDEX["head"], 2] = -1
    image = drawn(sight_of(1, picture, behind))
    neck = [GAP, GAP] + 2 * LENS.project(POSE[JOINT_INDEX["shoulder_center"]])
    assert near(image, neck, BLUE)
    assert not near(image, neck - [0, 15], BLUE)


def test_without_a_picture_the_performer_stands_on_the_floor_their_right_hand_on_the_left():
    sure = np.ones(20)
    sure[JOINT_INDEX["hand_right"]] = 0.5
    image = drawn(sight_of(sure))
    front = image[GAP : GAP + HEIGHT, GAP : GAP + HEIGHT]
    body = places_of(front, BLUE)
    hand = places_of(front, GUESSED)
    assert hand[:, 0].mean() < body[:, 0].mean()
    assert hand[:, 1].mean() > body[:, 1].min()


def test_from_above_the_performer_is_as_far_from_the_sensor_as_in_truth():
    image = drawn(sight_of())
    above = image[GAP : GAP + HEIGHT, 2 * GAP + HEIGHT : 2 * GAP + 2 * HEIGHT]
    # everything from the sensor to the farthest joint is shown, the sensor in the middle from side to side
    size = POSE[:, 2].max()
    pixels = HEIGHT / (1.3 * size)
    across = HEIGHT / 2 + (POSE[:, 0].max() + POSE[:, 0].min()) / 2 * pixels
    sensor = np.array([across, HEIGHT / 2 + size / 2 * pixels])
    for index in (JOINT_INDEX["foot_left"], JOINT_INDEX["foot_right"], JOINT_INDEX["head"]):
        place = sensor - POSE[index, [0, 2]] * pixels
        assert near(above, place, BLUE)


def test_an_empty_room_is_drawn_too():
    image = drawn(Sight("osc:7110", True), [Reason("Nothing has come in 10 s.", "Start the sender.")])
    assert image.shape[:2] > (HEIGHT, 2 * HEIGHT)
    assert len(places_of(image[:HEIGHT], PANEL)) > HEIGHT * HEIGHT
    assert len(places_of(image[:HEIGHT], BLUE)) == 0


def test_what_is_amiss_is_written_below_in_its_own_colour(picture):
    black = Picture(0.0, LENS, picture.color * 0, picture.depth)
    bad, good = sight_of(1, black), sight_of(1, picture)
    assert len(places_of(drawn(bad, reasons(bad))[HEIGHT + GAP :], source_view.AMISS)) > 0
    words = drawn(good, reasons(good))[HEIGHT + GAP :]
    assert len(places_of(words, source_view.AMISS)) == 0
    assert len(places_of(words, source_view.WELL)) > 0


def test_depth_is_lighter_the_nearer_it_is_and_violet_where_there_is_none():
    depth = np.repeat(np.array([[1000, 2000, 3000, 4000]], np.uint16), 9, axis=0).repeat(9, axis=1)
    grey = shaded(depth)[4, 4::9].astype(int)
    assert (np.diff(grey[:, 0]) < 0).all()
    assert (grey == grey[:, :1]).all()
    np.testing.assert_array_equal(shaded(depth * 0), np.broadcast_to((52, 26, 66), (9, 36, 3)))


def test_long_texts_are_broken_between_words_and_lose_none():
    text = " ".join(f"{'wide' * (n % 4 + 1)}{n}" for n in range(60))
    lines = source_view._wrapped(text, 15, 300)
    assert " ".join(lines) == text
    assert all(ImageFont.load_default(15).getlength(line) <= 300 for line in lines)
    assert source_view._wrapped("unbreakable" * 20, 15, 50) == ["unbreakable" * 20]
    assert source_view._wrapped("", 15, 50) == []
