"""Messages read by the plain C# core are equal to those read by Python, and damaged ones are rejected."""

import base64
import json

import numpy as np
import pytest

from ..messages import ARRAYS, Messages
from .conftest import array


def plain(told):
    """Return a message in the form that the common tests compare."""
    if "refused" in told or told.get("read") is False:
        return None
    plain = {"topic": told["topic"], "header": told["header"]}
    if "description" in told:
        arrays = {name: array(told[name], np.uint32 if name == "triangles" else np.float32) for name in ARRAYS}
        return plain | {"facts": told["description"], "arrays": arrays | {"weights": array(told["weights"])}}
    return plain | ({"json": told["json"]} if "json" in told else {"values": array(told["values"])})


class TestMessages(Messages):
    accepts = ("/weights/0: ", "/arrays/colors: None")

    @pytest.fixture
    def read(self, run_core, packed):
        return lambda messages: [*map(plain, run_core("decode", packed(messages)))]


GOOD = [
    "null",
    " [ ] ",
    "{}",
    '{"a": [1, -0, 0.5, -1.25e-3, 1E+2, 1e300], "b": {"c": true, "d": false, "": null}}',
    r'"a\"\\\/\b\f\n\r\t\u00e4\ud83d\ude00ä😀"',
    '{"a": 1, "a": 2}',
    "[" * 30 + "]" * 30,
]
BAD = ["nul", "truer", "[1,]", "[1", '{"a"}', '{"a":}', '{"a":1,}', "{1:2}", "01", "-", "1.", ".5", "1e", "+1"]
BAD += ["0x1", "NaN", "Infinity", "1e999", '"a', r'"\x"', r'"\u12"']
BAD += ["", " ", "[1 2]", "1 2", '"\n"', r'"\u 123"', "\ufeff1"]
BAD += ["[" * 100_000, '{"a":' * 100_000, "[" + "0," * 300_000 + "0]"]


def test_json_is_read_as_python_reads_it_and_invalid_or_too_large_json_is_refused(run_core):
    wrong = [*map(str.encode, BAD), b'"\xff"', b'"\xc3"', b'"\xed\xa0\x80"']
    texts = [*map(str.encode, GOOD), *wrong]
    said = run_core("json", told="".join(f"{base64.b64encode(text).decode()}\n" for text in texts))
    assert [each.get("value") for each in said[: len(GOOD)]] == list(map(json.loads, GOOD))
    assert [text for text, each in zip(wrong, said[len(GOOD) :], strict=True) if "refused" not in each] == []
