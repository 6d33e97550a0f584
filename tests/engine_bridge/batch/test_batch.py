"""A batch as a user runs it, without worker processes."""

import csv
import shutil
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from engine_bridge.batch.batch import Shard
from engine_bridge.cli.main import main

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


def convert(*arguments):
    assert CliRunner().invoke(main, ["convert", *map(str, arguments)]).exit_code == 0


CHANGES = {
    "a recording": (lambda folder: shutil.copy(folder / "a.log", folder / "b.log"), 1),
    "the puppet": (lambda folder: rewrite(folder / "mine.toml", "gain = 0.8", "gain = 0.7"), 3),
    "a comment in the puppet": (lambda folder: rewrite(folder / "mine.toml", "gain = 0.7", "gain = 0.70 # much"), 0),
    "the character": (lambda folder: rewrite(folder / "mesh.glb", '"name":"blob"', '"name":"BLOB"'), 3),
    "times of modification": (lambda folder: [path.touch() for path in folder.rglob("*.*")], 0),
}


def rewrite(path, old, new):
    content = path.read_bytes()
    assert old.encode() in content
    path.write_bytes(content.replace(old.encode(), new.encode()))


def test_only_what_is_missing_or_depends_on_what_has_changed_is_made_again(mine, here, rows):
    assert here("*.log")["made"] == 3
    before = results(mine / "out")
    (mine / "out/mine/b.glb").unlink()
    again = here("*.log")
    assert (again["made"], again["unchanged"]) == (1, 2)
    assert results(mine / "out") == before
    assert [row["output"] for row in rows()] == [f"mine/{name}.glb" for name in "abc"]
    assert here("*.log", "--fps", "25")["made"] == 3
    made = {}
    for name, (change, _) in CHANGES.items():
        change(mine)
        made[name] = here("*.log", "--fps", "25")["made"]
    assert made == {name: number for name, (_, number) in CHANGES.items()}


def test_a_bad_recording_does_not_stop_the_others_and_is_not_tried_again(mine, here, rows):
    given = ("0.log", "a.log", "b.log", "c.log")
    here("*.log")
    (mine / "b.log").write_text("1 2 3\n")
    (mine / "0.log").touch()
    first = here(*given, code=1)
    assert (first["made"], first["unchanged"]) == (0, 2)
    assert [Path(failure["log"]).name for failure in first["failures"]] == ["0.log", "b.log"]
    assert str(mine / "0.log") in first["failures"][0]["message"]
    outputs = ["", "mine/a.glb", "", "mine/c.glb"]
    assert [(Path(row["log"]).name, row["state"], row["output"]) for row in rows()] == [
        (log, "done" if output else "failed", output) for log, output in zip(given, outputs, strict=True)
    ]
    assert list(results(mine / "out")) == ["mine/a.glb", "mine/c.glb"]
    again = here(*given, code=1)
    assert (again["made"], again["unchanged"], again["failures"]) == (0, 2, first["failures"])
    shutil.copy(mine / "a.log", mine / "b.log")
    assert here(*given, code=1)["made"] == 1


def test_failures_are_tried_again_with_retry_failed_and_end_the_batch_with_fail_fast(mine, here, print_batch):
    (mine / "b.log").write_text("1 2 3\n")
    first = here("*.log", "--fail-fast", code=1)
    assert (first["made"], len(first["failures"])) == (1, 1)
    before = sorted(mine.rglob("*"))
    assert print_batch("*.log", "--dry-run").stdout == "mine/c.glb\n"
    assert here("*.log", "--retry-failed", "--dry-run") == {"waiting": ["mine/b.glb", "mine/c.glb"]}
    assert sorted(mine.rglob("*")) == before
    assert here("*.log", "--retry-failed", code=1)["made"] == 1


def test_every_performer_is_a_result_with_users_all(mine, here, rows, dance, frames, record_events):
    users = {4: dance(20), 7: dance(10) + 1, 9: dance(6)[5:] + 2}
    events = [replace(each, user=user) for user, positions in users.items() for each in frames(positions)]
    record_events(mine / "two.log", sorted(events, key=lambda event: event.time))
    result = here("two.log", "--users", "all", code=1)
    assert (result["made"], [failure["user"] for failure in result["failures"]]) == (2, [9])
    assert [(row["output"], row["user"], row["frames"]) for row in rows()] == [
        ("mine/two.user4.glb", "4", "20"),
        ("mine/two.user7.glb", "7", "10"),
        ("", "9", ""),
    ]
    convert("two.log", "--puppet", "mine.toml", "--user", 7, "-o", "7.glb")
    assert (mine / "out/mine/two.user7.glb").read_bytes() == (mine / "7.glb").read_bytes()
    assert here("two.log")["made"] == 1
    assert list(results(mine / "out")) == ["mine/two.glb"]


def test_shards_make_all_results_once_and_a_run_without_a_shard_joins_their_manifests(logs, puppets, batch, rows):
    names, parts = sorted(f"{puppets[0].stem}/{name}.glb" for name in NAMES), []
    for index in (1, 2, 3):
        batch(logs, "--shard", f"{index}/3", "--manifest", f"{index}.csv", puppets=puppets[:1])
        parts.append([row["output"] for row in rows(f"{index}.csv")])
    assert sorted(name for part in parts for name in part) == names
    assert all(parts)
    whole = batch(logs, "--workers", 0, "--no-report", "--manifest", "m.csv", puppets=puppets[:1])
    assert (whole["made"], whole["unchanged"]) == (0, 6)
    assert sorted(row["output"] for row in rows()) == names


def test_a_part_has_the_same_results_whatever_else_there_is():
    names = [f"p/{index}" for index in range(1000)]
    parts = [[name for name in names if Shard(index, 7).has(name)] for index in range(1, 8)]
    assert sorted(name for part in parts for name in part) == sorted(names)
    assert max(map(len, parts)) < 1.3 * min(map(len, parts)) + 20
    # now and in every later version
    assert [name for name in names[:10] if Shard(1, 2).has(name)] == ["p/0", "p/3", "p/4", "p/8"]


@pytest.mark.parametrize(
    ("log", "chosen", "named"),
    [
        ("a.log", ["mine.toml", "bad.toml"], "bad.toml"),
        ("a.lgo", ["mine.toml"], "a.lgo"),
        ("a.log", ["mine.toml", "other/mine.toml"], "other/mine.toml"),
    ],
)
def test_a_mistake_ends_the_batch_before_the_work(mine, here, log, chosen, named):
    (mine / "bad.toml").write_text('[character]\nmesh = "gone.glb"\n')
    (mine / "other").mkdir()
    shutil.copy(mine / "mine.toml", mine / "other")
    assert named in here(log, puppets=chosen, code=1).partition(": found")[0]
    assert not (mine / "out").exists()


def test_the_text_has_a_table_of_reasons_the_most_frequent_first(mine, print_batch):
    for name, content in {"1": "1 2 3\n", "2": "1 2 3 4\n", "0": ""}.items():
        (mine / f"{name}.txt").write_text(content)
    done = print_batch("0.txt", "1.txt", "2.txt", "a.log", "--workers", 0, code=1)
    assert done.stderr == ""
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
    assert (page.count("<svg"), page.count('src="data:image/jpeg;base64,'), page.count("src=")) == (4, 1, 1)
    assert "http" not in page.replace("http://www.w3.org", "")


def test_performers_are_converted_without_characters(mine, here, rows):
    assert here("*.log", "--performer", "bvh", puppets=[])["made"] == 3
    assert [(row["output"], row["puppet"], row["form"]) for row in rows()] == [
        (f"{name}.bvh", "", "bvh") for name in "abc"
    ]
    convert("a.log", "-o", "a.bvh")
    assert (mine / "out/a.bvh").read_bytes() == (mine / "a.bvh").read_bytes()
    again = here("*.log", "--performer", "bvh", puppets=[])
    assert (again["made"], again["unchanged"]) == (0, 3)
    assert here("*.log", "--performer", "vrma", "--dry-run", puppets=[]) == {"waiting": ["a.vrma", "b.vrma", "c.vrma"]}
