import csv

import pyarrow.parquet as pq
import pytest

from engine_bridge.batch import manifest
from engine_bridge.batch.identity import FileState
from engine_bridge.batch.row import Row
from engine_bridge.batch.store import Job, Record, Store
from puppetline.errors import OutputError

from ..refusals import refused

DONE = Row("done", "p/a.glb", "/a.log", "/p.toml", "own", 4, "morph", frames=9, seconds=0.3, notes=("One.", "Two."))
FAILED = Row("failed", "", "/b,\n.log", "/p.toml", None, None, "morph", reason="nothing", message='It said "no".')


def test_parquet_has_a_typed_column_per_field_so_that_parts_can_be_joined(tmp_path):
    path = tmp_path / "m.parquet"
    manifest.write_manifest(path, [DONE, FAILED])
    table = pq.read_table(path)
    assert table.column_names == list(manifest.COLUMNS)
    assert [Row(**row | {"notes": tuple(row["notes"])}) for row in table.to_pylist()] == [DONE, FAILED]
    types = [str(table.schema.field(name).type) for name in ("state", "user", "seconds", "error", "notes")]
    assert types[:4] == ["string", "int64", "double", "double"]
    assert types[4].startswith("list<")
    manifest.write_manifest(tmp_path / "1.parquet", [])
    manifest.write_manifest(tmp_path / "2.parquet", [FAILED])  # with columns that are empty
    assert pq.read_table(tmp_path).column("output").to_pylist() == ["", "p/a.glb", ""]


@pytest.mark.parametrize("name", ["m.xlsx", "m", "gone/m.csv"])
def test_a_manifest_that_cannot_be_written_is_refused_before_the_work(tmp_path, name):
    refused(OutputError, manifest.check_manifest, tmp_path / name)


def test_without_pyarrow_parquet_names_the_extra_and_csv_works(tmp_path, monkeypatch):
    monkeypatch.setattr("engine_bridge.batch.manifest.find_spec", lambda _: None)
    manifest.check_manifest(tmp_path / "m.csv")
    error = refused(OutputError, manifest.check_manifest, tmp_path / "m.parquet")
    assert "pip install 'puppetline[batch]'" in error.fix


def test_csv_has_notes_as_one_text_and_records_that_another_batch_writes_meanwhile(tmp_path, monkeypatch):
    store, write = Store(tmp_path, "run"), manifest.write_manifest

    def add(name):
        log = tmp_path / "log"
        log.touch()
        row = Row("done", f"{name}.glb", "", "", None, None, "morph", notes=("One.", "Two."))
        store.save(Job(name, log, log, ""), Record("", "run", FileState.of(log), (row,), {}))

    def write_slowly(path, rows):
        monkeypatch.setattr(manifest, "write_manifest", write)
        add("p/other")
        write(path, rows)

    with store.opened():
        add("p/first")
        monkeypatch.setattr(manifest, "write_manifest", write_slowly)
        rows = manifest.write_whole_manifest(tmp_path / "m.csv", store)
    with (tmp_path / "m.csv").open(newline="", encoding="utf-8") as file:
        written = [*csv.DictReader(file)]
    assert [each["output"] for each in written] == [row.output for row in rows] == ["p/first.glb", "p/other.glb"]
    assert [(each["user"], each["notes"]) for each in written] == 2 * [("", "One. Two.")]
