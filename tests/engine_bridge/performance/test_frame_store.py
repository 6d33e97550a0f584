import tempfile

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from engine_bridge.performance import frame_store
from engine_bridge.performance.frame_store import FrameStore, evenly
from puppetline.errors import OutputError

FRAMES = np.random.default_rng(0).normal(size=(50, 8, 3)).astype(np.float32)


@pytest.fixture(params=["memory", "file"])
def store(request, monkeypatch):
    """The frames in a store, once in memory and once in a file."""
    monkeypatch.setattr(frame_store, "MAX_MEMORY_BYTES", 10**6 if request.param == "memory" else 1000)
    made = FrameStore((8, 3))
    for start in (0, 20, 30):
        made.append(FRAMES[start : {0: 20, 20: 30, 30: 50}[start]].astype(np.float64))
    return made


@pytest.mark.parametrize(
    "chosen",
    [
        *(slice(*bounds) for bounds in ((10, 35), (40, 99), (None, None, 3), (5, 5))),
        *(np.array(indices, dtype=int) for indices in ([3, 49, 7, 7], [])),
    ],
    ids=str,
)
def test_a_frame_store_is_indexed_like_an_array(store, chosen):
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
    with pytest.raises(OutputError) as refused:
        FrameStore((8, 3)).append(FRAMES)
    assert refused.value.where == "the folder for temporary files"
    assert "TMPDIR" in refused.value.fix


def test_indices_are_evenly_spread_from_the_first_to_the_last():
    assert evenly(10, 4).tolist() == [0, 3, 6, 9]
    assert evenly(3, 9).tolist() == [0, 1, 2]
    assert evenly(0, 5).tolist() == []
