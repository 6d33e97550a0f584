from pathlib import Path

import numpy as np
import pytest

from capture.formats._performers import clips_by_performer
from capture.skeleton import SkeletonFrame
from puppetline.errors import SkeletonLogError

PATH = Path("take.log")


def frame(time: float, user: int, confidence: float = 1) -> SkeletonFrame:
    return SkeletonFrame(time, user, np.full((20, 3), float(user)), np.full(20, confidence, np.float32))


def test_bodies_are_sorted_by_performer_in_order_of_appearance() -> None:
    frames = [frame(0, 9), frame(0.1, 4), frame(0.1, 9), frame(0.5, 4)]
    nine, four = clips_by_performer(PATH, "some", frames, ("A note.",))
    assert (nine.user, four.user) == (9, 4)
    assert (nine.times.tolist(), four.times.tolist()) == ([0, 0.1], [0.1, 0.5])
    assert (nine.positions == 9).all()
    assert (four.positions == 4).all()
    assert nine.format == four.format == "some"
    assert nine.notes == four.notes == ("A note.",)


def test_a_body_twice_in_a_frame_counts_once() -> None:
    (clip,) = clips_by_performer(PATH, "some", [frame(0, 1), frame(0, 1), frame(1, 1)])
    assert clip.times.tolist() == [0, 1]
    assert "1 of 3 frames" in clip.notes[0]


def test_bodies_never_tracked_are_left_out() -> None:
    (clip,) = clips_by_performer(PATH, "some", [frame(0, 1, 0), frame(0, 2), frame(1, 2, 0)])
    assert clip.user == 2
    assert clip.tracked_frames == 1
    assert np.isnan(clip.positions[1]).all()


@pytest.mark.parametrize("frames", [[], [frame(0, 1, 0)]])
def test_no_tracked_body_at_all_is_an_error(frames: list[SkeletonFrame]) -> None:
    with pytest.raises(SkeletonLogError, match="no frame with a tracked performer"):
        clips_by_performer(PATH, "some", frames)
