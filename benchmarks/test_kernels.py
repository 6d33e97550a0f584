"""One hot function at a time: pytest benchmarks --benchmark-only."""

from itertools import count
from pathlib import Path

import numpy as np
import pytest
from puppetline.examples.characters import CHARACTERS
from puppetline.examples.performances import PERFORMANCES

from capture.smoothing import JointFilter, Smoothing
from engine_bridge.character.character import make_character
from engine_bridge.cli.benchmark import own_cache, prepare
from engine_bridge.cli.benchmark_process import CHARACTER, LOG, Playing
from engine_bridge.performance.rig import load_rig
from solver.model import lanes
from solver.model.polar import nearest_rotations
from solver.motion.deformer import to_file_units

FRAMES = 300


@pytest.fixture(scope="module")
def playing(tmp_path_factory: pytest.TempPathFactory) -> Playing:
    """A dinosaur of 14,000 vertices, some way into the performance."""
    folder: Path = tmp_path_factory.mktemp("bench")
    made = CHARACTERS["dinosaur"]()
    make_character("dinosaur", made.vertices, made.faces).document.save(folder / "dinosaur.glb")
    prepare(folder, folder / "dinosaur.glb", FRAMES)
    with own_cache(folder):
        played = Playing(load_rig(folder / CHARACTER), folder / LOG)
    for _ in range(FRAMES // 2):
        played.controls()
    return played


@pytest.fixture(scope="module")
def targets(playing: Playing) -> np.ndarray:
    deformer = playing.performance.deformer
    return deformer.handles + 0.05 * playing.rig.mesh.diagonal * np.sin(np.arange(len(deformer.handles)))[:, None]


def test_joint_filter(benchmark):
    frames = iter(PERFORMANCES["kung_fu"]().frames())
    first = next(frames)
    joints, ticks = JointFilter(Smoothing()), count()
    joints.step(next(ticks) / 30, first.positions, first.confidence)
    benchmark(lambda: joints.step(next(ticks) / 30, first.positions, first.confidence))


def test_input_and_retargeting(benchmark, playing, monkeypatch):
    still = playing.performance.step(playing.frame()).R
    monkeypatch.setattr(playing.performance.deformer, "solve", lambda *_: still)
    benchmark(lambda: playing.performance.step(playing.frame()))


def test_nearest_rotations(benchmark):
    S = np.eye(3) + 0.3 * np.random.default_rng(0).normal(size=(80, 3, 3))
    packed = lanes.pack(S.reshape(-1, 3), lanes.of_matrices(len(S)))
    benchmark(nearest_rotations, packed, np.empty_like(packed))


def test_solve(benchmark, playing, targets):
    benchmark(playing.performance.deformer.solve, targets)


def test_to_file_units(benchmark, playing, targets):
    R = playing.performance.deformer.solve(targets)
    benchmark(to_file_units, R, playing.rig.model)


def test_vertices(benchmark, playing):
    benchmark(playing.binding.vertices, playing.controls().copy())


def test_vertices_and_normals(benchmark, playing):
    benchmark(playing.vertices, playing.controls().copy())
