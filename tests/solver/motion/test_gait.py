"""When legs step, as plain Python functions."""

import numpy as np
import pytest

from solver.motion.gait import DUTY, PHASE, RATE, WALKS, new_gait, phases

TICK = 1 / 60
LEG = 0.8
NATURAL = np.sqrt(9.81 * LEG)
REST, LEFT_UP, RIGHT_UP = (False, False), (True, False), (False, True)


@pytest.fixture(scope="module")
def play(interpreted):
    """Return a function from the motion of a body and its performer's feet to the states of a gait, frame by frame."""
    update = interpreted("solver.motion.gait").update

    def states(
        speed, lifted=lambda time: REST, seconds=4.0, gait=None, resting=False, lost=False, scale=1.0, start=0.0
    ):
        gait = new_gait() if gait is None else gait
        found = []
        for number in range(1, round(seconds / TICK)):
            time = start + number * TICK
            up = np.array(lifted(time))
            update(gait, time, TICK, up, ~up & resting, lost, scale * speed, scale * LEG, scale)
            found.append(gait.copy())
        return np.array(found)

    return states


def alternating(period):
    return lambda time: (
        LEFT_UP if time % period < 0.3 * period else RIGHT_UP if 0.5 < time % period / period < 0.8 else REST
    )


@pytest.mark.parametrize("speed", [0.6, 0.8, 0.95])
def test_a_stride_is_as_long_as_that_of_animals_of_the_same_froude_number(play, speed):
    last = play(speed)[-1]

    stride = 2.3 * LEG * (speed / NATURAL) ** 0.6
    assert last[WALKS] == 1
    assert last[RATE] == pytest.approx(speed / stride)


def test_a_faster_body_has_its_feet_on_the_floor_for_less_time_but_never_less_than_half(play):
    duties = [play(speed)[-1, DUTY] for speed in (0.4, 1.0, 1.6, 2.5)]

    assert duties == sorted(duties, reverse=True)
    assert duties[0] < 0.75
    assert duties[-1] == 0.5


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_the_unit_of_the_mesh_does_not_matter(play, scale):
    assert np.allclose(play(1.1, scale=scale), play(1.1))


def test_a_body_walks_on_until_it_is_slower_than_when_it_began(play):
    gait = new_gait()
    walks = [play(speed * NATURAL, gait=gait)[-1, WALKS] for speed in (0.11, 0.13, 0.08, 0.05)]

    assert walks == [0, 1, 1, 0]


def test_a_performer_whose_feet_rest_stands_whatever_the_hips_do(play):
    assert not play(1.0, resting=True)[:, WALKS].any()


def test_a_performer_who_stands_does_so_until_both_feet_have_stepped(play):
    gait = new_gait()
    play(0.0, resting=True, seconds=1.0, gait=gait)

    assert not play(1.0, seconds=1.0, gait=gait)[:, WALKS].any()  # a foot shakes
    assert play(1.0, alternating(0.8), seconds=2.0, gait=gait)[-1, WALKS] == 1


def test_a_performer_whose_feet_are_lost_walks_if_the_hips_do(play):
    gait = new_gait()
    play(0.0, resting=True, seconds=1.0, gait=gait)

    assert play(1.0, seconds=1.0, gait=gait, lost=True)[-1, WALKS] == 1


@pytest.mark.parametrize("period", [0.8, 1.1])
def test_a_walk_in_place_has_the_performers_cadence_and_phase_and_ends_when_the_feet_stop(play, period):
    gait = new_gait()
    states = play(0.0, alternating(period), seconds=8 * period, gait=gait)

    assert states[-1, WALKS] == 1
    assert 1 / states[-1, RATE] == pytest.approx(period, rel=0.05)
    lifts = round(7 * period / TICK)  # the left foot has just lifted
    assert abs((states[lifts, PHASE] + 0.5) % 1 - 0.5) < 0.1
    assert play(0.0, gait=gait, start=8 * period, seconds=2.0)[-1, WALKS] == 0


def test_two_legs_alternate_and_four_walk_one_after_the_other_and_trot_in_diagonal_pairs():
    assert phases(np.array([0, 1]), np.array([0, 0])).tolist() == [[0.0, 0.0], [0.5, 0.5]]
    four = phases(np.array([0, 1, 0, 1]), np.array([0, 0, 1, 1]))  # both hind legs, then both front legs
    assert four.tolist() == [[0.0, 0.0], [0.5, 0.5], [0.25, 0.5], [0.75, 0.0]]


@pytest.mark.parametrize("pairs", [3, 4])
def test_more_legs_walk_in_two_groups_of_neighbours_that_alternate(pairs):
    found = phases(np.repeat([0, 1], pairs), np.tile(np.arange(pairs), 2)).reshape(2, pairs, 2)

    assert np.array_equal(found[..., 0], found[..., 1])
    assert np.all(np.abs(np.diff(found[..., 1], axis=0)) == 0.5)
    assert np.all(np.abs(np.diff(found[..., 1], axis=1)) == 0.5)


def test_a_leg_lifts_when_the_gait_reaches_its_phase(interpreted):
    share, gait = interpreted("solver.motion.gait").share_of_stride, new_gait()
    gait[PHASE] = 0.25

    assert [share(gait, offsets) for offsets in ((0.25, 0.5), (0.0, 0.5))] == [0.0, 0.25]
