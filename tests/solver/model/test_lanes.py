import numpy as np
import pytest

from solver.model import lanes


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_the_entry_of_a_matrix_is_where_the_layout_says(rng):
    S = rng.normal(size=(37, 3, 3))
    packed = lanes.pack(S.reshape(-1, 3), lanes.of_matrices(37))
    assert len(packed) == 3 * lanes.BLOCK
    for isoline, row, column in [(0, 0, 0), (1, 0, 0), (15, 2, 1), (16, 1, 2), (36, 2, 2)]:
        place = 144 * (isoline // 16) + 48 * column + 16 * row + isoline % 16
        assert packed[place] == S[isoline, row, column]
    assert np.count_nonzero(packed) == S.size


def test_the_row_of_a_plain_stack_is_where_the_layout_says(rng):
    rows = rng.normal(size=(50, 3))
    packed = lanes.pack(rows, lanes.of_rows(50))
    assert [packed[144 * (row // 48) + 48 * 2 + row % 48] for row in (0, 47, 48, 49)] == [*rows[[0, 47, 48, 49], 2]]


@pytest.mark.parametrize("count", [1, 16, 17, 80, 100])
def test_what_is_packed_comes_back(rng, count):
    for place in (lanes.of_matrices(count), lanes.of_rows(count)):
        stack = rng.normal(size=(len(place), 3))
        np.testing.assert_array_equal(lanes.unpack(lanes.pack(stack, place), place), stack)


@pytest.mark.parametrize(
    ("row", "column"),
    [
        (lanes.of_matrices(80), lanes.of_matrices(80)),
        (lanes.of_rows(320), lanes.of_matrices(80)),
        (lanes.of_matrices(21), lanes.of_rows(5)),
        (lanes.of_rows(1600), lanes.of_matrices(7)),
        (lanes.of_rows(1), lanes.of_rows(100)),
    ],
)
def test_a_product_in_lanes_is_the_product_and_is_added_to_what_was_there(rng, row, column):
    M, x, y = (
        rng.normal(size=(len(row), len(column))),
        rng.normal(size=(len(column), 3)),
        rng.normal(size=(len(row), 3)),
    )
    result = lanes.pack(y, row)
    lanes.add_product(lanes.matrix(M, row, column), lanes.pack(x, column), result)
    np.testing.assert_allclose(lanes.unpack(result, row), y + M @ x, rtol=0, atol=1e-13 * len(column))


@pytest.mark.parametrize("count", [1, 17, 80])
def test_turning_on_is_the_product_with_the_transpose_and_the_new_one(rng, count):
    place = lanes.of_matrices(count)
    turns, before, now = rng.normal(size=(3, count, 3, 3))
    packed = [lanes.pack(stack.reshape(-1, 3), place) for stack in (turns, before, now)]
    lanes.turn_on(*packed)
    expected = turns @ before.transpose(0, 2, 1) @ now
    np.testing.assert_allclose(lanes.unpack(packed[0], place).reshape(-1, 3, 3), expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(lanes.unpack(packed[1], place), before.reshape(-1, 3))
