"""Damaged character files are refused, or they are read and written as an animated .glb with the same character."""

import shutil

import numpy as np
import pytest

from engine_bridge.character.character import load_character
from solver.model.reduced_model import ModelParameters, build

from .conftest import read_and_write, try_damaged
from .corpus import CORPUS
from .damage import damage_of

REAL_FILES = (
    *("gltf/nested.glb", "gltf/cubevc.glb", "gltf/khronos_Fox.glb", "gltf/kenney/character.glb"),
    *("nasty/wallhole.obj", "nasty/negative_indices.obj", "nasty/not_convex.obj", "nasty/two_triangles.off"),
    *("nasty/busted.STL", "suzanne.obj", "fuze/fuze.obj"),
)
"""Small files from elsewhere."""


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name in CORPUS for kind in damage_of(name)])
def test_files_are_read_and_written_and_damaged_ones_are_read_or_refused(folder, name, kind):
    path = folder / name
    path.write_bytes(CORPUS[name])
    assert len(read_and_write(path).triangles) >= 48
    outcomes = try_damaged(path, kind, 100, enough=3)
    assert min(outcomes.values()) >= 3  # otherwise there is too little damage or too much


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", REAL_FILES)
def test_damaged_real_files_are_read_or_refused(real_data, tmp_path, name):
    original = real_data / "mesh" / name
    path = tmp_path / "own" / original.name
    if "/" in name:  # with its pictures
        shutil.copytree(original.parent, path.parent)
    else:
        path.parent.mkdir()
    whole = original.read_bytes()
    for kind in damage_of(name):
        path.write_bytes(whole)
        outcomes = try_damaged(path, kind, 10, enough=0)
        assert sum(outcomes.values()) >= 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["textured.glb", "skinned.glb", "packed.glb", "binary.stl"])
def test_damaged_characters_have_a_finite_model_or_are_refused(folder, name):
    def build_model(path):
        mesh = load_character(path).solver_mesh()
        model = build(mesh, ModelParameters(fields=4, isolines=5))
        assert model.weights.sum() == pytest.approx(1)
        assert model.isoline_coordinates.min() >= 0
        assert model.isoline_coordinates.max() <= model.isolines - 1
        for array in (model.A, model.B, model.gram, model.covariance, model.A_clusters, model.B_clusters):
            assert np.isfinite(array).all()

    (folder / name).write_bytes(CORPUS[name])
    outcomes = try_damaged(folder / name, "arrays" if name.endswith(".glb") else "bytes", 25, 2, build_model)
    assert min(outcomes.values()) >= 2
