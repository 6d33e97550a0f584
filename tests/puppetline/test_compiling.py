import numba

from puppetline.compiling import reported


def test_each_function_is_reported_once_with_those_that_it_calls():
    @numba.njit
    def inner(x):
        return x + 1

    @numba.njit
    def outer(x):
        return inner(x) * 2

    counts = []
    with reported(counts.append):
        assert outer(3) == 8
        assert outer(4) == 10
        assert inner(2.5) == 3.5
    assert outer(1.5) == 5.0
    assert counts == [1, 2]
