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


def moved(joint, by):
    positions = np.zeros((JOINTS, 3))
    positions[joint] = by
    return positions


# --- Eq. 6-7


def accumulated(positions, mapping, scale):
    """Sum joint motion (T, j, 3) from frame to frame as the paper does: how far each handle has moved (T, h, 3)."""
    motion = np.diff(positions, axis=0, prepend=positions[:1])
    steps = (mapping.matrix @ motion) * mapping.axes * (scale * mapping.gain)[:, None]
    return np.cumsum(steps, axis=0)


def test_the_sum_of_motions_is_the_displacement_while_every_joint_is_tracked(usual, fit, walk):
    summed = accumulated(walk, usual, fit.scale)
    stepwise = retargeter(usual, fit, calibration=walk[0])
    found = np.array([stepwise.step(0.033 * t, frame, ALL) for t, frame in enumerate(walk)])
    assert_allclose(found - HANDLES, summed, rtol=0, atol=1e-9)
    assert_allclose(summed[0], 0.0)


# --- which joints, which axes, how far


def test_a_handle_without_a_joint_stays(fit, walk):
    idle = mapping([{3: 1.0}, {}, {}])
    for t, frame in enumerate(walk):
        found = retargeter(idle, fit, calibration=walk[0]).step(float(t), frame, ALL)
        assert_array_equal(found[1:], HANDLES[1:])


def test_the_calibration_pose_is_the_rest_pose(usual, fit, walk):
    assert_array_equal(retargeter(usual, fit, walk[7]).step(0.0, walk[7], ALL), HANDLES)


def test_a_stack_of_displacements_gives_the_targets_of_each(usual, walk):
    limited = Fit(np.array([2.0, 0.5, 3.0]), np.full((3, 3, 2), 0.4))
    arms = retargeter(usual, limited)
    assert_allclose(arms.targets(walk), [arms.targets(frame) for frame in walk], rtol=0, atol=1e-15)


def test_the_basis_takes_the_performers_axes_to_those_of_the_mesh():
    """A character with z up that faces −y: its left is +x, as the performer's."""
    basis = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    plain = Fit(np.ones(3), UNLIMITED)
    which = mapping([{3: 1.0}, {3: 1.0}, {3: 1.0}], axes=[[1, 1, 1], [0, 1, 0], [0, 0, 1]])
    found = retargeter(which, plain, basis=basis).step(0.0, moved(3, [0.1, 0.2, 0.3]), ALL) - HANDLES
    assert_allclose(found, [[0.1, -0.3, 0.2], [0, 0, 0.2], [0, -0.3, 0]], atol=1e-12)


def test_reach_is_along_the_axes_of_the_mesh():
    basis = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    reach = UNLIMITED.copy()
    reach[:, 2, 1] = 0.05  # little room upwards, that is along +z
    found = retargeter(mapping([{3: 1.0}] * 3), Fit(np.ones(3), reach), basis=basis)
    up = found.targets(moved(3, [0.0, 10.0, 0.0])) - HANDLES
    assert_allclose(up, [[0, 0, 0.05]] * 3, atol=1e-9)
    down = found.targets(moved(3, [0.0, -10.0, 0.0])) - HANDLES
    assert_allclose(down, [[0, 0, -10.0]] * 3)


def test_gain_widens_the_reach_as_well():
    reach = np.full((3, 3, 2), 0.2)
    far = retargeter(mapping([{3: 1.0}] * 3, gain=[1, 2, 0]), Fit(np.ones(3), reach)).targets(moved(3, [9.0, 0, 0]))
    assert_allclose(far - HANDLES, [[0.2, 0, 0], [0.4, 0, 0], [0, 0, 0]], atol=1e-9)


# --- lost joints


def test_joints_that_were_never_known_move_nothing(usual, fit, walk):
    calibration = walk[0].copy()
    calibration[3] = np.nan
    stepwise = retargeter(usual, fit, calibration)
    for t, frame in enumerate(walk[:20]):
        found = stepwise.step(0.033 * t, frame, ALL)
        assert_array_equal(found[[0, 2]], HANDLES[[0, 2]])
        assert np.isfinite(found).all()


def test_a_lost_joint_is_held_where_it_was(usual, fit):
    stepwise = retargeter(usual, fit)
    before = stepwise.step(0.0, moved(3, [0.1, 0.2, 0.3]), ALL)
    lost = ALL.copy()
    lost[3] = 0
    for t in range(1, 50):
        garbage = moved(3, [float(t), np.nan, -7.0] if t % 2 else [np.nan] * 3)
        assert_allclose(stepwise.step(0.033 * t, garbage, lost), before, rtol=0, atol=1e-12)


@pytest.mark.parametrize("rate", [15.0, 30.0, 60.0])
def test_a_joint_that_comes_back_closes_the_distance_smoothly(usual, fit, rate):
    """Lost at 0.1 m, back at 0.9 m: no jump on re-entry, then 63 % of the rest in every `RETURN_SECONDS`."""
    stepwise = retargeter(usual, fit)
    lost = ALL.copy()
    lost[3] = 0
    stepwise.step(0.0, moved(3, [0.1, 0, 0]), ALL)
    stepwise.step(1.0, moved(3, [np.nan] * 3), lost)
    times = 1.0 + np.arange(1, 200) / rate
    course = np.array([stepwise.step(t, moved(3, [0.9, 0, 0]), ALL)[0, 0] for t in times]) / fit.scale[0]
    expected = 0.9 - 0.8 * np.exp(-(times - times[0]) / RETURN_SECONDS)
    assert_allclose(course, expected, atol=1e-9)
    assert course[0] == pytest.approx(0.1)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e7, 1e160, 1e300])
@pytest.mark.parametrize("axis", range(3))
def test_a_position_that_is_not_valid_counts_as_lost_whatever_its_confidence(usual, fit, value, axis):
    stepwise, position = retargeter(usual, fit), [0.1, 0.2, 0.3]
    before = stepwise.step(0.0, moved(3, position), ALL)
    position[axis] = value
    assert_array_equal(stepwise.step(0.1, moved(3, position), ALL), before)


def test_a_clock_that_is_set_back_does_not_make_a_jump(usual, fit):
    stepwise = retargeter(usual, fit)
    still = [stepwise.step(time, moved(3, [0.1, 0.2, 0.3]), ALL) for time in (1000.0, 1000.03, 3.0, 3.03)]
    assert_array_equal(still, [still[0]] * 4)


def test_the_first_frame_is_taken_as_it_is(usual, fit):
    found = retargeter(usual, fit).step(123.0, moved(3, [0.1, 0.2, 0.3]), ALL)
    assert_allclose(found[0], HANDLES[0] + 2.0 * np.array([0.1, 0.2, 0.3]))


def test_a_joint_first_seen_late_comes_in_smoothly(usual, fit):
    stepwise = retargeter(usual, fit)
    lost = ALL.copy()
    lost[3] = 0
    assert_array_equal(stepwise.step(0.0, moved(3, [np.nan] * 3), lost), HANDLES)
    entering = stepwise.step(0.033, moved(3, [0.5, 0, 0]), ALL)
    assert_allclose(entering, HANDLES, atol=1e-12)
    settled = stepwise.step(5.0, moved(3, [0.5, 0, 0]), ALL)
    assert_allclose(settled[0] - HANDLES[0], [1.0, 0, 0], atol=1e-9)


# --- the soft limit


@pytest.fixture
def reach():
    return np.random.default_rng(2).uniform(0.1, 2.0, (3, 3, 2))


def in_reach(moved, reach):
    """Length in units of the reach of its octant."""
    return np.linalg.norm(moved / np.where(moved < 0, reach[..., 0], reach[..., 1]), axis=-1)


def random_directions(reach, count=500):
    """Unit length in units of the reach."""
    directions = np.random.default_rng(3).normal(size=(count, len(reach), 3))
    return directions / in_reach(directions, reach)[..., None]


def test_motion_below_the_knee_is_unchanged(reach):
    inside = random_directions(reach) * np.random.default_rng(4).uniform(0, LIMIT_KNEE_SHARE, (500, 3, 1))
    assert_array_equal(soft_limit(inside, reach), inside)
    assert_array_equal(soft_limit(np.zeros((3, 3)), reach), 0.0)


def test_motion_beyond_the_knee_equals_values_by_hand():
    reach = np.array([[[1.0, 2.0], [1.0, 1.0], [1.0, 1.0]]])
    limited = 0.7 + 0.3 * np.tanh(1.0)
    assert_allclose(soft_limit(np.array([[2.0, 0.0, 0.0]]), reach), [[2 * limited, 0, 0]])
    assert_allclose(soft_limit(np.array([[-1.0, 0.0, 0.0]]), reach), [[-limited, 0, 0]])
    assert_allclose(soft_limit(np.array([[1.2, 0.8, 0.0]]), reach), [[1.2 * limited, 0.8 * limited, 0]])


def test_the_limit_is_never_exceeded_and_the_direction_is_kept(reach):
    directions = random_directions(reach)
    for length in (0.5, 0.9, 1.0, 3.0, 100.0, 1e12):
        found = soft_limit(length * directions, reach)
        assert in_reach(found, reach).max() <= 1 + 1e-12
        unit = found / np.linalg.norm(found, axis=-1, keepdims=True)
        assert_allclose(unit, directions / np.linalg.norm(directions, axis=-1, keepdims=True), atol=1e-12)


def test_one_limited_axis_does_not_hold_the_others():
    reach = UNLIMITED.copy()
    reach[:, 1] = 0.5
    found = soft_limit(np.array([[1e3, 0.1, -1e3]] * 3), reach)
    assert_array_equal(found, [[1e3, 0.1, -1e3]] * 3)
