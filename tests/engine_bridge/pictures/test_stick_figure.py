import numpy as np
import pytest

from capture.skeleton import JOINT_INDEX, PARENTS
from engine_bridge.pictures import stick_figure
from engine_bridge.pictures.view import View, project

SIZE = (180, 320)
VIEW = View(0.0, 0.0, (0.0, 0.0, 0.0), 1.0)


def of_color(picture, color):
    return (np.abs(picture.astype(int) - color) < 3).all(axis=-1)


def test_a_single_bone_is_a_line_between_its_joints_in_the_colour_of_its_side():
    for joint, color in (("elbow_left", stick_figure.LEFT), ("elbow_right", stick_figure.RIGHT)):
        alone = np.full((20, 3), np.nan)
        alone[JOINT_INDEX[joint]], alone[JOINT_INDEX[PARENTS[joint]]] = [0.5, 1.0, 0], [-0.5, -1.0, 0]
        row, column = np.nonzero(of_color(stick_figure.draw(alone, VIEW, SIZE), color))
        ends = project(np.array([[-0.5, -1.0, 0], [0.5, 1.0, 0]]), VIEW, SIZE)
        along = (ends[1] - ends[0])[:2] / np.linalg.norm((ends[1] - ends[0])[:2])
        away = np.column_stack([column, row]) + 0.5 - ends[0, :2]
        assert np.abs(away @ [-along[1], along[0]]).max() <= stick_figure.BONE_WIDTH * 180 / 2 + 1
        assert (away @ along).min() == pytest.approx(0, abs=3)
        assert (away @ along).max() == pytest.approx(np.linalg.norm(ends[1] - ends[0]), abs=3)


def test_the_nearer_arm_covers_the_other():
    """The bones cross in the centre of the image."""
    for front, color in ((1.0, stick_figure.LEFT), (-1.0, stick_figure.RIGHT)):
        crossed = np.full((20, 3), np.nan)
        for side, z, tilt in (("left", front, 0.5), ("right", -front, -0.5)):
            crossed[JOINT_INDEX[f"shoulder_{side}"]] = [-0.5, -tilt, z]
            crossed[JOINT_INDEX[f"elbow_{side}"]] = [0.5, tilt, z]
        assert of_color(stick_figure.draw(crossed, VIEW, SIZE)[160, 90], color)
