import numpy as np
import pytest

import puppetline as pl
from capture.skeleton import JOINT_INDEX

from ..capture.bodies import STANDS
from ..recordings import tracked_frame


def test_a_recording_has_the_frames_of_its_file_and_its_rest_pose(take, dance, frames):
    recording = pl.load_recording(str(take))
    got = list(recording.frames(fps=30))
    np.testing.assert_allclose([frame.positions for frame in got], dance(), atol=1e-4)
    assert [frame.time for frame in got] == pytest.approx([frame.time for frame in frames(dance())])
    assert (recording.path, recording.users, recording.user) == (take, (1,), 1)
    assert recording.seconds == pytest.approx(57 / 30)
    np.testing.assert_allclose(recording.rest_pose, np.median(dance()[:15], axis=0), atol=1e-4)
    assert repr(recording) == "<puppetline.Recording dance.log: 1.9 s, Puppetline's own recordings>"


def test_one_of_several_performers_is_chosen(record_events, tmp_path):
    seen = [(k / 30, STANDS + k / 300 + user, user) for k in range(58) for user in (1, 2) if user == 1 or k < 30]
    path = record_events(tmp_path / "two.log", [tracked_frame(*each) for each in seen])
    assert (pl.load_recording(path).user, pl.load_recording(path).users) == (1, (1, 2))
    second = next(pl.load_recording(path, user=2).frames())
    np.testing.assert_allclose(second.positions, STANDS + 2, atol=1e-4)
    with pytest.raises(pl.PuppetlineError) as error:
        pl.load_recording(path, user=3)
    assert error.value.found == "no user 3"


def test_a_source_yields_all_frames_of_a_recording_and_ends_with_it(take, dance, given_clock):
    with pl.open_source(f"replay:{take}") as source:
        heads = [frame.positions[JOINT_INDEX["head"]] for frame in source]
    np.testing.assert_allclose(heads, dance()[:, JOINT_INDEX["head"]], atol=1e-4)
    assert list(source) == []  # it is closed
    with pytest.raises(pl.PuppetlineError):
        pl.open_source("carrier:pigeon")


def test_a_source_tells_a_damaged_recording_from_one_that_ends(take, tmp_path, given_clock):
    damaged = tmp_path / "damaged.log"
    damaged.write_bytes(take.read_bytes()[:-200] + b"\0\0\n" + take.read_bytes()[-200:])
    with pl.open_source(f"replay:{damaged}") as source, pytest.raises(pl.PuppetlineError):
        list(source)
