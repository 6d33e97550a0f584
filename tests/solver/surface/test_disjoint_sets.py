import numpy as np
import pytest
import scipy.sparse
from scipy.sparse.csgraph import connected_components

from solver.surface.disjoint_sets import join, number_sets


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("dtype", [np.int32, np.int64])
def test_sets_are_the_connected_components_of_what_was_joined(seed, dtype):
    random = np.random.default_rng(seed)
    a, b = random.integers(0, 300, (2, 180))
    number = np.arange(300, dtype=dtype)
    for pair in zip(a, b, strict=True):
        join(number, *pair)
    number_sets(number)
    links = scipy.sparse.coo_matrix((np.ones(180), (a, b)), shape=(300, 300))
    np.testing.assert_array_equal(number, connected_components(links, directed=False)[1])
    assert number.dtype == dtype


def test_numbers_that_nothing_joined_are_sets_in_their_order():
    number = np.arange(4)
    number_sets(number)
    assert number.tolist() == [0, 1, 2, 3]
