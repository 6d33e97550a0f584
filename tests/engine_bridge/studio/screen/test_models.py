"""Models that a process makes beside the page."""

import asyncio
import sys

import psutil
import pytest

from engine_bridge.studio.screen import models
from engine_bridge.studio.screen.models import Models


def children():
    return {each.pid for each in psutil.Process().children()}


def test_closing_ends_the_process_even_if_it_ignores_its_input(tmp_path, monkeypatch):
    program = tmp_path / "program"
    program.write_text(f"#!{sys.executable}\nimport threading\nthreading.Event().wait()\n")
    program.chmod(0o700)
    monkeypatch.setattr(models.sys, "executable", str(program))
    before = children()

    async def run():
        made = Models({"dog": tmp_path / "dog.toml"}, tmp_path)
        while not children() - before:
            await asyncio.sleep(0.01)
        await made.close()

    asyncio.run(run())
    assert children() <= before


@pytest.mark.parametrize("executable", ["/missing/program", sys.executable])
def test_characters_whose_model_cannot_be_made_are_logged(tmp_path, monkeypatch, caplog, executable):
    monkeypatch.setattr(models.sys, "executable", executable)

    async def run():
        made = Models({"dog": tmp_path / "dog.toml", "cat": tmp_path / "cat.toml"}, tmp_path)
        await made._maker
        assert made.made == {}

    asyncio.run(run())
    assert [record.args[0] for record in caplog.records] == ["dog", "cat"]
    assert all(record.args[1] for record in caplog.records)
