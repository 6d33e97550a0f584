"""Calls that Windows does not have or that behave differently there, and what the code uses instead.

`make lint` runs mypy for three platforms, which finds names that one of them does not have.
"""

import ast
from pathlib import PureWindowsPath

from capture.sources import registry

from .conftest import ROOT

POSIX_MODULES = {"fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"}


def faults(tree):
    """Yield what works on POSIX only, and what to use instead."""
    for node in tree.body:
        imported = {each.name for each in node.names} if isinstance(node, ast.Import) else {getattr(node, "module", "")}
        if imported & POSIX_MODULES:
            yield "an import of a module that Windows does not have; import it where it is used"
    for call in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        text, keywords = ast.unparse(call), {each.arg for each in call.keywords}
        if "start_new_session" in keywords:
            yield f"{text}; use **puppetline.interrupts.OWN_GROUP"
        match call.func:
            case ast.Attribute(attr="add_signal_handler"):
                yield f"{text}; use signal.signal and loop.call_soon_threadsafe"
            case ast.Attribute(attr="send_signal") if "SIGTERM" in text:
                yield f"{text}; use puppetline.interrupts.END"
            case ast.Attribute(ast.expr() as owner, "read_text" | "write_text") if "encoding" not in keywords:
                if ast.unparse(owner) != "toml_schema":
                    yield f'{text}; use encoding="utf-8"; the default of Windows is another'


def test_no_call_is_for_posix_only():
    sources = [
        path
        for folder in ("puppetline", "capture", "solver", "engine_bridge", "examples")
        for path in (ROOT / folder).rglob("*.py")
        if "node_modules" not in path.parts
    ]
    found = [f"{path}: {fault}" for path in sources for fault in faults(ast.parse(path.read_text(encoding="utf-8")))]
    assert found == []


def test_the_path_of_a_recording_may_have_a_drive_letter(monkeypatch):
    monkeypatch.setattr(registry.RecordingSource, "of_file", lambda *arguments: arguments)
    uri = r"replay:C:\takes\a.log?loop"
    opened = registry.open_source(uri, PureWindowsPath("D:/service"))
    assert opened == (uri, PureWindowsPath("C:/takes/a.log"), True)
