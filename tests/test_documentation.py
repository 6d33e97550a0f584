"""Commands in the documentation are commands of this version, with options that it has."""

import os
import re
import shlex

import click
import pytest

from engine_bridge.cli.main import main

from .conftest import ROOT

PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))


def commands(text):
    """Yield the arguments of each call of puppetline in the shell blocks of a page."""
    for block in re.findall(r"^ *```sh\n(.*?)^ *```", text, re.DOTALL | re.MULTILINE):
        for line in block.replace("\\\n", " ").splitlines():
            if call := re.match(r" *(?:\.venv/bin/)?puppetline (.*?)(?: [&>]|$)", line):
                yield shlex.split(os.path.expandvars(call[1]), comments=True)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_command_of_a_page_is_accepted(page, monkeypatch):
    monkeypatch.setenv("SLURM_ARRAY_TASK_ID", "1")
    monkeypatch.setenv("SLURM_ARRAY_TASK_COUNT", "2")
    for arguments in commands(page.read_text(encoding="utf-8")):
        parent = click.Context(main, info_name="puppetline")
        name, command, rest = main.resolve_command(parent, arguments)
        command.make_context(name, rest, parent)  # reads the arguments without running the command
