from dataclasses import replace

import numpy as np
import pytest

from capture.clip import SkeletonClip
from capture.formats.bvh_parser import parse
from capture.sensor_pose import SensorPose
from capture.skeleton import JOINT_INDEX
from capture.sources.demo import performances
from engine_bridge.export.performer.convert import convert_performers, describe, upright_performers
from engine_bridge.performance.settings import Settings
from puppetline.errors import OutputError

from ...refusals import refused
from ..conftest import unit


@pytest.fixture
def two(record_events, tmp_path):
    """A recording of two performers, of which the second appears after half a second, and a third in one frame."""
    events = []
    for number, frame in enumerate(list(performances()["walk"]().frames())[:40]):
        shifts = {1: 0.0} | ({2: 1.0} if number >= 15 else {}) | ({5: -1.0} if number == 20 else {})
        events += [
            replace(frame, user=user, positions=np.add(frame.positions, [x, 0, 0])) for user, x in shifts.items()
        ]
    return record_events(tmp_path / "two.log", events)


def values_of(path):
    return parse(path, None)[1]


def test_several_performers_are_several_files_in_the_same_place_and_a_chosen_one_has_the_name_given(two, tmp_path):
    made = convert_performers(two, tmp_path / "out.bvh", Settings())
    outputs = [tmp_path / f"out.user{user}.bvh" for user in (1, 2)]
    assert [(each.user, each.output) for each in made] == [(1, str(outputs[0])), (2, str(outputs[1]))]
    assert sorted(tmp_path.glob("*.bvh")) == outputs
    for part in ("User 2 appears 0.50 s", "User 5 is omitted"):
        assert any(note.startswith(part) for note in made[1].notes)
    assert describe(made).startswith(f"{outputs[0]}: 39 frames, 1.3 s, ")
    first, second = map(values_of, outputs)
    # one metre to the right in the sensor's view; the smoothing began at other times
    np.testing.assert_allclose(second[-1, :3] - first[-1, :3], [-100.0, 0.0, 0.0], atol=1.0)
    (made,) = convert_performers(two, tmp_path / "out.vrma", Settings(user=2))
    assert (made.output, made.user) == (str(tmp_path / "out.vrma"), 2)


ENDS = [JOINT_INDEX["hip_center"], JOINT_INDEX["head"]]


def test_a_part_is_that_of_the_whole_motion(take, tmp_path):
    convert_performers(take, tmp_path / "whole.bvh", Settings())
    convert_performers(take, tmp_path / "part.bvh", Settings(start=0.5, stop=1.0))
    np.testing.assert_array_equal(values_of(tmp_path / "part.bvh"), values_of(tmp_path / "whole.bvh")[15:31])


def test_the_tilt_of_a_sensor_is_removed(standing):
    tilted = SensorPose.of_degrees(-12.0, 0.0, 0.0, np.zeros(3)).apply(np.tile(standing, (20, 1, 1)))
    clip = SkeletonClip("ntu_rgbd", 0, np.arange(20) / 30, tilted, np.ones((20, 20), dtype=np.float32))
    (levelled,), _, notes = upright_performers([clip])
    assert len(notes) == 1
    shown, upright = unit(np.diff([levelled.positions[0, ENDS], standing[ENDS]], axis=1)[:, 0])
    assert np.degrees(np.arccos(shown @ upright)) < 1.5


@pytest.mark.parametrize("name", ["out.fbx", "out", "missing/out.bvh"])
def test_an_output_that_cannot_be_written_is_refused(take, tmp_path, name):
    refused(OutputError, convert_performers, take, tmp_path / name, Settings())
    assert list(tmp_path.iterdir()) == []


def test_joints_that_are_never_known_are_named(record, dance, tmp_path):
    positions = dance(20)
    positions[:, JOINT_INDEX["hand_left"]] = np.nan
    (made,) = convert_performers(record(tmp_path / "lost.log", positions), tmp_path / "out.bvh", Settings())
    assert any("has no data for hand_left;" in note for note in made.notes)
