import os
import shutil
import subprocess
import sys
from functools import partial
from importlib.metadata import version

import pytest

import puppetline
from engine_bridge.cli.main import COMMANDS

from ..conftest import ROOT

run = partial(subprocess.run, capture_output=True, text=True)
MODULE, SCRIPT = [sys.executable, "-m", "puppetline"], [sys.executable, "-c"]


@pytest.mark.slow
def test_an_interrupt_while_it_is_being_loaded_ends_in_one_line():
    script = (
        "import os, signal, sys\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # a parent may have it ignored\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'engine_bridge.cli.main': os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "from puppetline.__main__ import run\n"
        "run()\n"
    )
    done = run([*SCRIPT, script], check=False)
    assert (done.returncode, done.stderr) == (1, "puppetline: stopped\n")


def test_an_interrupt_in_what_a_module_executes_ends_in_the_same_way(tmp_path):
    (tmp_path / "click.py").write_text("exec('raise KeyboardInterrupt')")
    done = run(MODULE, env=os.environ | {"PYTHONPATH": str(tmp_path)}, check=False)
    assert (done.returncode, done.stderr) == (1, "puppetline: stopped\n")


HEAVY = {"numpy", "scipy", "igl", "numba", "pydantic", "PIL", "rich", "importlib.metadata"}


@pytest.mark.parametrize(
    "command", [[], *([name] for name in COMMANDS)], ids=lambda command: " ".join(command) or "all"
)
def test_help_is_there_before_anything_heavy_or_another_command_is_imported(command):
    other = set() if command in ([], ["demo"]) else {"engine_bridge.cli.demo"}
    script = (
        "import sys\n"
        "from puppetline.__main__ import run\n"
        f"sys.argv = {['puppetline', *command, '--help']}\n"
        "try: run()\n"
        "except SystemExit: pass\n"
        f"print('imported:', *sorted({HEAVY | other} & set(sys.modules)))\n"
    )
    shown = run([*SCRIPT, script], check=True).stdout
    assert shown.startswith(f"Usage: {' '.join(['puppetline', *command])} ")
    assert shown.splitlines()[-1] == "imported:"


def test_the_version_is_that_of_the_installed_package_and_a_checkout_adds_its_commit():
    done = run([*MODULE, "--version"], check=True)
    shown, _, commit = done.stdout.strip().partition(" (commit ")
    assert shown == f"python -m puppetline, version {version('puppetline')}"
    if (ROOT / ".git").exists() and shutil.which("git"):
        head = run(["git", "-C", str(ROOT), "rev-parse", "HEAD"], check=True).stdout
        assert head.startswith(commit.rstrip(")").removesuffix(", changed"))
        assert len(commit) >= 7
    assert puppetline.__version__ == version("puppetline")
    with pytest.raises(AttributeError):
        _ = puppetline.__versoin__


@pytest.mark.parametrize(("given", "threads"), [(None, "1"), ("2", "2")])
def test_matrix_products_take_one_thread_unless_the_user_sets_another_number(monkeypatch, given, threads):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if given is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", given)
    script = (
        "import os, sys\n"
        "from puppetline.__main__ import run\n"
        "sys.argv = ['puppetline', '--version']\n"
        "try: run()\n"
        "except SystemExit: print(os.environ['OPENBLAS_NUM_THREADS'])\n"
    )
    assert run([*SCRIPT, script], check=True).stdout.split()[-1] == threads
