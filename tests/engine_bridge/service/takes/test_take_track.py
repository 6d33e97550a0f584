import numpy as np
import pytest

from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.service.takes.take_track import STATE_FRAMES, TakeTrack


@pytest.mark.parametrize("figure", ["blob_puppet", "limbed_puppet"])
def test_a_track_has_the_frames_that_the_take_was_recorded_with_in_any_order(record_take, make_player, figure, request):
    puppet = request.getfixturevalue(figure)
    path, frames = record_take(names=("dog",), puppet=puppet)
    track = TakeTrack(make_player("dog", prepared=load_prepared(puppet)), path)
    assert len(track.times) == len(frames) > 2 * STATE_FRAMES
    jumps = (70, 69, 3, 32, 33, 31, 64, 88, 0, 1, 1, len(frames) - 1)
    for number in (*range(len(frames)), *jumps):
        (shown, (_, pose)), frame = track.frame(number), frames[number]
        assert np.array_equal(pose.R, frame.pose.R)
        assert np.array_equal(shown.target.root, frame.pose.root)
        assert shown.state == "performing"  # nobody is calibrated now
        assert shown.user == frame.user
    assert frames[0].state == "calibrating"
