"""Times of single functions: pytest benchmarks --benchmark-only. Each test also checks the result."""

from copy import deepcopy
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from puppetline.examples.characters import CHARACTERS
from puppetline.examples.performances import PERFORMANCES

from benchmarks.character_cost import prepare
from benchmarks.own_cache import own_cache
from capture.smoothing import JointFilter, Smoothing
from engine_bridge.character.character import make_character
from engine_bridge.character.materials import drawn_normals
from engine_bridge.inspection.benchmark import CHARACTER, LOG
from engine_bridge.inspection.character_cost import Playing
from engine_bridge.performance.prepared_character import load_prepared
from solver.model import matrix_blocks
from solver.model.polar import nearest_rotations
from solver.motion.deformer import to_file_units

FRAMES = 300


@pytest.fixture(scope="module")
def playing(tmp_path_factory: pytest.TempPathFactory) -> Playing:
    """Return a dinosaur with 14,000 vertices in the middle of its motion."""
    folder: Path = tmp_path_factory.mktemp("bench")
    made = CHARACTERS["dinosaur"]()
    make_character("dinosaur", made.vertices, made.faces).document.save(folder / "dinosaur.glb")
    prepare(folder, folder / "dinosaur.glb", FRAMES)
    with own_cache(folder):
        played = Playing(load_prepared(folder / CHARACTER), folder / LOG)
    for _ in range(FRAMES // 2):
        played.controls()
    return played


@pytest.fixture(scope="module")
def targets(playing: Playing) -> np.ndarray:
    deformer = playing.motion.deformer
    return deformer.handles + 0.05 * playing.prepared.mesh.diagonal * np.sin(np.arange(len(deformer.handles)))[:, None]


def test_joint_filter(benchmark):
    """A pose that does not change is the filter's output."""
    pose = next(iter(PERFORMANCES["kung_fu"]().frames()))
    joints, ticks = JointFilter(Smoothing()), count()
    smoothed = benchmark(lambda: joints.step(next(ticks) / 30, pose.positions, pose.confidence))
    np.testing.assert_allclose(smoothed, pose.positions, atol=1e-12)


def test_input_and_retargeting(benchmark, playing, monkeypatch):
    """The deformer receives what retargeting returns for the same frames."""
    deformer, frames, received = playing.motion.deformer, [], []
    retargeting = deepcopy(playing.motion.performer)
    monkeypatch.setattr(deformer, "solve", lambda targets, *_: received.append(targets.copy()))

    def step():
        frames.append(playing.frame())
        playing.motion.step(frames[-1])

    benchmark(step)
    np.testing.assert_array_equal(received, [retargeting.step(frame).targets for frame in frames])


def test_nearest_rotations(benchmark):
    """They are those of the singular value decomposition."""
    S = np.eye(3) + 0.3 * np.random.default_rng(0).normal(size=(80, 3, 3))
    places = matrix_blocks.matrix_row_places(len(S))
    packed = matrix_blocks.pack_rows(S.reshape(-1, 3), places)
    rotations = np.empty_like(packed)
    benchmark(nearest_rotations, packed, rotations)
    U, _, Vt = np.linalg.svd(S)
    U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]
    np.testing.assert_allclose(matrix_blocks.unpack_rows(rotations, places).reshape(-1, 3, 3), U @ Vt, atol=1e-9)


def test_solve(benchmark, playing, targets):
    """After many iterations, the handles are at their targets."""
    R = benchmark(playing.motion.deformer.solve, targets)
    model, handles = playing.prepared.model, playing.motion.deformer.handles
    reached = model.rows(playing.prepared.mesh, handles) @ R * model.diagonal + model.center
    np.testing.assert_allclose(reached, targets, atol=1e-3 * model.diagonal)


def test_to_file_units(benchmark, playing, targets):
    """A point that a transform of model units moves goes to the same place in the file's coordinates."""
    model = playing.prepared.model
    R = playing.motion.deformer.solve(targets)
    controls = benchmark(to_file_units, R, model)
    point = np.array([0.1, 0.2, 0.3])
    moved = (np.append(point, 1.0) @ R.reshape(-1, 4, 3)) * model.diagonal + model.center
    there = controls @ np.append(point * model.diagonal + model.center, 1.0)
    np.testing.assert_allclose(there, moved, atol=1e-5 * model.diagonal)


def test_vertices(benchmark, playing):
    """They are the same whether normals are computed or not."""
    controls = playing.controls().copy()
    vertices = benchmark(playing.binding.vertices, controls)
    np.testing.assert_allclose(vertices, playing.vertices(controls)[0], atol=1e-6 * playing.prepared.model.diagonal)


def test_vertices_and_normals(benchmark, playing):
    """At rest they are the file's."""
    model = playing.prepared.model
    vertices, normals = benchmark(playing.vertices, to_file_units(model.rest_controls, model))
    np.testing.assert_allclose(vertices, playing.prepared.character.vertices, atol=1e-5 * model.diagonal)
    np.testing.assert_allclose(normals, drawn_normals(playing.prepared.character), atol=1e-4)
