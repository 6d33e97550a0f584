import numpy as np
import pytest

from capture.skeleton import JOINT_INDEX, PARENTS
from engine_bridge.pictures import stick_figure
from engine_bridge.pictures.view import View, project

SIZE = (180, 320)
VIEW = View(0.0, 0.0, (0.0, 0.0, 0.0), 1.0)


def of_color(picture, color):
    return (np.abs(picture.astype(int) - color) < 3).all(axis=-1)


@pytest.mark.parametrize(("joint", "color"), [("elbow_left", stick_figure.LEFT), ("elbow_right", stick_figure.RIGHT)])
def test_a_single_bone_is_a_line_between_its_joints_in_the_colour_of_its_side(joint, color):
    ends, alone = np.array([[-0.5, -1.0, 0], [0.5, 1.0, 0]]), np.full((20, 3), np.nan)
    alone[[JOINT_INDEX[PARENTS[joint]], JOINT_INDEX[joint]]] = ends
    drawn = np.argwhere(of_color(stick_figure.draw(alone, VIEW, SIZE), color))[:, ::-1] + 0.5
    start, end = project(ends, VIEW, SIZE)[:, :2]
    length = np.linalg.norm(end - start)
    x, y = (end - start) / length
    along, beside = ((drawn - start) @ [[x, -y], [y, x]]).T
    assert np.abs(beside).max() <= stick_figure.BONE_WIDTH * 180 / 2 + 1
    assert [along.min(), along.max()] == pytest.approx([0, length], abs=3)


@pytest.mark.parametrize(("front", "color"), [(1.0, stick_figure.LEFT), (-1.0, stick_figure.RIGHT)])
def test_the_nearer_arm_covers_the_other(front, color):
    """The bones cross in the centre of the image."""
    crossed = np.full((20, 3), np.nan)
    for side, out in (("left", 1), ("right", -1)):
        ends = [JOINT_INDEX[f"{joint}_{side}"] for joint in ("shoulder", "elbow")]
        crossed[ends] = [[-0.5, -0.5 * out, front * out], [0.5, 0.5 * out, front * out]]
    assert of_color(stick_figure.draw(crossed, VIEW, SIZE)[160, 90], color)
