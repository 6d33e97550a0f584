import tempfile

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from engine_bridge.performance import frame_store
from engine_bridge.performance.frame_store import FrameStore, evenly
from puppetline.errors import OutputError

from ..refusals import refused

FRAMES = np.random.default_rng(0).normal(size=(50, 8, 3)).astype(np.float32)


@pytest.fixture(params=[10**6, 1000], ids=["memory", "file"])
def store(request, monkeypatch):
    """The frames in a store, once in memory and once in a file."""
    monkeypatch.setattr(frame_store, "MAX_MEMORY_BYTES", request.param)
    made = FrameStore((8, 3))
    for some in np.split(FRAMES.astype(np.float64), (20, 30)):
        made.append(some)
    return made


@pytest.mark.parametrize(
    "chosen", [slice(10, 35), slice(40, 99), slice(None, None, 3), slice(5, 5), [3, 49, 7, 7], []], ids=str
)
def test_a_frame_store_is_indexed_like_an_array(store, chosen):
    chosen = chosen if isinstance(chosen, slice) else np.array(chosen, dtype=int)
    found = store[chosen]
    assert_array_equal(found, FRAMES[chosen])
    assert found.dtype == np.float32


def test_a_frame_store_has_a_length_indices_and_an_iterator(store):
    assert len(store) == 50
    assert_array_equal(store[-1], FRAMES[-1])
    assert_array_equal(list(store), FRAMES)
    with pytest.raises(IndexError):
        store[50]


def test_a_frame_store_still_grows_after_it_was_read(store):
    store[3:9]
    store.append(FRAMES[:2])
    assert_array_equal(store[:], np.concatenate([FRAMES, FRAMES[:2]]))


def test_a_system_without_room_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(frame_store, "MAX_MEMORY_BYTES", 1000)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    told = refused(OutputError, FrameStore((8, 3)).append, FRAMES)
    assert told.where == "the folder for temporary files"
    assert "TMPDIR" in told.fix


@pytest.mark.parametrize(("size", "count", "expected"), [(10, 4, [0, 3, 6, 9]), (3, 9, [0, 1, 2]), (0, 5, [])])
def test_indices_are_evenly_spread_from_the_first_to_the_last(size, count, expected):
    assert evenly(size, count).tolist() == expected
