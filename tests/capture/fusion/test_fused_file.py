import numpy as np
import pytest

from capture.fusion.fused_file import load, write
from capture.fusion.source import FusedSource, Member
from capture.sensor_pose import SensorPose
from capture.sources.registry import open_source
from puppetline.errors import SkeletonLogError

from ..conftest import refused
from .virtual_sensors import HERE

FIRST = '[[sensor]]\nsource = "osc:0"\n'
SECOND = '[[sensor]]\nsource = "osc:0"\nposition = [1, 0.5, 2]\n'


def test_written_files_are_read_back(tmp_path):
    pose = SensorPose.of_degrees(4.5, -75.25, 2.125, np.array([2.4, 0.3, -1.9]))
    members = [Member("replay:a b.log", HERE), Member('osc:7110?units=mm&x="', pose, 0.0417)]
    write(tmp_path / "two.toml", members)
    for sensor, member in zip(load(tmp_path / "two.toml").sensor, members, strict=True):
        read = sensor.member
        assert (read.uri, read.clock) == (member.uri, member.clock)
        np.testing.assert_allclose(read.pose.rotation, member.pose.rotation, atol=1e-12)
        np.testing.assert_array_equal(read.pose.position, member.pose.position)


def test_a_file_opens_its_sensors_and_the_first_needs_no_pose(tmp_path, until_end):
    (tmp_path / "two.toml").write_text(FIRST + SECOND)
    source = until_end(open_source("fused:two.toml", tmp_path))
    assert (type(source), source.name) == (FusedSource, "fused:two.toml")


@pytest.mark.parametrize(
    ("text", "place"),
    [
        (FIRST, "sensor"),
        (FIRST + FIRST, "[[sensor]] 2, position"),
        (FIRST + SECOND + "clok = 1", "[[sensor]] 2, clok"),
        (FIRST + SECOND.replace("2]", "nan]"), "[[sensor]] 2, position, 3"),
        (FIRST + SECOND.replace("2]", "2000]"), "[[sensor]] 2, position, 3"),
        (FIRST + SECOND.replace("osc:0", "fused:two.toml"), "[[sensor]] 2, source"),
        (FIRST + SECOND.replace("osc:0", "replay:a.log?loop"), "[[sensor]] 2, source"),
        (FIRST + SECOND.replace("osc:0", "demo:walk"), "two.toml"),
        (FIRST + SECOND + "clock = -1.5", "two.toml"),
        (FIRST + "x", "two.toml"),
    ],
)
def test_errors_in_the_file_are_reported_with_their_place(tmp_path, text, place):
    (tmp_path / "two.toml").write_text(text)
    assert place in refused(open_source, "fused:two.toml", tmp_path).where


def test_a_missing_file_or_recording_is_reported(tmp_path):
    assert "none.toml" in refused(open_source, "fused:none.toml", tmp_path).where
    (tmp_path / "two.toml").write_text((FIRST + SECOND).replace("osc:0", "replay:none.log"))
    with pytest.raises(SkeletonLogError):
        open_source("fused:two.toml", tmp_path)
