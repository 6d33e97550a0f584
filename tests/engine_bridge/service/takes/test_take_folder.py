import pytest

from engine_bridge.service.takes.take_folder import Takes
from puppetline.errors import OutputError, ServiceError


@pytest.mark.parametrize("name", ["../out", "a/b", "a.log", ".", "..", "C:x", "a\0b", "a\n", "é", "x" * 65, " "])
def test_no_name_leads_out_of_the_folder(tmp_path, name):
    with pytest.raises(ServiceError, match="the take's name"):
        Takes(tmp_path / "takes").new(name, "stage")
    assert not (tmp_path / "takes").exists()


def test_a_take_lies_in_the_folder_under_its_name(tmp_path):
    takes = Takes(tmp_path / "takes")
    path = takes.new("a-1_B", "stage")
    assert path == tmp_path / "takes" / "a-1_B.log"
    path.write_bytes(b"123")
    assert [(take["name"], take["bytes"]) for take in takes.all()] == [("a-1_B", 3)]
    with pytest.raises(ServiceError, match="the name of an existing take"):
        takes.new("a-1_B", "stage")


def test_without_a_name_it_is_called_by_stage_and_time(tmp_path):
    assert Takes(tmp_path).new(None, "left").name.startswith("left-20")


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "takes").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        Takes(tmp_path / "takes" / "deeper").new("a", "stage")


def test_a_folder_that_is_not_there_holds_nothing(tmp_path):
    assert Takes(tmp_path / "none").all() == []
