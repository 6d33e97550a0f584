import struct
import zlib

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.io import savemat

from capture.formats import _mat5
from capture.formats._mat5 import Mat5Error, variables

from ...oracles import assert_is_clause

HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x100, b"IM")


def element(kind, content, order="<"):
    return struct.pack(f"{order}II", kind, len(content)) + content + b"\0" * (-len(content) % 8)


def matrix(name, shape, numbers, kind=9, order="<"):
    parts = (
        element(6, struct.pack(f"{order}II", 6, 0), order),
        element(5, struct.pack(f"{order}{len(shape)}i", *shape), order),
        element(1, name, order),
        element(kind, numbers, order),
    )
    return element(14, b"".join(parts), order)


def packed(content):
    deflated = zlib.compress(content)
    return struct.pack("<II", 15, len(deflated)) + deflated


@pytest.mark.parametrize("compressed", [True, False])
@pytest.mark.parametrize("dtype", ["f8", "f4", "u1", "i2", "i4"])
def test_reads_what_scipy_writes(tmp_path, compressed, dtype):
    arrays = {"a": np.arange(24).reshape(2, 3, 4).astype(dtype), "second_name": np.eye(3, dtype=dtype)}
    path = tmp_path / "take.mat"
    savemat(path, arrays, do_compression=compressed)
    found = variables(path.read_bytes())
    assert list(found) == list(arrays)
    for name, array in arrays.items():
        assert_array_equal(found[name].numbers(), array)


def test_reads_big_endian_files():
    data = (
        HEADER[:124] + struct.pack(">H", 0x100) + b"MI" + matrix(b"a", (1, 2), struct.pack(">2d", 1.5, -2), order=">")
    )
    assert_array_equal(variables(data)["a"].numbers(), [[1.5, -2]])


def test_arrays_without_real_numbers_are_distinguished(tmp_path):
    path = tmp_path / "take.mat"
    savemat(path, {"text": "abc", "complex": np.array([1j]), "structure": {"a": 1, "second": 2}, "real": 1.0})
    found = variables(path.read_bytes())
    assert {name: variable.description() for name, variable in found.items()} == {
        "text": "text",
        "complex": "complex numbers",
        "structure": "structure of a, second",
        "real": "numbers",
    }


@pytest.mark.parametrize(
    "content",
    [
        b"\0" * 7,
        element(9, b"12345678"),
        struct.pack("<II", 14, 2**32 - 1),
        struct.pack("<HHI", 1, 5, 0),
        packed(element(9, b"12345678")),
        packed(b"1234567"),
        struct.pack("<II", 15, 8) + b"12345678",
        element(14, element(6, b"1234") + element(5, b"12345678") + element(1, b"a")),
        matrix(b"a", (), b""),
        matrix(b"a", (2, -1), b""),
        matrix(b"a", (2, 2), b"\0" * 24),
        matrix(b"a", (2, 2), b"\0" * 32, kind=10),
        matrix(b"a", (2**31 - 1,) * 3, b"\0" * 32),
        packed(matrix(b"a", (2, 2), b"\0" * 24)),
        packed(matrix(b"a", (1, 5), b"\0" * 40)),
    ],
)
def test_violations_of_the_layout_are_errors(content, monkeypatch):
    monkeypatch.setattr(_mat5, "MAX_ARRAY_BYTES", 80)
    with pytest.raises(Mat5Error):
        [variable.numbers() for variable in variables(HEADER + content).values()]


def test_damaged_bytes_are_arrays_of_the_announced_shape_or_refused_in_a_clause():
    whole = HEADER + matrix(b"d_skel", (2, 3), np.arange(6.0).tobytes())
    generator = np.random.default_rng(5)
    read = refused = 0
    for _ in range(1000):
        damaged = bytearray(whole)
        for place in generator.integers(124, len(whole), size=2):
            damaged[place] = generator.integers(256)
        try:
            for variable in variables(bytes(damaged)).values():
                assert variable.numbers().shape == variable.shape
                assert variable.numbers().nbytes <= 8 * len(whole)
            read += 1
        except Mat5Error as error:
            assert_is_clause(error)
            refused += 1
    assert min(read, refused) > 100


def test_an_empty_field_is_nothing():
    """MATLAB writes the elements of fields that have no value without content."""
    assert _mat5._variable(memoryview(b""), order="<")[1].kind == "nothing"
