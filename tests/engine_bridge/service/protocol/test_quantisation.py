import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.service.protocol.quantisation import BOX_STEPS, normals_of, positions_of, quantised

COORDINATES = st.floats(-1e6, 1e6, width=32)
FLOAT = np.finfo(np.float32)


@given(arrays(np.float32, st.tuples(st.integers(1, 30), st.just(3)), elements=COORDINATES))
def test_no_coordinate_is_off_by_more_than_half_a_step_and_rounding(positions):
    box, places, _ = quantised(positions, np.zeros_like(positions))
    assert_array_equal(box, [positions.min(axis=0), positions.max(axis=0)])
    off = np.abs(positions_of(box, places).astype(np.float64) - positions)
    side = box[1].astype(np.float64) - box[0]
    rounding = 4 * FLOAT.eps * (np.abs(positions).max(axis=0) + side) + FLOAT.tiny
    assert (off <= 0.5 * side / BOX_STEPS + rounding).all()


def test_normals_are_off_by_no_more_than_some_thousandths_of_a_degree():
    ways = np.random.default_rng(1).normal(size=(100_000, 3))
    normals = (ways / np.linalg.norm(ways, axis=1, keepdims=True)).astype(np.float32)
    _, _, folded = quantised(normals, normals)
    back = normals_of(folded)
    assert_allclose(np.linalg.norm(back, axis=1), 1, atol=1e-6)
    angle = np.degrees(np.arcsin(np.minimum(np.linalg.norm(np.cross(normals.astype(float), back), axis=1), 1)))
    assert angle.max() < 0.005
    assert (np.einsum("vx,vx->v", normals, back) > 0).all()


def test_axes_are_met_exactly_and_a_normal_without_direction_points_along_z():
    given = np.vstack([np.eye(3), -np.eye(3), np.zeros(3)]).astype(np.float32)
    expected = np.vstack([given[:-1], [0, 0, 1]])
    assert_array_equal(normals_of(quantised(given, given)[2]), expected)
