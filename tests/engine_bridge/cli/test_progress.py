import io
import signal
import sys
from unittest.mock import MagicMock

import pytest
from numba.core import event

from engine_bridge.cli.main import main
from engine_bridge.cli.progress import progress

from .conftest import contents


class Terminal(io.StringIO):
    """A terminal at which somebody presses Ctrl-C as soon as some words are shown."""

    def __init__(self, awaited=None):
        super().__init__()
        self.awaited = awaited

    def isatty(self):
        return True

    def write(self, text):
        if self.awaited is not None and self.awaited in text:
            self.awaited = None
            signal.raise_signal(signal.SIGINT)
        return super().write(text)


@pytest.fixture
def terminal(monkeypatch):
    def open_terminal(awaited=None):
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.setattr(sys, "stderr", Terminal(awaited))
        return sys.stderr

    return open_terminal


def test_a_terminal_shows_steps_and_how_many_functions_were_compiled(terminal, capsys):
    shown, function = terminal(), {"dispatcher": MagicMock(), "args": ()}
    with progress() as report:
        report("Solving", 1.0)
        for _ in range(2):
            with event.trigger_event("numba:compile", function), event.trigger_event("numba:compile", function):
                pass
    text = shown.getvalue()
    assert "Solving" in text
    assert "100%" in text
    assert "Compiling, once: 2" in text
    assert "Compiling, once: 3" not in text
    assert capsys.readouterr().out == ""


@pytest.mark.usefixtures("quick_pictures")
@pytest.mark.parametrize("step", ["Preparing the character", "Performing", "Fitting morph targets", "Drawing"])
def test_an_interrupt_at_any_step_leaves_no_partial_file(terminal, stage, tmp_path, monkeypatch, capsys, step):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out.png").write_text("old")
    before, shown = contents(tmp_path), terminal(step)
    with pytest.raises(SystemExit) as end:
        main(["convert", "take.log", "--puppet", stage.name, "-o", "out.glb", "--preview", "out.png"])
    assert end.value.code == 1
    assert shown.getvalue().endswith("puppetline: stopped\n")
    assert capsys.readouterr().out == ""
    after = contents(tmp_path)
    assert (after.pop("out.glb", None) is not None) == (step == "Drawing")  # the preview of a whole result
    assert after == before
