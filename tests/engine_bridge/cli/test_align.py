"""Two sensors from their recordings to one recording, as a user runs it."""

import json

import numpy as np
import pytest
from click.testing import CliRunner
from puppetline.examples.performances import clean

from capture.formats import read_log
from capture.pose import Pose
from capture.skeleton import SkeletonFrame
from engine_bridge.cli.main import main

POSE = Pose.of_degrees(4.0, -75.0, 2.0, np.array([2.4, 0.3, 1.9]))
HERE = Pose(np.eye(3), np.zeros(3))


def seen(frame, pose, clock=0.0):
    positions = (frame.positions - pose.position) @ pose.rotation
    return SkeletonFrame(frame.time + clock, frame.user, positions, frame.confidence)


@pytest.fixture
def recordings(record_events, tmp_path):
    """Recordings of a walk by two sensors, the second with a clock that is 20 ms ahead."""
    for name, pose, clock in (("left", HERE, 0.0), ("right", POSE, 0.02)):
        record_events(tmp_path / f"{name}.log", (seen(frame, pose, clock) for frame in clean("walk").frames()))
    return tmp_path


@pytest.fixture
def invoke(recordings, monkeypatch):
    monkeypatch.chdir(recordings)

    def invoke(*arguments, code=0):
        result = CliRunner().invoke(main, [str(each) for each in arguments])
        assert result.exit_code == code, result.output
        return result

    return invoke


def test_align_finds_the_pose_and_the_file_plays_the_recordings_as_one(invoke, recordings):
    (recordings / "set").mkdir()
    [found] = json.loads(invoke("align", "left.log", "right.log", "-o", "set/two.toml", "--json").output)
    np.testing.assert_allclose(found["position"], POSE.position, atol=1e-3)
    np.testing.assert_allclose(found["rotation"], [4.0, -75.0, 2.0], atol=0.02)
    assert found["clock"] == pytest.approx(0.02, abs=1e-3)
    assert found["residual_cm"] < 0.1
    assert found["source"] == "replay:../right.log"
    invoke("record", "--source", "fused:set/two.toml", "-o", "fused.log", "--seconds", 2)
    [clip] = read_log(recordings / "fused.log")
    walk = clean("walk")
    assert 40 < len(clip.times) < 70
    np.testing.assert_allclose(clip.positions, walk.positions[: len(clip.times)], atol=0.01)


def test_the_text_states_the_pose_and_the_residual(invoke, recordings):
    text = invoke("align", "left.log", "right.log", "-o", "two.toml", "--source", "osc:1", "--source", "osc:2").output
    assert "right.log: at (2.40, 0.30, 1.90) m, tilt 4.0°, turn -75.0°, roll 2.0°, clock +20.0 ms" in text
    assert "joints 0.0 cm apart (mean) in 9.2 s; left and right differ in 0 % of the frames" in text
    assert 'source = "osc:2"' in (recordings / "two.toml").read_text()


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["left.log", "-o", "two.toml"], 2, "Give two or more recordings."),
        (["left.log", "none.log", "-o", "two.toml"], 1, "none.log"),
        (["left.log", "right.log", "-o", "two.txt"], 1, "two.toml"),
        (["left.log", "right.log", "-o", "two.toml", "--source", "osc:1"], 1, "1 times --source and 2 recordings"),
        (["left.log", "other.log", "-o", "two.toml"], 1, "left.log and other.log: found"),
    ],
)
def test_recordings_that_cannot_be_aligned_are_errors_and_no_file_is_written(
    invoke, record_events, recordings, arguments, code, message
):
    record_events(recordings / "other.log", clean("roar").frames())
    result = invoke("align", *arguments, code=code)
    assert message in (result.output if code == 2 else str(result.exception) + result.output)
    assert not (recordings / "two.toml").exists()
