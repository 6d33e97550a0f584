import subprocess
import sys
from unittest.mock import Mock

import numpy as np
import psutil
import pytest
from numpy.testing import assert_allclose

from capture import smoothing
from engine_bridge.cli import compile_ahead
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.pictures.drawing import cover, paint
from engine_bridge.pictures.mesh_picture import render
from engine_bridge.pictures.view import View
from puppetline import compiled
from puppetline.compiling import when_begun
from solver.model import batch, stretch
from solver.model.kernels import blend_positions
from solver.model.reduced_model import build
from solver.motion import arms, deformer, feet, limb_motion, retarget
from solver.skinning import weights
from solver.surface.dissection import nested_dissection

from ...commands import TIMEOUT_SECONDS


@pytest.fixture
def processes(monkeypatch):
    """What starts processes; none is started."""
    monkeypatch.setattr(subprocess, "Popen", Mock())
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    return subprocess.Popen


@pytest.mark.parametrize("already", [False, True], ids=["nothing compiled", "all compiled"])
def test_processes_start_with_the_first_function_that_must_be_compiled(processes, monkeypatch, already):
    monkeypatch.setattr("puppetline.compiled.is_compiled", lambda _: already)
    with compile_ahead.compiling_ahead():
        processes.assert_not_called()
        when_begun.pop()()
        assert processes.call_count == (0 if already else 2)


def test_processes_start_once_and_end_with_the_command(processes):
    before = list(when_begun)
    with compile_ahead.compiling_ahead(), compile_ahead.compiling_ahead(at_once=True):
        assert when_begun == []
        begin = [sys.executable, "-m", "engine_bridge.cli.compile_ahead"]
        assert [each.args[0] for each in processes.call_args_list] == [[*begin, name] for name in compile_ahead.WORK]
        processes.return_value.kill.assert_not_called()
    assert processes.return_value.kill.call_count == processes.return_value.wait.call_count == 2
    with compile_ahead.compiling_ahead():  # of a command that compiles nothing
        assert len(when_begun) == len(before) + 1
    assert when_begun == before


def test_processes_end_with_a_command_that_is_killed(tmp_path, monkeypatch):
    """Otherwise they may wait for minutes, for what another command compiles."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    program = "with compile_ahead.compiling_ahead(at_once=True): print(flush=True); input()"
    command = [sys.executable, "-c", f"from engine_bridge.cli import compile_ahead\n{program}"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        children = psutil.Process(process.pid).children()
        process.kill()
    assert len(children) == 2
    assert not psutil.wait_procs(children, TIMEOUT_SECONDS)[1]
    assert not [*tmp_path.rglob("arms._step*.nbi")]  # the last function that one of them compiles


def in_python_meanwhile():
    """Return the functions that Python runs until they are compiled."""
    modules = [
        module for name, module in sys.modules.items() if name.startswith(("capture.", "engine_bridge.", "solver."))
    ]
    return [
        each for module in modules for each in vars(module).values() if isinstance(each, compiled.InPythonMeanwhile)
    ]


def test_what_is_compiled_ahead_is_what_a_performance_needs(limbed_figure, standing, frames, dance):
    for name in compile_ahead.WORK:
        compile_ahead.compile_ahead(name)
    functions = (
        *(each.compiled for each in (limb_motion._step, feet._step, arms._step, smoothing._filter, retarget._ease)),
        *(nested_dissection, deformer._carry, deformer._turn, batch._blend, stretch._count),
        *(weights._fit, blend_positions, cover, paint),
    )
    ahead = [set(function.signatures) for function in functions]
    assert all(ahead)
    assert all(each.compiled.signatures for each in in_python_meanwhile())
    performance = CharacterMotion(limbed_figure, standing)
    for frame in frames(dance())[:2]:
        pose = performance.step(frame)
    build(limbed_figure.mesh, bones=limbed_figure.model.bones)
    weights.fit(limbed_figure.model, limbed_figure.mesh, pose.R[None], pose.bones[None])
    positions = batch.BatchBinding.of_solver_mesh(limbed_figure.model, limbed_figure.mesh).displacements(pose.R[None])
    stretch.EdgeStretch(limbed_figure.mesh).add(positions)
    vertices = limbed_figure.mesh.vertices
    render(vertices, limbed_figure.mesh.faces, View.around(vertices), (8, 8))
    assert [set(function.signatures) for function in functions] == ahead


def test_python_makes_the_same_motion_until_it_is_compiled(limbed_figure, standing, frames, dance, monkeypatch):
    def poses():
        performance = CharacterMotion(limbed_figure, standing)
        return [np.vstack([*pose.bones, pose.R, pose.root[None]]) for pose in map(performance.step, frames(dance()))]

    expected = poses()
    monkeypatch.setattr(compiled, "is_compiled", lambda _: False)
    monkeypatch.setattr("puppetline.compiling.others", [Mock(**{"poll.return_value": None})])
    assert limb_motion._step._in_python is None
    for function in in_python_meanwhile():
        monkeypatch.setattr(function, "_is_ready", False)
    assert_allclose(poses(), expected, rtol=0, atol=1e-12)
    assert limb_motion._step._in_python is not None
