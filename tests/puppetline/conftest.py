"""Fixtures of the tests of the Python door, which are those of the bridge."""

from ..engine_bridge.conftest import (
    blob,
    blob_file,
    blob_puppet,
    dance,
    frames,
    glb,
    limbed_puppet,
    make_shape,
    own_cache,
    record,
    record_events,
    standing,
    take,
    write_puppet,
)

__all__ = [
    "blob",
    "blob_file",
    "blob_puppet",
    "dance",
    "frames",
    "glb",
    "limbed_puppet",
    "make_shape",
    "own_cache",
    "record",
    "record_events",
    "standing",
    "take",
    "write_puppet",
]
