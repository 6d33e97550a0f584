import numpy as np
import pytest

from engine_bridge.service.takes.take_track import STATE_FRAMES, TakeTrack


def solved(track, number):
    shown, (_, R) = track.frame(number)
    return shown, R


def test_a_track_has_the_frames_that_the_take_was_recorded_with(record_take, make_player):
    path, frames = record_take(names=("dog",))
    track = TakeTrack(make_player("dog"), path)
    assert len(track.times) == len(frames) > STATE_FRAMES
    for number, frame in enumerate(frames):
        shown, R = solved(track, number)
        assert np.array_equal(R, frame.R)
        assert np.array_equal(shown.pose.root, frame.root)
        assert (shown.state, shown.user) == ("performing", frame.user)  # nobody is calibrated now
    assert frames[0].state == "calibrating"


@pytest.mark.parametrize("rig", ["blob_rig", "limbed_rig"])
def test_any_frame_is_the_same_in_whatever_order_frames_are_asked_for(record_take, make_player, rig, request):
    rig = request.getfixturevalue(rig)
    path, frames = record_take(names=("dog",), rig=rig)
    track = TakeTrack(make_player("dog", rig=rig), path)
    for number in (70, 69, 3, 32, 33, 31, 64, 88, 0, 1, 1, len(frames) - 1):
        assert np.array_equal(solved(track, number)[1], frames[number].R)
