"""A folder of short recordings, and two puppets of the small figure."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from engine_bridge.batch import conversion
from engine_bridge.batch.store import OWN_FOLDER
from engine_bridge.cli.main import main

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


def results(folder):
    """Bytes of all results in a folder by name, without incomplete ones, which a killed process may have left."""
    found = {path.relative_to(folder): path for path in sorted(folder.rglob("*.glb"))}
    return {name.as_posix(): path.read_bytes() for name, path in found.items() if name.parts[0] != OWN_FOLDER}
