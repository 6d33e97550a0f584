import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES, clean
from puppetline.examples.performer import REST, posed

from capture.body import not_upright
from capture.skeleton import INFERRED, JOINT_INDEX, LOST, TRACKED

NAMES = list(PERFORMANCES)
RATE = 30.0


@pytest.mark.parametrize("name", NAMES)
def test_a_performer_begins_and_ends_in_the_neutral_pose_on_feet_that_stand_at_the_speed_of_a_human(name):
    clip = clean(name)
    (neutral,) = posed({part: np.array([rest]) for part, rest in REST.items()}, distance=2.5)
    start, end = clip.positions[clip.times <= 0.79], clip.positions[clip.times >= clip.times[-1] - 0.3]
    assert len(start) >= 0.6 * RATE
    for pause in (start, end):
        np.testing.assert_allclose(pause, np.broadcast_to(pause[0], pause.shape), rtol=0, atol=1e-12)
        np.testing.assert_allclose(pause[0] - pause[0, 0], neutral - neutral[0], rtol=0, atol=1e-12)
    assert np.linalg.norm(np.diff(clip.positions, axis=0), axis=2).max() * RATE < 12.0
    assert np.linalg.norm(np.diff(clip.positions, 2, axis=0), axis=2).max() * RATE**2 < 150.0
    stands = []
    for side in ("left", "right"):
        ankle, foot = (clip.positions[:, JOINT_INDEX[f"{joint}_{side}"]] for joint in ("ankle", "foot"))
        on_floor = np.abs(ankle[:, 1] - ankle[0, 1]) < 1e-9
        still = on_floor[1:] & on_floor[:-1]
        for path in (ankle, foot):
            assert np.abs(np.diff(path, axis=0)[still]).max() < 1e-9
        assert ankle[:, 1].min() > ankle[0, 1] - 1e-9
        stands.append(on_floor)
    assert np.all(stands[0] | stands[1])


@pytest.mark.parametrize("name", NAMES)
def test_it_is_recorded_the_same_each_time_with_joints_that_drop_out_or_are_guessed_but_not_at_the_start(name):
    clip, again = PERFORMANCES[name](), PERFORMANCES[name]()
    for field in ("times", "positions", "confidence"):
        np.testing.assert_array_equal(getattr(clip, field), getattr(again, field))
    assert clip.user == 1
    somebody = (clip.confidence > LOST).any(axis=1)
    assert 0.003 < np.mean(clip.confidence[somebody] == LOST) < 0.015
    assert 0.001 < np.mean(clip.confidence[somebody] == INFERRED) < 0.10
    begin = clip.times <= 0.6
    assert np.all(clip.confidence[begin] == TRACKED)
    assert np.abs(clip.positions[begin] - clean(name).positions[0]).max() < 0.04
    assert not_upright(np.median(clip.positions[begin], axis=0)) == []
