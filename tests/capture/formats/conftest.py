"""What the tests of several readers share."""

import numpy as np
import pytest


@pytest.fixture
def assert_same_frames():
    """Compare everything of two clips but their notes."""

    def compare(clip, expected):
        assert (clip.format, clip.user) == (expected.format, expected.user)
        np.testing.assert_array_equal(clip.times, expected.times)
        np.testing.assert_array_equal(clip.positions, expected.positions)
        np.testing.assert_array_equal(clip.confidence, expected.confidence)

    return compare
