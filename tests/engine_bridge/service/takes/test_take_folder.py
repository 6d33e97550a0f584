from engine_bridge.service.takes.take_folder import Takes
from puppetline.errors import OutputError, ServiceError

from ...refusals import refused


def test_a_take_lies_in_the_folder_under_its_name_or_one_of_stage_and_time(tmp_path):
    takes = Takes(tmp_path / "takes")
    refused(ServiceError, takes.new, "../out", "stage")
    assert takes.all() == []
    assert not takes.folder.exists()
    path = takes.new("a-1_B", "stage")
    assert path == takes.folder / "a-1_B.log"
    path.write_bytes(b"123")
    [take] = takes.all()
    assert take == take | {"name": "a-1_B", "bytes": 3}
    refused(ServiceError, takes.new, "a-1_B", "stage")
    assert takes.new(None, "left").name.startswith("left-20")
    refused(OutputError, Takes(path / "deeper").new, "a", "stage")
