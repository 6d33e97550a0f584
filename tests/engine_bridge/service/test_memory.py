import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from engine_bridge.service.memory import pack, unpack


@given(arrays.arrays(st.sampled_from(["<f8", "<f4", "<i8"]), arrays.array_shapes(min_dims=1, max_dims=3, min_side=0)))
def test_arrays_come_back_bit_by_bit(array):
    back = unpack(json.loads(json.dumps(pack({"a": [array]}), allow_nan=False)))["a"][0]
    assert (back.dtype, back.shape, back.tobytes()) == (array.dtype, array.shape, array.tobytes())


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.text() | st.floats(allow_nan=False), st.lists
    )
)
def test_everything_else_comes_back_equal(value):
    assert unpack(json.loads(json.dumps(pack(value), allow_nan=False))) == value


def test_a_number_that_is_none_comes_back_as_a_number():
    assert math.isnan(unpack(pack(math.nan)))


def test_a_big_endian_array_is_turned_round():
    assert unpack(pack(np.array([1.5, 2.0], dtype=">f8"))).tolist() == [1.5, 2.0]


@pytest.mark.parametrize(
    "change",
    [{"type": "|O"}, {"type": "<U8"}, {"data": 7}, {"data": "!"}, {"data": ""}, {"shape": [3]}, {"shape": [-1, 7]}],
)
def test_what_is_no_array_is_refused(change):
    with pytest.raises(ValueError, match=r"array|base64|data|buffer|reshape|size"):
        unpack({**pack(np.zeros(2)), **change})
