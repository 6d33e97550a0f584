"""Two sensors from their recordings to one recording, as a user runs it."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from puppetline.examples.performances import clean

from capture.formats import read_log
from capture.sensor_pose import SensorPose
from capture.skeleton import SkeletonFrame

POSE = SensorPose.of_degrees(4.0, -75.0, 2.0, np.array([2.4, 0.3, 1.9]))
CLOCK = 0.02


@pytest.fixture
def walk(record_events, tmp_path):
    """A walk, and recordings of it by two sensors, of which the second has another pose and clock."""
    clip = clean("walk")
    record_events(tmp_path / "left.log", clip.frames())
    seen = (
        SkeletonFrame(each.time + CLOCK, each.user, (each.positions - POSE.position) @ POSE.rotation, each.confidence)
        for each in clip.frames()
    )
    record_events(tmp_path / "right.log", seen)
    return clip


def test_align_finds_the_pose_and_the_file_plays_the_recordings_as_one(invoke, walk, tmp_path, given_clock):
    aligning = "align", "left.log", "right.log", "-o"
    (tmp_path / "set").mkdir()
    [found] = json.loads(invoke(*aligning, "set/two.toml", "--json").output)
    assert_allclose(found["position"], POSE.position, atol=1e-3)
    assert_allclose(found["rotation"], [4.0, -75.0, 2.0], atol=0.02)
    assert found["clock"] == pytest.approx(CLOCK, abs=1e-3)
    assert found["residual_cm"] < 0.1
    assert found["source"] == "replay:../right.log"
    invoke("record", "--source", "fused:set/two.toml", "-o", "fused.log", "--seconds", 2)
    [clip] = read_log(tmp_path / "fused.log")
    assert 55 <= len(clip.times) <= 61  # of the first two seconds, at 30 per second
    assert_allclose(clip.positions, walk.positions[: len(clip.times)], atol=0.01)
    text = invoke(*aligning, "two.toml", "--source", "osc:1", "--source", "osc:2").output
    assert "right.log: at (2.40, 0.30, 1.90) m, tilt 4.0°, turn -75.0°, roll 2.0°, clock +20.0 ms" in text
    assert "joints 0.0 cm apart (mean) in 9.2 s; left and right differ in 0 % of the frames" in text
    assert 'source = "osc:2"' in (tmp_path / "two.toml").read_text()


UNUSABLE = """
left.log none.log -o two.toml                  → none.log
left.log right.log -o two.txt                  → two.toml
left.log right.log -o two.toml --source osc:1  → 1 sources and 2 recordings
left.log other.log -o two.toml                 → left.log and other.log
"""


def test_recordings_that_cannot_be_aligned_are_refused(assert_refused, record_events, walk, tmp_path):
    record_events(tmp_path / "other.log", clean("roar").frames())
    for command, part in (line.split("→") for line in UNUSABLE.strip().splitlines()):
        assert_refused("align", *command.split(), parts=[part.strip()])
