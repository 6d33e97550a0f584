"""Fixtures of the tests of commands, partly those of the service's tests."""

import shutil

import pytest
from click.testing import CliRunner

from engine_bridge.cli.main import main
from engine_bridge.pictures import clip_sheet

from ..service.conftest import free_port, kung_fu, listen, play, sender, serve, serve_module

__all__ = ["free_port", "kung_fu", "listen", "play", "sender", "serve", "serve_module"]


@pytest.fixture
def own_state(tmp_path, monkeypatch):
    """Keep what commands remember in the test's folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def run(tmp_path, commands, own_state):
    """Return a function that runs a command as a process in an empty folder and checks its exit code."""

    def start(*arguments, code=0):
        result = commands.run(*arguments, cwd=tmp_path)
        assert result.returncode == code, result.stderr
        return result

    return start


@pytest.fixture
def invoke(tmp_path, monkeypatch, own_state):
    """Return a function that runs a command in an empty folder, in this process, and checks its exit code."""
    monkeypatch.chdir(tmp_path)

    def start(*arguments, code=0):
        result = CliRunner().invoke(main, [*map(str, arguments)], prog_name="puppetline")
        assert isinstance(result.exception, SystemExit | None)
        assert result.exit_code == code, result.output
        return result

    return start


@pytest.fixture
def quick_pictures(monkeypatch):
    """Draw one moment of a clip."""
    monkeypatch.setattr(clip_sheet, "TILE_COUNT", 1)


@pytest.fixture
def stage(tmp_path, take, blob_file, write_puppet):
    """Put a log, a mesh and a puppet file into the folder."""
    shutil.copy(take, tmp_path / "take.log")
    shutil.copy(blob_file, tmp_path / "blob.glb")
    return write_puppet(tmp_path / "blob.toml", "blob.glb")


def contents(folder):
    """Return the bytes of the files in a folder by their names; None for folders."""
    return {path.name: path.read_bytes() if path.is_file() else None for path in folder.iterdir()}


@pytest.fixture
def assert_refused(invoke, tmp_path):
    """Assert that a command prints one line with some parts, fails, and changes no file in the folder."""

    def check(*arguments, parts):
        before = contents(tmp_path)
        result = invoke(*arguments, code=1)
        assert result.stdout == ""
        *before_it, error = result.stderr.splitlines(keepends=True)
        assert [line for line in before_it if "compil" not in line] == []  # which happens once on a machine
        assert error[:12] == "puppetline: "
        assert error[-1] == "\n"
        assert "internal error" not in error
        assert [part for part in parts if part not in result.stderr] == []
        assert contents(tmp_path) == before

    return check
