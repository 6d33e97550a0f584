from dataclasses import replace

import pytest

from engine_bridge.service.players.automatic_calibration import AutomaticCalibration


@pytest.fixture
def still(kung_fu):
    """Return two seconds of a performer who stands still, from a time on."""

    def frames(since=0.0, scale=1.0):
        first = replace(kung_fu[0], positions=kung_fu[0].positions * scale)
        return [replace(first, time=since + n / 30) for n in range(60)]

    return frames


def poses(automatic, frames, rest=None):
    """Give frames, and return the time of each pose that was due, with the pose; from then on it is the rest pose."""
    found = []
    for frame in frames:
        automatic.add(frame)
        pose = automatic.due(rest, False)
        if pose is not None:
            found.append((frame.time, pose))
            rest = pose
    return found


@pytest.mark.parametrize(("scale", "count"), [(1.0, 0), (1.4, 1)])
def test_a_returning_performer_is_calibrated_again_if_the_body_is_another_one(still, scale, count):
    automatic = AutomaticCalibration("still")
    automatic.enter(returning=True)
    assert len(poses(automatic, still(scale=scale), rest=still()[0].positions)) == count


def test_the_calibration_ignores_other_performers(still):
    automatic = AutomaticCalibration("still")
    poses(automatic, still()[:25])
    automatic.enter(returning=False)
    ((time, _),) = poses(automatic, still(since=1.0))
    assert 1.9 <= time <= 2.0
