"""Fixtures of the tests of commands, partly those of the service's tests."""

import os

import pytest

from ..service.conftest import free_port, kung_fu, listen, sender, serve, serve_module

__all__ = ["free_port", "kung_fu", "listen", "sender", "serve", "serve_module"]


@pytest.fixture
def run(tmp_path, commands):
    """Return a function that runs a command in an empty folder and checks its exit code."""

    def start(*arguments, code=0):
        result = commands.run(*arguments, cwd=tmp_path, env=os.environ | {"XDG_STATE_HOME": str(tmp_path / "state")})
        assert result.returncode == code, result.stderr
        return result

    return start
