"""Fixtures for Godot with the addon: a project in which scripts run, and their output.

A test script `x.gd` lies beside the tests, extends teller.gd, gets its arguments from `arguments()`, prints a line
`RESULT {...}` for each thing that it has to say, and ends with `quit()`. The scripts of a worker's tests run one after
another in one process, except where a test needs a project of its own: it requests the fixture `project`.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from .resident import TIMEOUT_SECONDS, Godot, Resident

HERE = Path(__file__).parent
ADDON = HERE.parents[2] / "integrations" / "godot" / "addons" / "puppetline"
GPU_NUMBERS = 9
"""Numbers that gpu_reader.gd reads of each vertex: a position, a normal and a tangent."""

PROJECT = """config_version=5

[application]

config/name="Puppetline tests"
config/features=PackedStringArray("4.3")

[rendering]

renderer/rendering_method="gl_compatibility"
renderer/rendering_method.mobile="gl_compatibility"
"""


@pytest.fixture(scope="session")
def imported_project(godot, tmp_path_factory):
    """A project with the addon that Godot has looked through once, to be copied."""
    folder = tmp_path_factory.mktemp("godot") / "project"
    shutil.copytree(ADDON, folder / "addons" / "puppetline")
    (folder / "tests").mkdir()
    for script in HERE.glob("*.gd"):
        shutil.copy(script, folder / "tests")
    (folder / "project.godot").write_text(PROJECT)
    everything = [""]  # what is wrong with a part of the addon is for the tests of that part
    Godot(godot, "--headless", "--path", folder, "--import").finish(300, everything)
    return folder


@pytest.fixture(scope="session", autouse=True)
def user_folders(tmp_path_factory):
    """Give Godot a place for its users' files that goes with the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_DATA_HOME", str(tmp_path_factory.mktemp("users")))
        yield


@pytest.fixture
def project(imported_project, tmp_path):
    """A project of the test's own: the addon in `addons/puppetline`, the scripts beside the tests in `tests`."""
    return shutil.copytree(imported_project, tmp_path / "project")


@pytest.fixture(scope="session")
def residents(godot, imported_project):
    """Return a function that finds or starts a process of Godot which runs scripts in the imported project."""
    started = []

    def find(**shown):
        for resident, its in started:
            if resident.is_idle and its == shown:
                return resident
        started.append((Resident(godot, "--path", imported_project, **shown), shown))
        return started[-1][0]

    yield find
    for resident, _ in started:
        if resident.process.poll() is None:
            resident.close()


@pytest.fixture
def start_godot(request, godot):
    """Start a script in the project, or in a game that was exported from it, and talk to it while it runs, on a
    `screen` with OpenGL or another `renderer` if it is given one."""
    is_shared = "project" not in request.fixturenames
    own, started = [], []

    def find(game, **shown):
        if is_shared:
            return request.getfixturevalue("residents")(**shown)
        place = ("--path", request.getfixturevalue("project")) if game is None else ("--main-pack", game)
        own.append(Resident(godot, *place, **shown))
        return own[-1]

    def start(script, *arguments, game=None, clock=None, **shown):
        started.append(find(game, **shown).start(script, *arguments, clock=clock and clock.path))
        return started[-1]

    yield start
    for script in started:
        script.kill()
    for resident in own:
        if resident.process.poll() is None:
            resident.close()


class GivenClock:
    """A clock that stands still until a test turns it, in a file that Godot reads."""

    def __init__(self, path):
        self.path, self._seconds = path, 100.0
        self.turn(0)

    def turn(self, seconds):
        self._seconds += seconds
        new = self.path.with_suffix(".new")
        new.write_text(str(self._seconds))
        new.replace(self.path)


@pytest.fixture
def given_clock(tmp_path):
    return GivenClock(tmp_path / "clock")


@pytest.fixture
def run_godot(start_godot):
    """Run a script in the project to its end and return its results; `allow` are texts of errors that are meant."""

    def run(script, *arguments, timeout=TIMEOUT_SECONDS, allow=(), **shown):
        return start_godot(script, *arguments, **shown).finish(timeout, allow)

    return run


@pytest.fixture
def run_editor(godot, project):
    """Open the project in the editor with the plugin on, for some frames; return all that was printed."""

    def run(frames=60):
        plugin = '\n[editor_plugins]\n\nenabled=PackedStringArray("res://addons/puppetline/plugin.cfg")\n'
        (project / "project.godot").write_text(PROJECT + plugin)
        editor = Godot(godot, "--headless", "--editor", "--path", project, "--quit-after", frames)
        try:
            editor.finish(300)
        finally:
            editor.kill()
        return editor.lines

    return run


@pytest.fixture
def add_glb(godot, project):
    """Import a .glb into the project, as a user would, perhaps with settings; return what the project calls it."""

    def add(path, settings=None):
        shutil.copy(path, project / path.name)
        if settings:
            params = "".join(f"{name}={value}\n" for name, value in settings.items())
            told = f'[remap]\n\nimporter="scene"\n\n[params]\n\n{params}'
            (project / f"{path.name}.import").write_text(told)
        importer = Godot(godot, "--headless", "--path", project, "--import")
        importer.finish(300, ["UVs are required"])  # it says so of targets without them
        return f"res://{path.name}"

    return add


PRESET = """[preset.0]
name="Game"
platform="Linux"
export_filter="all_resources"
include_filter=""
exclude_filter=""
export_path=""
[preset.0.options]
binary_format/architecture="x86_64"
"""


@pytest.fixture
def exported_game(godot, project):
    """Export the project, as for players who have neither project nor editor."""
    (project / "export_presets.cfg").write_text(PRESET)
    game = project.parent / "game.pck"
    exporter = Godot(godot, "--headless", "--path", project, "--export-pack", "Game", game)
    exporter.finish(300, ["leaked at exit", "still in use at exit"])  # Godot's own
    return game


@pytest.fixture(scope="session")
def read_pixels():
    """Turn what gpu_reader.gd has written for a number of moments into positions, normals and tangents (3, n, 3)."""

    def read(file, moments, vertices, box):
        pictures = np.fromfile(file, "u1").reshape(moments, 1 + 2 * GPU_NUMBERS, -1, 3)[:, :, :vertices].astype(int)
        low, size = np.array(box)
        return [_directed(_decoded(each), low, size) for each in pictures]

    return read


def _decoded(pictures):
    """Return numbers from 0 to 1, (9, n), of a picture of a ramp of 16 steps and two of 12 bits for each number."""
    ramp = pictures[0, :16, 0]
    assert (np.diff(ramp) > 0).all()
    steps = np.abs(pictures[1:, ..., None] - ramp).argmin(axis=-1)
    twelve = steps @ [256, 16, 1]
    return (4096 * twelve[0::2] + twelve[1::2]) / (2**24 - 1)


def _directed(numbers, low, size):
    positions, normals, tangents = numbers.reshape(3, 3, -1).transpose(0, 2, 1)
    return np.stack([positions * size + low, (normals - 0.5) * 4, (tangents - 0.5) * 4])


@pytest.fixture
def drive_editor(godot, screen, project):
    """Open a scene in the editor on a screen, with the plugin and a script that operates it; return the script's
    results."""

    def run(script, scene, **environment):
        driver = project / "addons" / "driver"
        driver.mkdir()
        shutil.copy(project / "tests" / script, driver / "plugin.gd")
        about = 'name="Driver"\ndescription=""\nauthor=""\nversion="1"\nscript="plugin.gd"\n'
        (driver / "plugin.cfg").write_text("[plugin]\n" + about)
        (project / "world.tscn").write_text(scene)
        plugins = ", ".join(f'"res://addons/{name}/plugin.cfg"' for name in ("puppetline", "driver"))
        (project / "project.godot").write_text(
            PROJECT + f"\n[editor_plugins]\n\nenabled=PackedStringArray({plugins})\n"
        )
        editor = f"{godot} --editor --path {project} world.tscn --rendering-driver opengl3 --audio-driver Dummy"
        ran = subprocess.run(
            [*screen("1600x1000"), *editor.split(), "--resolution", "1600x1000"],
            env=os.environ | environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=300,
        )
        assert "SCRIPT ERROR" not in ran.stdout, ran.stdout[-4000:]
        lines = ran.stdout.splitlines()
        return [json.loads(line.removeprefix("RESULT ")) for line in lines if line.startswith("RESULT ")]

    return run
