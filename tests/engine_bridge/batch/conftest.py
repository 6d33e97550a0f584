"""A folder of short recordings, and two puppets of the small figure."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from engine_bridge.batch import conversion
from engine_bridge.batch.store import OWN_FOLDER, PARTIAL_FOLDER
from engine_bridge.cli.main import main
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings

pytest.importorskip("pyarrow")


@pytest.fixture(scope="session")
def logs(record, dance, tmp_path_factory):
    """A folder with six recordings of half a second to a second, two of them in folders, and a file that is none."""
    folder = tmp_path_factory.mktemp("logs")
    for index, name in enumerate(["a", "b", "c", "d", "day 1/a", "day 1/é"]):
        path = folder / f"{name}.log"
        path.parent.mkdir(exist_ok=True)
        record(path, dance(15 + 3 * index) * (1 if index % 2 else np.array([1.02, 1, 1])))
    (folder / "notes.txt").write_text("Dear diary\n")
    return folder


NAMES = ["a", "b", "c", "d", "day 1/a", "day 1/é"]
"""Names of these recordings."""


@pytest.fixture(scope="session")
def puppets(blob_file, write_puppet, tmp_path_factory):
    """Two puppet files of the figure, with a root and without."""
    folder = tmp_path_factory.mktemp("puppets")
    return [
        write_puppet(folder / "walks.toml", blob_file, root=True),
        write_puppet(folder / "stands.toml", blob_file, root=False),
    ]


@pytest.fixture(scope="session")
def converted(logs, puppets, tmp_path_factory):
    """What `convert` writes for each recording with each puppet, by name."""
    folder = tmp_path_factory.mktemp("converted")
    for puppet in puppets:
        for name in NAMES:
            output = folder / puppet.stem / f"{name}.glb"
            output.parent.mkdir(parents=True, exist_ok=True)
            convert(logs / f"{name}.log", puppet, output, Settings())
    return results(folder)


@pytest.fixture(scope="session")
def walks(converted):
    """The same with the first puppet."""
    return {name: content for name, content in converted.items() if name.startswith("walks/")}


@pytest.fixture
def in_workers(tmp_path, monkeypatch):
    """Run lines at the start of each worker process."""

    def begin(lines):
        (tmp_path / "sitecustomize.py").write_text(f"import os, sys\nif '--multiprocessing-fork' in sys.argv:\n{lines}")
        monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    return begin


@pytest.fixture
def print_batch(tmp_path, monkeypatch):
    """Run `puppetline batch` into the folder "out"; return what it prints."""
    monkeypatch.chdir(tmp_path)

    def start(*arguments, puppets=("mine.toml",), code=0):
        conversion._loaded.cache_clear()  # a new process would have none of these
        chosen = [each for puppet in puppets for each in ("--puppet", puppet)]
        done = CliRunner().invoke(main, ["batch", *map(str, [*arguments, *chosen, "-o", "out"])])
        assert done.exit_code == code, done.output
        return done

    return start


@pytest.fixture
def batch(print_batch):
    """The same, with results as values; an error is text."""

    def start(*arguments, **more):
        done = print_batch(*arguments, "--json", **more)
        return json.loads(done.stdout) if done.stdout else done.stderr

    return start


def partial(folder):
    """Files of a batch that are not complete."""
    return list((folder / OWN_FOLDER / PARTIAL_FOLDER).iterdir())


def results(folder):
    """Bytes of all results in a folder by name, without incomplete ones, which a killed process may have left."""
    found = {path.relative_to(folder): path for path in sorted(folder.rglob("*.glb"))}
    return {name.as_posix(): path.read_bytes() for name, path in found.items() if name.parts[0] != OWN_FOLDER}
