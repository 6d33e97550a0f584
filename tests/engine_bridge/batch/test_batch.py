"""A batch as a user runs it, without worker processes."""

import csv
import json
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from engine_bridge.batch.batch import Shard

from .conftest import NAMES, results


@pytest.fixture
def here(batch):
    """Run a batch in one process, with a manifest as CSV and no report."""
    return lambda *arguments, **more: batch(*arguments, "--workers", 0, "--manifest", "m.csv", "--no-report", **more)


@pytest.fixture
def rows(tmp_path):
    """Return the rows of the manifest."""

    def read(name="m.csv"):
        with (tmp_path / name).open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))

    return read


@pytest.fixture
def mine(logs, puppets, tmp_path):
    """Copies of three recordings, and of a puppet file with its mesh, which a test may change."""
    for name in ("a", "b", "c"):
        shutil.copy(logs / f"{name}.log", tmp_path)
    text = puppets[0].read_text()
    mesh = text.partition('mesh = "')[2].partition('"')[0]
    shutil.copy(puppets[0].parent / mesh, tmp_path / "mesh.glb")
    (tmp_path / "mine.toml").write_text(text.replace(mesh, "mesh.glb"))
    return tmp_path


def test_a_second_run_makes_only_what_is_missing(mine, here, rows):
    assert here("*.log", puppets=["mine.toml"])["made"] == 3
    before = results(mine / "out")
    (mine / "out/mine/b.glb").unlink()
    shutil.copy(mine / "a.log", mine / "d.log")
    again = here("*.log", puppets=["mine.toml"])
    assert (again["made"], again["unchanged"]) == (2, 2)
    assert {name: content for name, content in results(mine / "out").items() if name != "mine/d.glb"} == before
    assert [row["output"] for row in rows()] == [f"mine/{name}.glb" for name in "abcd"]


CHANGES = {
    "a setting": (lambda folder: ["--fps", "25"], 3),
    "a recording": (lambda folder: shutil.copy(folder / "a.log", folder / "b.log") and [], 1),
    "the puppet": (lambda folder: _replace(folder / "mine.toml", "gain = 0.8", "gain = 0.7"), 3),
    "a comment in the puppet": (lambda folder: _replace(folder / "mine.toml", "gain = 0.8", "gain = 0.80 # much"), 0),
    "the character": (lambda folder: _replace(folder / "mesh.glb", '"name":"blob"', '"name":"BLOB"'), 3),
    "times of modification": (lambda folder: [path.touch() for path in folder.rglob("*.*")] and [], 0),
}


def _replace(path, old, new):
    content = path.read_bytes()
    assert old.encode() in content
    path.write_bytes(content.replace(old.encode(), new.encode()))
    return []


@pytest.mark.parametrize(("change", "made"), CHANGES.values(), ids=CHANGES)
def test_a_result_is_made_again_if_what_it_depends_on_has_changed(mine, here, change, made):
    here("*.log", puppets=["mine.toml"])
    assert here("*.log", *change(mine), puppets=["mine.toml"])["made"] == made


def test_a_bad_recording_does_not_stop_the_others_and_is_not_tried_again(mine, here, rows):
    (mine / "b.log").write_text("1 2 3\n")
    (mine / "0.log").touch()
    first = here("0.log", "a.log", "b.log", "c.log", puppets=["mine.toml"], code=1)
    assert first["made"] == 2
    assert [Path(failure["log"]).name for failure in first["failures"]] == ["0.log", "b.log"]
    assert first["failures"][0]["message"].startswith(f"{mine / '0.log'}: found an empty file; expected ")
    states = {Path(row["log"]).name: (row["state"], row["output"]) for row in rows()}
    assert states == {
        "0.log": ("failed", ""),
        "a.log": ("done", "mine/a.glb"),
        "b.log": ("failed", ""),
        "c.log": ("done", "mine/c.glb"),
    }
    again = here("0.log", "a.log", "b.log", "c.log", puppets=["mine.toml"], code=1)
    assert (again["made"], again["unchanged"], again["failures"]) == (0, 2, first["failures"])
    shutil.copy(mine / "a.log", mine / "b.log")
    assert here("a.log", "b.log", puppets=["mine.toml"])["made"] == 1


def test_failures_are_tried_again_with_retry_failed_and_end_the_batch_with_fail_fast(mine, here, commands):
    (mine / "b.log").write_text("1 2 3\n")
    first = here("*.log", "--fail-fast", puppets=["mine.toml"], code=1)
    assert (first["made"], len(first["failures"])) == (1, 1)
    arguments = ["batch", "*.log", "--puppet", "mine.toml", "-o", "out", "--dry-run"]
    assert commands.run(*arguments, cwd=mine).stdout == "mine/c.glb\n"
    assert commands.run(*arguments, "--retry-failed", cwd=mine).stdout == "mine/b.glb\nmine/c.glb\n"
    assert here("*.log", "--retry-failed", puppets=["mine.toml"], code=1)["made"] == 1


def test_a_dry_run_writes_nothing(mine, commands):
    before = sorted(mine.rglob("*"))
    done = commands.run("batch", "*.log", "--puppet", "mine.toml", "-o", "out", "--dry-run", "--json", cwd=mine)
    assert json.loads(done.stdout) == {"waiting": [f"mine/{name}.glb" for name in "abc"]}
    assert sorted(mine.rglob("*")) == before


def test_results_of_a_recording_that_fails_now_are_deleted(mine, here, rows):
    here("*.log", puppets=["mine.toml"])
    (mine / "b.log").write_text("1 2 3\n")
    here("*.log", puppets=["mine.toml"], code=1)
    assert list(results(mine / "out")) == ["mine/a.glb", "mine/c.glb"]
    assert Counter(row["state"] for row in rows()) == {"done": 2, "failed": 1}


def test_every_performer_is_a_result_with_users_all(mine, here, rows, dance, commands):
    seen = np.ones(20, np.float32)
    with Recorder(mine / "two.log") as recorder:
        for index, place in enumerate(dance(20)):
            recorder.write(SkeletonFrame(index / 30, 4, place, seen))
            if index < 10:
                recorder.write(SkeletonFrame(index / 30, 7, place + 1, seen))
            if index == 5:
                recorder.write(SkeletonFrame(index / 30, 9, place + 2, seen))
    result = here("two.log", "--users", "all", puppets=["mine.toml"], code=1)
    assert (result["made"], [failure["user"] for failure in result["failures"]]) == (2, [9])
    assert [(row["output"], row["user"], row["frames"]) for row in rows()] == [
        ("mine/two.user4.glb", "4", "20"),
        ("mine/two.user7.glb", "7", "10"),
        ("", "9", ""),
    ]
    commands.run("convert", "two.log", "--puppet", "mine.toml", "--user", 7, "-o", "7.glb", cwd=mine)
    assert (mine / "out/mine/two.user7.glb").read_bytes() == (mine / "7.glb").read_bytes()
    assert here("two.log", puppets=["mine.toml"])["made"] == 1
    assert list(results(mine / "out")) == ["mine/two.glb"]


def test_shards_make_all_results_once_and_a_run_without_a_shard_joins_their_manifests(
    logs, puppets, batch, rows, tmp_path
):
    parts = []
    for index in (1, 2, 3):
        batch(logs, "--shard", f"{index}/3", "--manifest", f"{index}.csv", puppets=puppets)
        parts.append([row["output"] for row in rows(f"{index}.csv")])
    names = sorted(f"{puppet.stem}/{name}.glb" for puppet in puppets for name in NAMES)
    assert sorted(name for part in parts for name in part) == names
    assert all(parts)
    whole = batch(logs, "--workers", 0, "--no-report", "--manifest", "m.csv", puppets=puppets)
    assert (whole["made"], whole["unchanged"]) == (0, 12)
    assert sorted(row["output"] for row in rows()) == names


def test_a_part_has_the_same_results_whatever_else_there_is():
    names = [f"p/{index}" for index in range(1000)]
    parts = [[name for name in names if Shard(index, 7).has(name)] for index in range(1, 8)]
    assert sorted(name for part in parts for name in part) == sorted(names)
    assert max(map(len, parts)) < 1.3 * min(map(len, parts)) + 20
    assert [name for name in names[:10] if Shard(1, 2).has(name)] == [f"p/{index}" for index in FIRST_OF_TWO]


FIRST_OF_TWO = [0, 3, 4, 8]
"""Numbers of the first ten jobs that are in the first of two parts, now and in every later version."""


@pytest.mark.parametrize(
    "arguments", [["--shard", "0/3"], ["--shard", "4/3"], ["--targets", "3", "--as", "rig"]], ids=" ".join
)
def test_wrong_use_is_exit_code_2(mine, commands, arguments):
    done = commands.run("batch", "a.log", "--puppet", "mine.toml", "-o", "out", *arguments, cwd=mine)
    assert (done.returncode, done.stdout) == (2, "")
    assert not (mine / "out").exists()


def test_a_mistake_in_a_puppet_file_ends_the_batch_before_the_work(mine, here):
    (mine / "bad.toml").write_text('[character]\nmesh = "gone.glb"\n')
    assert "bad.toml" in here("*.log", puppets=["mine.toml", "bad.toml"], code=1)
    assert not (mine / "out").exists()


def test_a_mistyped_recording_leaves_no_folder_behind(mine, here):
    assert here("a.lgo", puppets=["mine.toml"], code=1).startswith("puppetline: a.lgo: found no such file or folder;")
    assert not (mine / "out").exists()


def test_two_puppet_files_of_the_same_name_are_refused(mine, here):
    (mine / "other").mkdir()
    shutil.copy(mine / "mine.toml", mine / "other")
    assert "found the same name as" in here("*.log", puppets=["mine.toml", "other/mine.toml"], code=1)


def test_the_text_has_a_table_of_reasons_the_most_frequent_first(mine, commands):
    for name, content in {"1": "1 2 3\n", "2": "1 2 3 4\n", "0": ""}.items():
        (mine / f"{name}.txt").write_text(content)
    done = commands.run(
        "batch", "0.txt", "1.txt", "2.txt", "a.log", "--puppet", "mine.toml", "-o", "out", "--workers", 0, cwd=mine
    )
    assert (done.returncode, done.stderr) == (1, "")
    lines = done.stdout.splitlines()
    assert lines[0].startswith(f"{mine / 'out'}: 1 made (")
    assert lines[0].endswith(" per hour), 0 unchanged, 3 failed")
    assert lines[1:3] == ["  manifest  out/manifest.parquet", "  report    out/report.html"]
    messages = {row["message"] for row in pq.read_table(mine / "out/manifest.parquet").to_pylist()} - {""}
    counts, reasons = zip(*(line.split(maxsplit=1) for line in lines[5:]), strict=True)
    assert counts == ("2", "1")
    assert len(messages) == 3
    assert set(reasons) < messages
    page = (mine / "out/report.html").read_text()
    assert page.count("<svg") == 4
    assert page.count('src="data:image/jpeg;base64,') == 1
    assert page.count("src=") == 1
    assert "http" not in page.replace("http://www.w3.org", "")


def test_performers_are_converted_without_characters(mine, here, rows, commands):
    assert here("*.log", "--performer", "bvh", puppets=[])["made"] == 3
    assert [(row["output"], row["puppet"], row["form"]) for row in rows()] == [
        (f"{name}.bvh", "", "bvh") for name in "abc"
    ]
    commands.run("convert", "a.log", "-o", "a.bvh", cwd=mine)
    assert (mine / "out/a.bvh").read_bytes() == (mine / "a.bvh").read_bytes()
    again = here("*.log", "--performer", "bvh", puppets=[])
    assert (again["made"], again["unchanged"]) == (0, 3)
    assert here("*.log", "--performer", "vrma", "--dry-run", puppets=[]) == {"waiting": ["a.vrma", "b.vrma", "c.vrma"]}


def test_characters_or_a_format_of_performers_are_required(mine, here):
    message = "Name characters with --puppet, or choose a format with --performer."
    assert message in here("*.log", puppets=[], code=2)
    assert message in here("*.log", "--performer", "bvh", puppets=["mine.toml"], code=2)
    assert "--as is about a character" in here("*.log", "--performer", "bvh", "--as", "rig", puppets=[], code=2)
