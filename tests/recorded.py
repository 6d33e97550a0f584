"""The recorded messages of tests/vectors, and what the project makes of them."""

import json
from pathlib import Path

from engine_bridge.service.protocol.payloads import decode

VECTORS = Path(__file__).with_name("vectors")
EXPECTED = json.loads((VECTORS / "expected.json").read_text(encoding="utf-8"))
NAMES = sorted(EXPECTED)


def recorded(name):
    """Return the bytes of a message."""
    return (VECTORS / f"{name}.bin").read_bytes()


def decoded(name):
    """Return the body of a message."""
    return decode(recorded(name)).body
