import json

from capture.formats import read_log


def test_the_command_records_what_a_source_plays_and_prints_it(invoke, assert_refused, tmp_path, given_clock):
    made = invoke("record", "--source", "demo:walk", "-o", "take.log", "--seconds", 1, "--json")
    summary = json.loads(made.stdout)
    [clip] = read_log(tmp_path / "take.log")
    assert len(clip.times) == summary["frames"] == 30
    assert summary["users"] == [1]
    assert summary["ended"] == "time"
    assert_refused("record", "--source", "demo:walk", "-o", "take.log", parts=["take.log", "--force"])
