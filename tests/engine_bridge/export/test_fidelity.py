"""Contents of real characters before and after a conversion, compared bit for bit."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from engine_bridge.character.character import load_character
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings
from solver.model.reduced_model import position_matrix

from .conftest import outermost_handles

CHARACTERS = [
    "gltf/cubevc.glb",
    "gltf/kaykit_Knight.glb",
    "gltf/kenney/character.glb",
    "gltf/khronos_Fox.glb",
    "gltf/nested.glb",
    "gltf/quaternius_Adventurer.glb",
    "gltf/quaternius_Frog.glb",
    "gltf/quaternius_George.glb",
    "gltf/quaternius_Husky.glb",
    "gltf/quaternius_Stegosaurus.glb",
    "gltf/quaternius_Trex.glb",
    "gltf/quaternius_Witch.glb",
]
SIZES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class File:
    """A .glb as JSON, with the bytes of each accessor and image."""

    def __init__(self, path):
        whole = path.read_bytes()
        size = int.from_bytes(whole[12:16], "little")
        self.json, self.binary, self.folder = json.loads(whole[20 : 20 + size]), whole[28 + size :], path.parent

    def list(self, name):
        return self.json.get(name, [])

    def accessor(self, index):
        """The properties of an accessor, and the bytes of its values."""
        accessor = dict(self.json["accessors"][index])
        view = self.json["bufferViews"][accessor.pop("bufferView")]
        start = view.get("byteOffset", 0) + accessor.pop("byteOffset", 0)
        row = SIZES[accessor["componentType"]] * WIDTHS[accessor["type"]]
        stride = view.get("byteStride", row)
        if stride == row:
            return accessor, self.binary[start : start + row * accessor["count"]]
        rows = [self.binary[start + i * stride :][:row] for i in range(accessor["count"])]
        return accessor, b"".join(rows)

    def picture(self, image):
        if "uri" in image:
            return (self.folder / image["uri"]).read_bytes()
        view = self.json["bufferViews"][image["bufferView"]]
        return self.binary[view.get("byteOffset", 0) :][: view["byteLength"]]


@dataclass(frozen=True)
class Converted:
    path: Path
    before: File
    after: File
    clip: object
    summary: object
    out: Path


@pytest.fixture(scope="module", params=CHARACTERS)
def converted(request, real_data, take, tmp_path_factory):
    """A real character moved by handles at its six outermost points."""
    path = real_data / "mesh" / request.param
    folder = tmp_path_factory.mktemp("fidelity")
    handles = outermost_handles(load_character(path).vertices)
    puppet, out = folder / "puppet.toml", folder / "out.glb"
    puppet.write_text(f'[character]\nmesh = "{path}"\n\n{handles}[root]\n\n[solver]\nfields = 5\nisolines = 6\n')
    clip, summary = convert(take, puppet, out, Settings())
    return Converted(path, File(path), File(out), clip, summary, out)


def test_materials_textures_skins_cameras_and_extras_are_the_same(converted):
    before, after = converted.before, converted.after
    for name in ("materials", "textures", "samplers", "cameras", "extensions", "extensionsRequired", "extras"):
        assert before.json.get(name) == after.json.get(name)
    for was, now in zip(before.list("skins"), after.list("skins"), strict=True):
        assert {**was, "inverseBindMatrices": 0} == {**now, "inverseBindMatrices": 0}
        assert before.accessor(was["inverseBindMatrices"]) == after.accessor(now["inverseBindMatrices"])


def test_pictures_are_the_same_to_the_byte(converted):
    before, after = converted.before, converted.after
    for was, now in zip(before.list("images"), after.list("images"), strict=True):
        assert before.picture(was) == after.picture(now)


def test_nodes_keep_their_places_names_and_extras(converted):
    was, now = converted.before.list("nodes"), converted.after.list("nodes")
    assert len(now) == len(was) + 1  # the root
    for old, new in zip(was, now[:-1], strict=True):
        assert {**old, "mesh": 0} == {**new, "mesh": 0}


def test_every_array_of_every_primitive_is_the_same_to_the_bit(converted):
    before, after = converted.before, converted.after
    for old, new in zip(before.list("nodes"), after.list("nodes")[:-1], strict=True):
        if "mesh" not in old:
            continue
        was, now = before.json["meshes"][old["mesh"]], after.json["meshes"][new["mesh"]]
        assert was.get("name") == now.get("name")
        for a, b in zip(was["primitives"], now["primitives"], strict=True):
            assert {**a, "targets": [], "attributes": 0, "indices": 0} == {
                **b,
                "targets": [],
                "attributes": 0,
                "indices": 0,
            }
            assert a["attributes"].keys() == b["attributes"].keys()
            assert ("indices" in a) == ("indices" in b)
            pairs = [(a["attributes"][name], b["attributes"][name]) for name in a["attributes"]]
            for left, right in [*pairs, *([(a["indices"], b["indices"])] if "indices" in a else [])]:
                assert before.accessor(left) == after.accessor(right)


def test_the_files_own_animations_come_after_ours_untouched(converted):
    before, after = converted.before, converted.after
    ours, *rest = after.list("animations")
    assert ours["name"] == "dance"
    for was, now in zip(before.list("animations"), rest, strict=True):
        assert was["channels"] == now["channels"]
        for a, b in zip(was["samplers"], now["samplers"], strict=True):
            assert a.get("interpolation") == b.get("interpolation")
            assert before.accessor(a["input"]) == after.accessor(b["input"])
            assert before.accessor(a["output"]) == after.accessor(b["output"])


def test_the_rest_pose_is_the_same(converted):
    before, after = (load_character(path) for path in (converted.path, converted.out))
    assert np.abs(before.vertices - after.vertices).max() <= 1e-6 * before.solver_mesh().diagonal
    np.testing.assert_array_equal(before.triangles, after.triangles)


def test_the_validator_finds_nothing_that_it_did_not_find_before(converted, node):
    reports = json.loads(node("validate.mjs", converted.path, converted.out))

    def faults(path):
        return {(m["code"], m["severity"]) for m in reports[str(path)]["messages"] if m["severity"] < 2}

    assert faults(converted.out) <= faults(converted.path)


def test_three_plays_what_was_solved(converted, play):
    clip = converted.clip
    model, mesh = clip.rig.model, clip.rig.mesh
    W = position_matrix(
        model.to_model(mesh.vertices), model.isoline_coordinates.astype(float), model.weights, model.isolines
    )
    solved = np.array([W @ R for R in clip.frames[::3].astype(float)]) * model.diagonal + model.center
    solved = (solved + clip.root[::3, None])[:, mesh.of_render]
    played = np.concatenate([part.positions for part in play(converted.out, 20).meshes], axis=1)
    # three multiplies float32 matrices along the skeleton
    allowed = (converted.summary.error + 2e-6) * mesh.diagonal
    assert np.abs(solved).max() > 0
    assert np.linalg.norm(played - solved, axis=2).max() <= allowed
