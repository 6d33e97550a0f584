import subprocess
import sys

import pytest


def test_the_module_is_the_command():
    done = subprocess.run([sys.executable, "-m", "puppetline", "--help"], capture_output=True, text=True, check=True)
    assert "convert" in done.stdout


@pytest.mark.slow
def test_an_interrupt_while_it_is_being_loaded_ends_in_one_line():
    script = (
        "import os, signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a parent may have it ignored\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'engine_bridge.cli': os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "from puppetline.__main__ import run\n"
        "run()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "puppetline: stopped\n")
