"""Calls that Windows does not have or that behave differently there, and what the code uses instead."""

import ast
import subprocess
import sys
from pathlib import PureWindowsPath

import pytest

from capture.sources import registry

from .conftest import ROOT

ALTERNATIVES = {
    "add_signal_handler": "signal.signal and loop.call_soon_threadsafe",
    "rename": "Path.replace, which replaces files on Windows too",
    "fork": "subprocess",
    "start_new_session": "**puppetline.interrupts.OWN_GROUP",
    "send_signal(signal.SIGTERM)": "puppetline.interrupts.END",
    "text without encoding": 'encoding="utf-8"; the default of Windows is another',
}
"""What POSIX has, and what to use instead; `make lint` runs mypy for three platforms, which finds other names."""

POSIX_MODULES = ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty")

SIMULATION = f"""
import signal, socket, sys
from importlib import import_module
names = sys.argv[1:]
for name in names: import_module(name)
for name in list(sys.modules):
    if name.partition(".")[0] in ("puppetline", "capture", "solver", "engine_bridge"): del sys.modules[name]
for name in {POSIX_MODULES}: sys.modules[name] = None
for name in ("SIGHUP", "SIGKILL", "SIGUSR1"): delattr(signal, name)
del socket.AF_UNIX
signal.CTRL_BREAK_EVENT = 1
import subprocess
subprocess.CREATE_NEW_PROCESS_GROUP = 0x200
sys.platform = "win32"
for name in names: import_module(name)
"""


def sources():
    return [
        path
        for folder in ("puppetline", "capture", "solver", "engine_bridge", "examples")
        for path in (ROOT / folder).rglob("*.py")
        if "node_modules" not in path.parts
    ]


def posix_calls(tree):
    """Yield the calls that `ALTERNATIVES` lists."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        keywords = {each.arg for each in node.keywords}
        if "start_new_session" in keywords:
            yield "start_new_session"
        if not isinstance(node.func, ast.Attribute):
            continue
        name, owner = node.func.attr, ast.unparse(node.func.value)
        if name == "add_signal_handler" or (name, owner) in (("rename", "os"), ("fork", "os")):
            yield name
        if name == "send_signal" and "SIGTERM" in ast.unparse(node):
            yield "send_signal(signal.SIGTERM)"
        if name in ("read_text", "write_text") and owner != "toml_schema" and "encoding" not in keywords:
            yield "text without encoding"


def test_no_call_is_for_posix_only():
    found = {
        f"{path.relative_to(ROOT)}: {call}; use {ALTERNATIVES[call]}"
        for path in sources()
        for call in posix_calls(ast.parse(path.read_text(encoding="utf-8")))
    }
    assert found == set()


def test_the_path_of_a_recording_may_have_a_drive_letter(monkeypatch):
    monkeypatch.setattr(registry.RecordingSource, "of_file", lambda *arguments: arguments)
    uri = r"replay:C:\takes\a.log?loop"
    opened = registry.open_source(uri, PureWindowsPath("D:/service"))
    assert opened == (uri, PureWindowsPath("C:/takes/a.log"), True)


@pytest.mark.slow
def test_every_module_is_imported_where_the_system_is_windows():
    names = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in sources()
        if path.relative_to(ROOT).parts[0] != "examples"
    }
    command = [sys.executable, "-c", SIMULATION, *sorted(names - {"puppetline.__main__"})]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
