import os
import pty
import sys

import numba

from engine_bridge.cli.progress import progress


def test_a_terminal_is_told_how_many_functions_were_compiled(monkeypatch):
    numba.njit(lambda x: x)(1)  # which loads what would keep the stream of this test
    terminal, other = pty.openpty()
    monkeypatch.setenv("TERM", "xterm")
    with os.fdopen(other, "w") as stream, monkeypatch.context() as patch:
        patch.setattr(sys, "stderr", stream)
        with progress() as report:
            report("Solving", 0.5)
            numba.njit(lambda x: x)(1)
            numba.njit(lambda x: x)(1)
    shown = os.read(terminal, 65536).decode()
    os.close(terminal)
    assert "Solving" in shown
    assert "Compiling, once: 2" in shown
