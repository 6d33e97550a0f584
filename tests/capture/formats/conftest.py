"""What the tests of several readers share."""

from copy import deepcopy

import numpy as np
import pytest


def changed(document, *path, value):
    """Return a JSON document with another value at a path, or without what is there if the value is None."""
    document = deepcopy(document)
    inner = document
    for step in path[:-1]:
        inner = inner[step]
    if value is None:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return document


@pytest.fixture
def assert_same_frames():
    """Compare everything of two clips but their notes."""

    def compare(clip, expected):
        assert (clip.format, clip.user) == (expected.format, expected.user)
        np.testing.assert_array_equal(clip.times, expected.times)
        np.testing.assert_array_equal(clip.positions, expected.positions)
        np.testing.assert_array_equal(clip.confidence, expected.confidence)

    return compare
