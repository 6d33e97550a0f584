import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.export.unit_weights import UnitWeights

clips = arrays(np.float64, array_shapes(min_dims=2, max_dims=2, max_side=9), elements=st.floats(-1e6, 1e6))


@given(coordinates=clips)
@example(coordinates=np.zeros((3, 0)))
@example(coordinates=np.zeros((0, 0)))
@example(coordinates=np.array([[0.0, 2.0], [4.0, 1.0]]))
def test_targets_times_weights_up_to_one_are_directions_times_coordinates(coordinates):
    unit = UnitWeights.of_clip(coordinates)
    weights = unit.weights(coordinates)
    assert weights.shape == (len(coordinates), unit.count)
    assert ((weights >= 0) & (weights <= 1)).all()
    shown = weights.astype(np.float64) @ unit.targets(np.eye(coordinates.shape[1]))
    assert_allclose(shown, coordinates, atol=1e-6 * max(np.abs(coordinates).max(initial=0), 1e-30))
    if len(coordinates):
        assert_array_equal(weights.max(axis=0), (weights > 0).any(axis=0))
    assert unit.count == coordinates.shape[1] + bool((coordinates < 0).any())
    assert_array_equal(unit.weights(np.zeros((1, coordinates.shape[1]))), np.zeros((1, unit.count)))
