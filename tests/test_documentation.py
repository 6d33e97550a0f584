"""The documentation fits this version: its commands and options exist, and so does what its Python imports."""

import ast
import os
import re
import shlex
import textwrap

import click
import pytest

from engine_bridge.cli.main import main

from .conftest import ROOT

PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))


def blocks(page, language):
    """Yield the blocks of a page that are in a language."""
    for block in re.findall(
        rf"^ *```{language}\n(.*?)^ *```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    ):
        yield textwrap.dedent(block)


def commands(page):
    """Yield the arguments of each call of puppetline in the shell blocks of a page."""
    for block in blocks(page, "sh"):
        for line in block.replace("\\\n", " ").splitlines():
            if call := re.match(r" *(?:\.venv/bin/)?puppetline (.*?)(?: [&>]|$)", line):
                yield shlex.split(os.path.expandvars(call[1]), comments=True)


def name_of(page):
    return page.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_command_of_a_page_is_accepted(page, monkeypatch):
    monkeypatch.setenv("SLURM_ARRAY_TASK_ID", "1")
    monkeypatch.setenv("SLURM_ARRAY_TASK_COUNT", "2")
    for arguments in commands(page):
        parent = click.Context(main, info_name="puppetline")
        name, command, rest = main.resolve_command(parent, arguments)
        command.make_context(name, rest, parent)  # reads the arguments without running the command


@pytest.mark.parametrize("page", [page for page in PAGES if any(blocks(page, "python"))], ids=name_of)
def test_python_of_a_page_imports_what_there_is(page):
    for block in blocks(page, "python"):
        imports = [each for each in ast.parse(block).body if isinstance(each, ast.Import | ast.ImportFrom)]
        exec(compile(ast.Module(imports, []), name_of(page), "exec"), {})


def test_every_page_is_in_the_navigation():
    pages = {page.relative_to(ROOT / "docs").with_suffix("").as_posix() for page in PAGES[1:]} - {"index"}
    assert set((ROOT / "docs" / "index.md").read_text(encoding="utf-8").split()) >= pages
