import os

import pytest

from capture.formats.options import ReadOptions
from engine_bridge.batch.recordings import find_recordings
from puppetline.errors import SkeletonLogError

from ..refusals import refused
from .conftest import NAMES


@pytest.fixture
def find(tmp_path, monkeypatch):
    """Find recordings as in the folder of the test; returns names with paths, and files that are none."""
    monkeypatch.chdir(tmp_path)

    def names(*arguments, **options):
        recordings = find_recordings([str(each) for each in arguments], tmp_path / "out", ReadOptions(**options))
        return {each.name: each.path for each in recordings.found}, recordings.others

    return names


def test_a_folder_has_all_recordings_in_it_by_their_relative_names(find, logs):
    found, others = find(logs)
    assert found == {name: logs / f"{name}.log" for name in NAMES}
    assert others == [logs / "notes.txt"]


def test_text_in_a_folder_is_a_recording_if_its_columns_are_named(find, tmp_path):
    (tmp_path / "logs").mkdir()
    table = tmp_path / "logs" / "a.csv"
    table.write_text("one,two,three\n" + "0.1,0.2,0.3\n" * 9)
    assert find(tmp_path / "logs", columns=tmp_path / "columns.toml") == ({"a": table}, [])
    refused(SkeletonLogError, find, tmp_path / "logs")


def test_a_pattern_names_its_files_from_the_folder_in_front_of_the_first_wildcard(find, logs):
    assert list(find(f"{logs}/**/a.log")[0]) == ["a", "day 1/a"]
    assert list(find(f"{logs}/d*")[0]) == ["d", "day 1/a", "day 1/é"]
    assert list(find(f"{logs}/n*")[0]) == ["notes"]


def test_a_file_has_its_own_name_and_is_used_whatever_it_contains(find, logs):
    assert find(logs / "notes.txt", logs / "day 1/é.log") == (
        {"notes": logs / "notes.txt", "é": logs / "day 1/é.log"},
        [],
    )


def test_a_list_has_an_argument_per_line_and_comments(find, logs, tmp_path):
    (tmp_path / "list.txt").write_text(f"# mine\n\n{logs}/b.log\n{logs}/day 1\ngone.log\n")
    found, _ = find("@list.txt")
    there = {"a": "day 1/a.log", "b": "b.log", "é": "day 1/é.log"}
    assert found == {name: logs / path for name, path in there.items()} | {"gone": tmp_path / "gone.log"}


def test_a_recording_that_is_given_twice_is_used_once_under_its_first_name(find, logs):
    assert list(find(logs, logs / "day 1/a.log", f"{logs}/day*/*")[0]) == NAMES


def test_empty_files_are_reported_by_their_conversion_and_hidden_and_excluded_ones_are_not_used(find, tmp_path):
    for name in ("empty.log", ".hidden", "out/x.log", ".git/x"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert list(find(tmp_path)[0]) == ["empty"]


def test_files_that_differ_in_their_ending_are_named_with_it(find, logs, tmp_path):
    for name in ("x.log", "x.txt", "y.log"):
        os.link(logs / "a.log", tmp_path / name)
    assert list(find(tmp_path)[0]) == ["x.log", "x.txt", "y"]


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (["gone"], "no such file or folder"),
        (["*.log"], "no matching file"),
        (["@gone"], "a file that cannot be read (No such file or directory)"),
        (["empty"], "no file"),
        (["texts"], "2 files, none of which is a recording"),
        (["LOGS/a.log", "LOGS/day 1/a.log"], "the same name as LOGS/a.log"),
    ],
    ids=str,
)
def test_arguments_without_a_recording_or_with_two_of_one_name_are_errors(find, logs, tmp_path, arguments, found):
    for folder in ("empty", "texts"):
        (tmp_path / folder).mkdir()
    for name in ("a", "b"):
        (tmp_path / "texts" / f"{name}.txt").write_text("Dear diary\n")
    error = refused(SkeletonLogError, find, *(each.replace("LOGS", str(logs)) for each in arguments))
    assert error.found == found.replace("LOGS", str(logs))
