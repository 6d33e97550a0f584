"""Tails that follow late, as plain Python functions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.motion.limbs import Limb, bones_of

from ..shapes import assert_joined

DELAY = 0.3
TRUNK = Limb("trunk", np.array([[0, 1.0, 0], [0, 1.0, 1.0]]), ((0,), (1,)))
TAIL = Limb(
    "tail", np.array([[0, 1.0, -0.1], [0, 1, -0.5], [0, 1, -1.0]]), ((0,), (1,), (1,)), parent="trunk", delay=DELAY
)
LIMBS = (TRUNK, TAIL)
BONES = bones_of(LIMBS)
UP = np.array([0, 1.0, 0])


def turned(angle):
    """Motions of all bones when the body turns about the upright axis."""
    T = np.zeros((3, 4, 3))
    T[:, :3] = Rotation.from_rotvec(angle * UP).as_matrix().T
    return T


@pytest.fixture(scope="module")
def play(interpreted):
    """Return a function from the headings of a body to those of its bones (T, b), and their motions."""
    module = interpreted("solver.motion.late_limbs")

    def headings_and_motions(angles, tick=1 / 60, roots=None, limbs=LIMBS):
        late, headings, motions = module.LateLimbs(limbs, BONES), [], []
        for number, angle in enumerate(angles):
            T = turned(angle)
            late.step(number * tick, T, np.zeros(3) if roots is None else roots[number])
            headings.append(np.arctan2(T[:, 2, 0], T[:, 2, 2]))
            motions.append(T)
        return np.array(headings), np.array(motions)

    return headings_and_motions


def test_the_tip_follows_a_steady_turn_by_the_delay_and_the_base_by_less(play):
    speed, tick = 0.5, 1 / 240
    headings, _ = play(speed * np.arange(0, 6, tick), tick, limbs=LIMBS)

    lags = (headings[-1, 0] - headings[-1]) / speed
    # the sway against the moving base is small, because the tail begins near the axis of the turn
    assert lags[2] == pytest.approx(DELAY, rel=0.1)
    assert lags[1] == pytest.approx(DELAY / 2, rel=0.1)
    assert lags[0] == 0


def test_a_tail_comes_to_rest_where_it_would_be_without_a_delay(play):
    headings, motions = play(np.full(300, 0.8) * (np.arange(300) > 0))

    assert np.allclose(motions[-1], turned(0.8), atol=1e-6)
    assert headings[:, 2].max() < 0.9


@pytest.mark.parametrize("tick", [1 / 15, 1 / 120])
def test_it_does_not_depend_on_the_frame_rate_how_far_a_tail_has_come(play, tick):
    count = round(0.4 / tick) + 1
    headings, _ = play(np.concatenate([[0], np.full(count - 1, 0.5)]), tick)
    rate, time = 2 / DELAY, 0.4

    left = (1 + rate * time) * np.exp(-rate * time)  # critically damped, from rest
    assert headings[-1, 2] == pytest.approx(0.5 * (1 - left), abs=0.06)


def test_bones_of_a_tail_stay_joined_to_each_other_and_to_the_body(play):
    _, motions = play(np.sin(np.arange(100) / 9))

    for T in motions:
        assert_joined(BONES, T)


def test_a_tail_swings_back_when_the_body_starts_sideways(play):
    roots = np.zeros((30, 3))
    roots[:, 0] = np.arange(30) / 60
    headings, _ = play(np.zeros(30), roots=roots)

    assert headings[3, 2] > 0.01  # its tip, behind the body, stays to the right


def test_limbs_without_a_delay_are_not_changed(play):
    angles = np.sin(np.arange(50) / 5)
    _, motions = play(angles, limbs=(TRUNK, Limb("tail", TAIL.points, TAIL.joints, parent="trunk")))

    assert np.array_equal(motions, [turned(angle) for angle in angles])
