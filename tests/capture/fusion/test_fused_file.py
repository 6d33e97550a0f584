import numpy as np
import pytest

from capture.fusion.fused_file import load, write
from capture.fusion.source import FusedSource, Member
from capture.pose import Pose
from capture.sources.registry import open_source
from puppetline.errors import SkeletonLogError, SourceError

FIRST = '[[sensor]]\nsource = "osc:0"\n'
SECOND = '[[sensor]]\nsource = "osc:0"\nposition = [1, 0.5, 2]\n'


def test_written_files_are_read_back(tmp_path):
    pose = Pose.of_degrees(4.5, -75.25, 2.125, np.array([2.4, 0.3, -1.9]))
    members = [Member("replay:a b.log", Pose(np.eye(3), np.zeros(3))), Member('osc:7110?units=mm&x="', pose, 0.0417)]
    write(tmp_path / "two.toml", members)
    read = [sensor.member for sensor in load(tmp_path / "two.toml").sensor]
    assert [(each.uri, each.clock) for each in read] == [(each.uri, each.clock) for each in members]
    for one, other in zip(read, members, strict=True):
        np.testing.assert_allclose(one.pose.rotation, other.pose.rotation, atol=1e-12)
        np.testing.assert_array_equal(one.pose.position, other.pose.position)


def test_a_file_opens_its_sensors_and_the_first_needs_no_pose(tmp_path):
    (tmp_path / "two.toml").write_text(FIRST + SECOND)
    source = open_source("fused:two.toml", tmp_path)
    assert isinstance(source, FusedSource)
    assert source.name == "fused:two.toml"
    source.close()


@pytest.mark.parametrize(
    ("text", "place", "found"),
    [
        (FIRST, "sensor", "expected at least 2|list"),
        (FIRST + FIRST, "[[sensor]] 2, position", "nothing"),
        (FIRST + SECOND + "clok = 1", "[[sensor]] 2, clok", "the unknown key 'clok'"),
        (FIRST + SECOND.replace("2]", "nan]"), "[[sensor]] 2, position, 3", "nan"),
        (FIRST + SECOND.replace("2]", "2000]"), "[[sensor]] 2, position, 3", "2000"),
        (FIRST + SECOND.replace("osc:0", "fused:two.toml"), "[[sensor]] 2, source", "'fused:two.toml'"),
        (FIRST + SECOND.replace("osc:0", "replay:a.log?loop"), "[[sensor]] 2, source", "'replay:a.log?loop'"),
        (FIRST + SECOND.replace("osc:0", "demo:walk"), "two.toml", "recordings and live sensors together"),
        (FIRST + SECOND + "clock = -1.5", "two.toml", "clocks 1.5 s apart"),
        (FIRST + "x", "two.toml", "a syntax error"),
    ],
)
def test_errors_in_the_file_are_reported_with_their_place(tmp_path, text, place, found):
    (tmp_path / "two.toml").write_text(text)
    with pytest.raises(SourceError) as caught:
        open_source("fused:two.toml", tmp_path)
    assert place in caught.value.where
    assert any(each in str(caught.value) for each in found.split("|"))


def test_a_missing_file_or_recording_is_reported(tmp_path):
    with pytest.raises(SourceError, match=r"none.toml: .*puppetline align"):
        open_source("fused:none.toml", tmp_path)
    (tmp_path / "two.toml").write_text((FIRST + SECOND).replace("osc:0", "replay:none.log"))
    with pytest.raises(SkeletonLogError, match=r"none\.log"):
        open_source("fused:two.toml", tmp_path)
