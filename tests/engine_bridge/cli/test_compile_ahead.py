import subprocess
import sys
from unittest.mock import Mock

import pytest

from capture import smoothing
from engine_bridge.cli import compile_ahead
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.pictures import renderer
from engine_bridge.pictures.rasteriser import rasterise
from puppetline.compiling import when_begun
from solver.model import stretch
from solver.model.batch import BatchBinding
from solver.model.kernels import blend_positions
from solver.model.polar import nearest_rotations
from solver.motion import arms, feet, limb_motion, retarget


@pytest.fixture
def processes(monkeypatch):
    """What starts processes; none is started."""
    monkeypatch.setattr(subprocess, "Popen", Mock())
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    return subprocess.Popen


@pytest.mark.parametrize("already", [False, True], ids=["nothing compiled", "all compiled"])
def test_a_second_process_starts_with_the_first_function_that_must_be_compiled(processes, monkeypatch, already):
    monkeypatch.setattr("puppetline.compiled.is_compiled", lambda _: already)
    with compile_ahead.second_process():
        processes.assert_not_called()
        when_begun.pop()()
        assert processes.call_count == (0 if already else 1)


def test_a_second_process_is_the_only_one_and_ends_with_the_command(processes):
    before = list(when_begun)
    with compile_ahead.second_process(), compile_ahead.second_process(at_once=True):
        assert when_begun == []
        assert processes.call_args.args[0] == [sys.executable, "-m", "engine_bridge.cli.compile_ahead"]
        processes.return_value.kill.assert_not_called()
    processes.return_value.kill.assert_called_once_with()
    processes.return_value.wait.assert_called_once_with()
    with compile_ahead.second_process():  # of a command that compiles nothing
        assert len(when_begun) == len(before) + 1
    assert when_begun == before


def test_what_is_compiled_ahead_is_what_a_performance_needs(limbed_rig, standing, frames, dance):
    compile_ahead.compile_ahead()
    functions = (
        *(limb_motion._step, feet._step, arms._step, smoothing._filter, retarget._ease, nearest_rotations),
        *(stretch._count, blend_positions, rasterise),
    )
    ahead = [set(function.signatures) for function in functions]
    assert all(ahead)
    performance = CharacterMotion(limbed_rig, standing)
    for frame in frames(dance())[:2]:
        pose = performance.step(frame)
    positions = BatchBinding.of_solver_mesh(limbed_rig.model, limbed_rig.mesh).vertices(pose.R[None])
    stretch.EdgeStretch(limbed_rig.mesh).add(positions)
    vertices = limbed_rig.mesh.vertices
    renderer.render(vertices, limbed_rig.mesh.faces, renderer.View.around(vertices), (8, 8))
    assert [set(function.signatures) for function in functions] == ahead
