import ast
import gc
import math
import os
import runpy
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock, call

import numpy as np
import pytest
from numba.core.errors import TypingError

from puppetline.compiled import GARBAGE_THRESHOLD, compiled, is_compiled

ROOT = Path(__file__).parents[2]

MODULE = """
from puppetline.compiled import compiled

@compiled(inner=True)
def square(x):
    return x * x

@compiled
def sum_of_squares(x, y):
    return square(x) + square(y)

print(sum_of_squares(3.0, 4.0), sum_of_squares.stats.cache_hits.total(), sum_of_squares.stats.cache_misses.total())
"""


def test_a_second_process_loads_what_the_first_has_compiled_unless_a_function_in_it_has_changed(tmp_path):
    inner, outer = MODULE.split("@compiled\n")
    (tmp_path / "outer.py").write_text(f"from inner import compiled, square\n\n@compiled\n{outer}")
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment = {**os.environ, **cache, "PYTHONDONTWRITEBYTECODE": "1"}  # its .pyc files are one second too coarse
    command, outputs = [sys.executable, tmp_path / "outer.py"], []
    for result in ("x * x", "x * x", "x + x"):
        (tmp_path / "inner.py").write_text(inner.replace("x * x", result))
        outputs.append(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
    assert outputs == ["25.0 0 1\n", "25.0 1 0\n", "14.0 0 1\n"]


def test_files_that_a_power_cut_has_damaged_are_compiled_and_written_again(tmp_path, monkeypatch, capsys):
    (tmp_path / "module.py").write_text(MODULE)
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    for damaged, kept in (("no file", 0), ("*.nbi", 0), ("*.nbi", 20), ("*.nbc", 0), ("*.nbc", 20), ("no file", 0)):
        for path in tmp_path.glob(f"cache/**/{damaged}"):
            path.write_bytes(path.read_bytes()[:kept])
        runpy.run_path(str(tmp_path / "module.py"))
    assert capsys.readouterr().out == 5 * "25.0 0 1\n" + "25.0 1 0\n"


def test_of_processes_that_begin_together_one_compiles_and_the_others_wait(tmp_path):
    (tmp_path / "module.py").write_text(MODULE)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, tmp_path / "module.py"]
    processes = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    outputs = sorted(process.communicate()[0] for process in processes)
    assert outputs == ["25.0 0 1\n", "25.0 1 0\n", "25.0 1 0\n"]
    assert not list(tmp_path.glob("cache/**/*.lock"))


def test_a_lock_that_cannot_be_taken_does_not_prevent_compiling(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))

    @compiled
    def double(x):
        return 2 * x

    monkeypatch.setattr(Path, "open", Mock(side_effect=PermissionError))
    assert double(3.0) == 6.0
    assert is_compiled(double)


def test_a_function_that_cannot_be_compiled_leaves_no_lock(tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))

    @compiled
    def name_of(x):
        return x.name

    with pytest.raises(TypingError):
        name_of(3.0)
    assert not list(tmp_path.glob("**/*.lock"))


def test_garbage_is_searched_for_rarely_only_while_functions_are_compiled(tmp_path, monkeypatch):
    before, begun = gc.get_threshold(), Mock()
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("puppetline.compiling.when_begun", [begun])
    monkeypatch.setattr(gc, "set_threshold", Mock(wraps=gc.set_threshold))

    @compiled
    def double(x):
        return 2 * x

    for number in (3.0, 4.0):
        assert double(number) == 2 * number
    assert gc.set_threshold.call_args_list == [call(GARBAGE_THRESHOLD, *before[1:]), call(*before)]
    begun.assert_called_once_with()


def test_python_runs_a_function_with_all_that_it_calls_until_another_process_has_compiled_it(tmp_path, monkeypatch):
    begun, other = Mock(), Mock()
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr("puppetline.compiling.when_begun", [begun])
    monkeypatch.setattr("puppetline.compiling.others", [other])
    (tmp_path / "inner.py").write_text(MODULE.split("@compiled\n")[0])
    outer = "@compiled(waits=False, error_model='numpy')\ndef ratio(x, y):\n    return square(x) / inner.square(y)\n"
    (tmp_path / "outer.py").write_text(f"import inner\nfrom inner import compiled, square\n\n{outer}")
    monkeypatch.syspath_prepend(tmp_path)
    ratio = runpy.run_path(str(tmp_path / "outer.py"))["ratio"]
    for status, signatures in ((None, 0), (None, 0), (0, 1), (None, 1)):
        other.poll.return_value = status
        assert [ratio(np.float64(3), np.float64(y)) for y in (2, 0)] == [2.25, math.inf]
        assert len(ratio.compiled.signatures) == signatures
    begun.assert_called_once_with()
    again = runpy.run_path(str(tmp_path / "outer.py"))["ratio"]  # as in a process that finds it compiled
    assert again(3.0, 2.0) == 2.25
    assert again.compiled.stats.cache_hits.total() == 1


DECORATORS = "compiled", "intrinsic", "inner", "kernel", "shared"
"""Beginnings of the names of decorators that compile."""


def test_only_functions_that_are_compiled_have_no_type_hints():
    """mypy lets all functions of a module with compiled functions go without."""
    found = {
        f"{path.relative_to(ROOT)}: {node.name}"
        for room in ("puppetline", "capture", "solver", "engine_bridge", "examples")
        for path in (ROOT / room).rglob("*.py")
        if "node_modules" not in path.parts
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
        and node.returns is None
        and not any(
            ast.unparse(each).startswith(("compiled", "intrinsic", "inner", "kernel", "shared"))
            for each in node.decorator_list
        )
    }
    assert found == set()
