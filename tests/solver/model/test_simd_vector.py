import numpy as np
import pytest
from numba.core.errors import TypingError

from puppetline.compiled import compiled
from solver.model.simd_vector import LENGTH, add_scaled, item, load, zeros


@compiled
def combination(table, places, factors, out):
    total = zeros()
    for place, factor in zip(places, factors):  # noqa: B905 - not in Numba
        total = add_scaled(total, factor, load(table, place))
    for k in range(LENGTH):
        out[k] = item(total, k)


def test_a_sum_of_scaled_rows_is_the_product_with_the_table():
    rng = np.random.default_rng(0)
    table = rng.normal(size=(50, LENGTH)).astype(np.float32)
    places, factors = np.array([0, 49, 7, 7, 20]), rng.normal(size=5).astype(np.float32)
    out = np.empty(LENGTH, dtype=np.float32)
    combination(table, places, factors, out)
    np.testing.assert_allclose(out, factors.astype(np.float64) @ table[places], rtol=0, atol=2e-6)


def test_no_row_at_all_gives_zeros():
    out = np.ones(LENGTH, dtype=np.float32)
    nothing = np.zeros(0, dtype=np.int64)
    combination(np.ones((3, LENGTH), dtype=np.float32), nothing, nothing.astype(np.float32), out)
    np.testing.assert_array_equal(out, 0)


@pytest.mark.parametrize(
    "table", [np.ones((4, 16)), np.asfortranarray(np.ones((4, 16), np.float32)), np.ones((8, 16), np.float32)[::2]]
)
def test_a_table_of_another_kind_or_layout_is_refused(table):
    with pytest.raises(TypingError, match="contiguous 2-d float32"):
        combination(table, np.array([0]), np.ones(1, dtype=np.float32), np.empty(LENGTH, dtype=np.float32))
