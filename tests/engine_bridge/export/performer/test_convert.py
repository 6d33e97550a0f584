import numpy as np
import pytest

from capture.clip import SkeletonClip
from capture.pose import Pose
from capture.skeleton import JOINT_INDEX
from capture.sources.demo import performances
from engine_bridge.export.performer import convert as module
from engine_bridge.export.performer.convert import convert_performers, describe, stage_of
from engine_bridge.performance.settings import Settings
from puppetline.errors import OutputError, SkeletonLogError


@pytest.fixture
def two(record_events, tmp_path):
    """A recording of two performers, of which the second appears after half a second, and a third in one frame."""
    frames = list(performances()["walk"]().frames())[:40]
    events = []
    for number, frame in enumerate(frames):
        events.append(frame.__class__(frame.time, 1, frame.positions, frame.confidence))
        if number >= 15:
            events.append(frame.__class__(frame.time, 2, frame.positions + np.array([1.0, 0.0, 0.0]), frame.confidence))
        if number == 20:
            events.append(
                frame.__class__(frame.time, 5, frame.positions + np.array([-1.0, 0.0, 0.0]), frame.confidence)
            )
    return record_events(tmp_path / "two.log", events)


def test_several_performers_are_several_files_in_the_same_place(two, tmp_path):
    made = convert_performers(two, tmp_path / "out.bvh", Settings())
    assert [each.user for each in made] == [1, 2]
    assert sorted(path.name for path in tmp_path.glob("*.bvh")) == ["out.user1.bvh", "out.user2.bvh"]
    assert "User 2 appears 0.50 s after the first performer." in made[1].notes
    assert "User 5 is omitted: a recording with a single frame at 30 frames per second." in made[1].notes
    assert describe(made).startswith(f"{tmp_path}/out.user1.bvh: 39 frames, 1.3 s, ")
    first, second = (
        np.loadtxt(tmp_path / f"out.user{user}.bvh", skiprows=1 + lines_before(tmp_path / f"out.user{user}.bvh"))
        for user in (1, 2)
    )
    # one metre to the right in the sensor's view; the smoothing began at other times
    np.testing.assert_allclose(second[-1, :3] - first[-1, :3], [-100.0, 0.0, 0.0], atol=1.0)


def lines_before(path):
    return next(k for k, line in enumerate(path.read_text().splitlines()) if line.startswith("Frame Time"))


def test_a_chosen_performer_has_the_name_that_was_given(two, tmp_path):
    (made,) = convert_performers(two, tmp_path / "out.vrma", Settings(user=2))
    assert (made.output, made.user) == (str(tmp_path / "out.vrma"), 2)


def test_a_part_is_that_of_the_whole_motion(take, tmp_path):
    convert_performers(take, tmp_path / "whole.bvh", Settings())
    convert_performers(take, tmp_path / "part.bvh", Settings(start=0.5, stop=1.0))
    whole, part = ((tmp_path / name).read_text().splitlines() for name in ("whole.bvh", "part.bvh"))
    begin = lines_before(tmp_path / "whole.bvh") + 1
    assert part[begin:] == whole[begin + 15 : begin + 31]


def test_the_tilt_of_a_sensor_is_removed(standing):
    tilted = Pose.of_degrees(-12.0, 0.0, 0.0, np.zeros(3)).apply(np.tile(standing, (20, 1, 1)))
    clip = SkeletonClip("ntu_rgbd", 0, np.arange(20) / 30, tilted, np.ones((20, 20), dtype=np.float32))
    (levelled,), _, notes = stage_of([clip])
    assert notes == ("The sensor looks down by 12°, from performers who stand upright; this is corrected.",)
    body = levelled.positions[0, JOINT_INDEX["head"]] - levelled.positions[0, JOINT_INDEX["hip_center"]]
    upright = standing[JOINT_INDEX["head"]] - standing[JOINT_INDEX["hip_center"]]
    assert np.degrees(np.arccos(body @ upright / np.linalg.norm(body) / np.linalg.norm(upright))) < 1.5


@pytest.mark.parametrize("name", ["out.fbx", "out", "missing/out.bvh"])
def test_an_output_that_cannot_be_written_is_refused(take, tmp_path, name):
    with pytest.raises(OutputError):
        convert_performers(take, tmp_path / name, Settings())
    assert list(tmp_path.iterdir()) == []


def test_joints_that_are_never_known_are_named(record, dance, tmp_path):
    positions = dance(20)
    positions[:, JOINT_INDEX["hand_left"]] = np.nan
    (made,) = convert_performers(record(tmp_path / "lost.log", positions), tmp_path / "out.bvh", Settings())
    assert any("has no data for hand_left;" in note for note in made.notes)


def test_an_interrupt_leaves_no_file(take, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("pathlib.Path.replace", interrupted)  # when all is written beside
    with pytest.raises(KeyboardInterrupt):
        module.convert_performers(take, tmp_path / "out.bvh", Settings())
    assert list(tmp_path.iterdir()) == []


def test_one_frame_is_refused(record, dance, tmp_path):
    log = record(tmp_path / "one.log", dance(1))
    with pytest.raises(SkeletonLogError, match="a single frame"):
        convert_performers(log, tmp_path / "out.bvh", Settings())
