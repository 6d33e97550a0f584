import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from solver.motion.retarget import LIMIT_KNEE_SHARE, RETURN_SECONDS, Fit, Mapping, Retargeter, soft_limit

JOINTS = 20
HANDLES = np.array([[0.0, 2.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.5]])
ALL = np.ones(JOINTS, dtype=np.float32)
UNLIMITED = np.full((3, 3, 2), np.inf)


def mapping(rows, axes=((True,) * 3,) * 3, gain=(1.0, 1.0, 1.0)):
    """Return a mapping with one handle per row {joint: share}."""
    matrix = np.zeros((len(rows), JOINTS))
    for row, joints in zip(matrix, rows, strict=True):
        for joint, share in joints.items():
            row[joint] = share
    return Mapping(matrix, np.array(axes), np.array(gain))


@pytest.fixture
def usual():
    """One joint, the average of two, and the same joint again with one axis only and gains."""
    return mapping(
        [{3: 1.0}, {7: 0.5, 11: 0.5}, {3: 1.0}], axes=[[1, 1, 1], [1, 0, 1], [0, 1, 0]], gain=[1.0, 1.5, -0.5]
    )


@pytest.fixture
def fit():
    return Fit(np.array([2.0, 0.5, 3.0]), UNLIMITED)


@pytest.fixture
def walk():
    return np.random.default_rng(0).normal(scale=0.05, size=(200, JOINTS, 3)).cumsum(axis=0) + 1.0


def retargeter(mapping, fit, calibration=None, basis=None):
    return Retargeter(HANDLES, mapping, fit, np.zeros((JOINTS, 3)) if calibration is None else calibration, basis)


def moved(by):
    """All joints at rest, but for joint 3."""
    positions = np.zeros((JOINTS, 3))
    positions[3] = by
    return positions


# --- Eq. 6-7


def accumulated(positions, mapping, scale):
    """Sum joint motion (T, j, 3) from frame to frame as the paper does: how far each handle has moved (T, h, 3)."""
    motion = np.diff(positions, axis=0, prepend=positions[:1])
    steps = (mapping.matrix @ motion) * mapping.axes * (scale * mapping.gain)[:, None]
    return np.cumsum(steps, axis=0)


def test_the_sum_of_motions_is_the_displacement_while_every_joint_is_tracked(usual, fit, walk):
    expected = HANDLES + accumulated(walk, usual, fit.scale)
    stepwise = retargeter(usual, fit, calibration=walk[0])
    found = [stepwise.step(0.033 * t, frame, ALL) for t, frame in enumerate(walk)]
    assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert_allclose(stepwise.targets(walk - walk[0]), expected, rtol=0, atol=1e-9)


# --- which axes, how far


def test_the_basis_takes_the_performers_axes_to_those_of_the_mesh_in_which_reach_is_given():
    """A character with z up that faces −y: its left is +x, as the performer's."""
    reach = UNLIMITED.copy()
    reach[:, 2, 1] = 0.05  # little room upwards, that is along +z
    which = mapping([{3: 1.0}, {3: 1.0}, {3: 1.0}], axes=[[1, 1, 1], [0, 1, 0], [0, 0, 1]])
    found = retargeter(which, Fit(np.ones(3), reach), basis=np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]))
    down = found.step(0.0, moved([0.1, -0.2, 0.3]), ALL) - HANDLES
    assert_allclose(down, [[0.1, -0.3, -0.2], [0, 0, -0.2], [0, -0.3, 0]], atol=1e-12)
    up = found.targets(moved([0.0, 10.0, 0.0])) - HANDLES
    assert_allclose(up, [[0, 0, 0.05], [0, 0, 0.05], [0, 0, 0]], atol=1e-9)


def test_gain_widens_the_reach_as_well():
    reach = np.full((3, 3, 2), 0.2)
    far = retargeter(mapping([{3: 1.0}] * 3, gain=[1, 2, 0]), Fit(np.ones(3), reach)).targets(moved([9.0, 0, 0]))
    assert_allclose(far - HANDLES, [[0.2, 0, 0], [0.4, 0, 0], [0, 0, 0]], atol=1e-9)


# --- lost joints


INVALID = np.nan, np.inf, -np.inf, 1e7, 1e160, 1e300


def test_a_joint_that_is_lost_or_has_no_valid_position_is_held_where_it_was(usual, fit):
    stepwise = retargeter(usual, fit)
    before = stepwise.step(0.0, moved([0.1, 0.2, 0.3]), ALL)
    lost = ALL.copy()
    lost[3] = 0
    frames = [([5.0, 6.0, -7.0], lost), *((np.where(axis, value, 0.1), ALL) for value in INVALID for axis in np.eye(3))]
    for number, (position, confidence) in enumerate(frames, 1):
        assert_array_equal(stepwise.step(0.033 * number, moved(position), confidence), before)


def test_joints_that_were_unknown_in_the_calibration_move_nothing(usual, fit, walk):
    calibration = walk[0].copy()
    calibration[3] = np.nan
    found = retargeter(usual, fit, calibration).step(0.0, walk[1], ALL)
    assert_array_equal(found[[0, 2]], HANDLES[[0, 2]])
    assert np.isfinite(found).all()


@pytest.mark.parametrize(("rate", "before"), [(15.0, 0.1), (60.0, 0.1), (30.0, np.nan)])
def test_a_joint_that_is_seen_again_or_at_last_closes_the_distance_smoothly(usual, fit, rate, before):
    """Lost at `before`, back at 0.9 m: no jump on re-entry, then 63 % of the rest in every `RETURN_SECONDS`."""
    stepwise = retargeter(usual, fit)
    stepwise.step(0.0, moved([before, 0, 0]), ALL)
    stepwise.step(1.0, moved([np.nan] * 3), ALL)
    times = 1.0 + np.arange(1, 200) / rate
    course = np.array([stepwise.step(t, moved([0.9, 0, 0]), ALL)[0, 0] for t in times]) / fit.scale[0]
    expected = 0.9 - (0.9 - np.nan_to_num(before)) * np.exp(-(times - times[0]) / RETURN_SECONDS)
    assert_allclose(course, expected, atol=1e-9)


def test_a_clock_that_is_set_back_does_not_make_a_jump(usual, fit):
    stepwise = retargeter(usual, fit)
    still = [stepwise.step(time, moved([0.1, 0.2, 0.3]), ALL) for time in (1000.0, 1000.03, 3.0, 3.03)]
    assert_array_equal(still, [still[0]] * 4)


# --- the soft limit


def test_motion_is_limited_along_its_direction_by_its_length_in_units_of_the_reach_of_its_octant():
    """Proportional up to the knee, then a hyperbolic tangent that never exceeds 1; one axis is not limited."""
    rng = np.random.default_rng(2)
    reach = rng.uniform(0.1, 2.0, (3, 3, 2))
    reach[1, 2] = np.inf
    directions = rng.normal(size=(500, 3, 3))
    directions /= np.linalg.norm(directions / np.where(directions < 0, *np.moveaxis(reach, 2, 0)), axis=-1)[..., None]
    room = 1 - LIMIT_KNEE_SHARE
    for length in (0.0, 0.5, LIMIT_KNEE_SHARE, 0.9, 1.0, 3.0, 100.0, 1e12):
        over = length - LIMIT_KNEE_SHARE
        limited = length if over <= 0 else LIMIT_KNEE_SHARE + room * np.tanh(over / room)
        assert_allclose(soft_limit(length * directions, reach), limited * directions, rtol=1e-12)
