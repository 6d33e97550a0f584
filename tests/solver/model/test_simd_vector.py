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


@pytest.mark.parametrize(
    "table", [np.ones((4, 16)), np.asfortranarray(np.ones((4, 16), np.float32)), np.ones((8, 16), np.float32)[::2]]
)
def test_a_table_of_another_kind_or_layout_is_refused(table):
    with pytest.raises(TypingError, match="contiguous 2-d float32"):
        combination(table, np.array([0]), np.ones(1, dtype=np.float32), np.empty(LENGTH, dtype=np.float32))
