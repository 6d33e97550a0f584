"""Helpers that the tests of several readers share."""

from copy import deepcopy

import numpy as np
import pytest

from capture.formats.options import ReadOptions
from puppetline.errors import SkeletonLogError


def changed(document, *path, value):
    """Return a JSON document with another value at a path, or without the value if it is None."""
    document = deepcopy(document)
    inner = document
    for step in path[:-1]:
        inner = inner[step]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return document


def assert_refused(reader, path, place, message):
    """Check that a reader refuses a file with an error at a place."""
    with pytest.raises(SkeletonLogError) as caught:
        reader.read(path, ReadOptions())
    assert caught.value.where.endswith(place)
    assert message in str(caught.value)


@pytest.fixture
def assert_same_frames():
    """Compare two clips except for their notes."""

    def compare(clip, expected):
        assert (clip.format, clip.user) == (expected.format, expected.user)
        np.testing.assert_array_equal(clip.times, expected.times)
        np.testing.assert_array_equal(clip.positions, expected.positions)
        np.testing.assert_array_equal(clip.confidence, expected.confidence)

    return compare
