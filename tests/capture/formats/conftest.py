"""Recordings that a test writes and reads."""

from copy import deepcopy

import pytest
from numpy.testing import assert_array_equal

from capture.formats.options import ReadOptions
from puppetline.errors import SkeletonLogError


def changed(document, path, value):
    """Return a JSON document with another value at a path, or without the value if it is None."""
    document = deepcopy(document)
    *steps, last = path
    inner = document
    for step in steps:
        inner = inner[step]
    if value is None:
        del inner[last]
    else:
        inner[last] = value
    return document


def place_of(path, value):
    """Return where the error for such a change is: at the value, or at what lacks it."""
    steps = path[:-1] if value is None else path
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps).lstrip(".") or TOP_LEVEL


TOP_LEVEL = "the document's top level"


@pytest.fixture
def read(tmp_path):
    """Write a recording (bytes, text, or lines) and read it: `read(module, content, **options)`."""

    def written(reader, content, **options):
        if isinstance(content, list):
            content = "".join(f"{line}\n" for line in content)
        path = tmp_path / "take"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return reader.read(path, ReadOptions(**options))

    return written


@pytest.fixture
def refused_at(read, tmp_path):
    """Return the place, within the file, that a reader's error names: `refused_at(module, content, **options)`."""

    def where(reader, content, **options):
        with pytest.raises(SkeletonLogError) as caught:
            read(reader, content, **options)
        return caught.value.where.removeprefix(str(tmp_path / "take")).removeprefix(", ")

    return where


@pytest.fixture
def assert_same_frames():
    """Compare two clips except for their notes."""

    def compare(clip, expected):
        assert (clip.format, clip.user) == (expected.format, expected.user)
        assert_array_equal(clip.times, expected.times)
        assert_array_equal(clip.positions, expected.positions)
        assert_array_equal(clip.confidence, expected.confidence)

    return compare
