import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from solver.model import matrix_blocks


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("count", [1, 16, 17, 80, 100])
def test_packed_blocks_are_unpacked_unchanged(rng, count):
    for place in (matrix_blocks.matrix_row_places(count), matrix_blocks.row_places(count)):
        stack = rng.normal(size=(len(place), 3))
        assert_array_equal(matrix_blocks.unpack_rows(matrix_blocks.pack_rows(stack, place), place), stack)


@pytest.mark.parametrize(
    ("row", "column"),
    [
        (matrix_blocks.matrix_row_places(80), matrix_blocks.matrix_row_places(80)),
        (matrix_blocks.row_places(320), matrix_blocks.matrix_row_places(80)),
        (matrix_blocks.matrix_row_places(21), matrix_blocks.row_places(5)),
        (matrix_blocks.row_places(1600), matrix_blocks.matrix_row_places(7)),
        (matrix_blocks.row_places(1), matrix_blocks.row_places(100)),
    ],
)
def test_a_product_in_lanes_is_the_product_and_is_added_to_what_was_there(rng, row, column):
    M = rng.normal(size=(len(row), len(column)))
    x, y = rng.normal(size=(len(column), 3)), rng.normal(size=(len(row), 3))
    result = matrix_blocks.pack_rows(y, row)
    matrix_blocks.add_product(matrix_blocks.pack_matrix(M, row, column), matrix_blocks.pack_rows(x, column), result)
    assert_allclose(matrix_blocks.unpack_rows(result, row), y + M @ x, rtol=0, atol=1e-13 * len(column))


@pytest.mark.parametrize("count", [1, 17, 80])
def test_turning_on_is_the_product_with_the_transpose_and_the_new_one(rng, count):
    place = matrix_blocks.matrix_row_places(count)
    turns, before, now = rng.normal(size=(3, count, 3, 3))
    packed = [matrix_blocks.pack_rows(stack.reshape(-1, 3), place) for stack in (turns, before, now)]
    matrix_blocks.apply_change(*packed)
    expected = turns @ before.transpose(0, 2, 1) @ now
    assert_allclose(matrix_blocks.unpack_rows(packed[0], place).reshape(-1, 3, 3), expected, rtol=0, atol=1e-12)
    assert_array_equal(matrix_blocks.unpack_rows(packed[1], place), before.reshape(-1, 3))
