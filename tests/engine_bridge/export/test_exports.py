"""Exported files of all variants of the figure and of real characters, in all forms."""

from hashlib import sha256

import igl
import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.character import load_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.export.animation import Keyframes, animate
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings

from ..character.conftest import CORNERS, SIDES
from .conftest import REAL, VARIANTS, Raw, solved

MIRRORED = {"node_transforms", "shared_mesh"}
"""Variants with a mirrored part on their second node; a rig must flip its triangles."""
IN_THE_WORLD = {"textured", "several_primitives"}
"""Variants whose vertices are in world coordinates already, where rigs have theirs."""


def test_three_plays_what_was_solved_within_the_error_that_is_printed_from_a_file_without_new_faults(
    export, play, validate
):
    def faults(path):
        return {(each["code"], each["severity"]) for each in validate(path)["messages"] if each["severity"] < 2}

    name, clip, error = export.variant.name, export.clip, export.summary.error
    assert name in REAL or not faults(export.variant.path)
    assert faults(export.path) <= faults(export.variant.path)
    frames = slice(None, None, 3 if name in REAL else 1)
    expected = solved(clip)[frames]
    played = {each.part: each for each in play(export.path, len(expected)).meshes}
    shown = [played.pop((part.node, part.primitive)) for part in clip.motion.prepared.character.parts]
    assert not played
    away = np.concatenate([each.positions for each in shown], axis=1) - expected[:, clip.motion.prepared.mesh.of_render]
    worst = np.linalg.norm(away, axis=-1).max() / clip.motion.prepared.mesh.diagonal
    assert worst <= error + 2e-6
    if export.form != "rig":
        assert error <= export.summary.tolerance
        assert name in REAL or worst == pytest.approx(error, abs=2e-6)


@pytest.mark.parametrize(
    ("name", "form", "degrees"),
    [("textured", "morph", 3), ("node_transforms", "morph", 3), ("textured", "frames", 0.1)],
)
def test_normals_are_those_of_the_moved_surface(exported, play, name, form, degrees):
    export = exported(name, form)
    seen = np.concatenate([part.normals for part in play(export.path, 20).meshes], axis=1)
    mesh = export.clip.motion.prepared.mesh
    true = [igl.per_vertex_normals(frame, mesh.faces)[mesh.of_render] for frame in solved(export.clip)[::3]]
    cosines = np.einsum("fvc,fvc->fv", seen, true)
    assert np.percentile(np.degrees(np.arccos(np.clip(cosines, -1, 1))), 99) < degrees


ARRAYS = {"indices", "inverseBindMatrices", "input", "output"}
"""Keys of accessors, beside the names of attributes, which are in capitals."""


def resolved(document, value, key=""):
    """Return a part of a description in which sums of arrays and pictures stand in place of their numbers."""
    if isinstance(value, dict):
        return {name: resolved(document, item, name) for name, item in value.items()}
    if isinstance(value, list):
        return [resolved(document, item, key) for item in value]
    if key == "bufferView":
        return sha256(document.view(value)).hexdigest()
    if not isinstance(value, int) or (key not in ARRAYS and key != key.upper()):
        return value
    accessor = document.gltf["accessors"][value]
    return accessor["componentType"], accessor["type"], sha256(document.array(value).tobytes()).hexdigest()


def test_content_that_does_not_move_is_kept_to_the_bit(export):
    name, is_rig, moved = export.variant.name, export.form == "rig", set()
    of_file, of_node, of_mesh = ("materials", "textures", "samplers", "images"), ("name", "extras"), ("name",)
    if is_rig:
        moved = {"JOINTS_0", "WEIGHTS_0"} | (set() if name in IN_THE_WORLD else {"POSITION", "NORMAL"})
        of_mesh += "extras", "weights"
    else:
        of_file += "cameras", "extensions", "extensionsRequired", "extras", "skins"
        of_node += "matrix", "rotation", "scale", "translation", "children", "skin"
    documents = map(load_document, (export.variant.path, export.path))
    before, after = (resolved(each, {**each.gltf, "accessors": [], "bufferViews": []}) for each in documents)

    def assert_same(one, other, keys):
        assert {key: other.get(key) for key in keys} == {key: one.get(key) for key in keys}

    names = [node["name"] for node in after["nodes"][len(before["nodes"]) :]]
    assert is_rig or names == ["puppetline_root"] * (export.form != "still")
    assert_same(before, after, of_file)
    assert is_rig or after["animations"][1:] == before["animations"]  # the first one is ours
    for number, (node, same) in enumerate(zip(before["nodes"], after["nodes"], strict=False)):
        assert_same(node, same, of_node)
        if "mesh" not in node:
            continue
        was, now = before["meshes"][node["mesh"]], after["meshes"][same["mesh"]]
        assert_same(was, now, of_mesh)
        is_flipped = is_rig and number == 1 and name in MIRRORED
        for old, new in zip(was["primitives"], now["primitives"], strict=True):
            assert_same(old, new, ("material",) if is_flipped else ("material", "mode", "indices"))
            assert_same(old["attributes"], new["attributes"], old["attributes"].keys() - moved)
            for there, here in zip(old.get("targets", []), new.get("targets", []), strict=False):
                assert_same(there, here, there.keys() - moved)


@pytest.mark.parametrize("name", [build.__name__ for build in VARIANTS])
def test_a_rig_at_rest_has_the_triangles_and_normals_of_its_character(exported, name):
    export = exported(name, "rig")
    made = {(part.node, part.primitive): part for part in load_character(export.path).parts}
    for own in export.clip.motion.prepared.character.parts:
        part = made[own.node, own.primitive]
        assert_array_equal(part.triangles, own.triangles)
        if own.normals is not None:
            assert_allclose(part.normals, own.normals, atol=0.02 if name == "own_targets" else 1e-4)


def test_targets_have_names_after_those_of_the_file_which_keep_their_weights(exported):
    export = exported("own_targets", "morph")
    made, count = Raw(export.path), export.summary.targets
    (mesh,) = made.file.meshes
    assert mesh.extras == {"author": "test", "targetNames": ["smile", "frown", *(f"motion_{i}" for i in range(count))]}
    assert mesh.weights == [0.25, 0, *[0] * count]
    assert_array_equal(made.weights(0)[:, :2], np.tile([0.25, 0], (58, 1)))
    assert [animation.name for animation in made.file.animations] == ["dance"]


@pytest.mark.parametrize("root", [True, False])
def test_a_performer_who_stands_still_gives_a_valid_file_without_targets(
    record, standing, variants, write_puppet, tmp_path, assert_valid_gltf, root
):
    log = record(tmp_path / "still.log", np.tile(standing, (5, 1, 1)))
    puppet = write_puppet(tmp_path / "still.toml", variants["own_targets"].path, root=root)
    _, summary = convert(log, puppet, tmp_path / "a.glb", Settings())
    assert summary.targets == 0
    assert_valid_gltf(tmp_path / "a.glb")
    file = Raw(tmp_path / "a.glb").file
    assert [channel.target.path for a in file.animations for channel in a.channels] == ["translation"] * root
    (mesh,) = file.meshes
    assert (mesh.weights, mesh.extras["targetNames"]) == ([0.25, 0], ["smile", "frown"])


STILL = Keyframes("still", np.float32([0, 1]), np.zeros((2, 1), np.float32), np.zeros((2, 3), np.float32))


def test_what_has_no_positions_and_what_its_node_scales_to_zero_is_not_moved(glb, tmp_path):
    """The character gets a target that moves it by 1 in each direction, with weight 0."""
    mesh = glb.mesh(glb.primitive(CORNERS, SIDES))
    glb.node(mesh)
    glb.node(mesh, scale=[1e-40] * 3)
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES), gltf.Primitive(attributes=gltf.Attributes())))
    before = load_character(glb.save(tmp_path / "a.glb"))
    moved = [(np.ones((1, *part.vertices.shape), np.float32), None) for part in before.parts]
    animate(before, STILL, moved.__getitem__).save(tmp_path / "a.glb")
    after = load_character(tmp_path / "a.glb")
    assert_array_equal(after.vertices, before.vertices)
    targets = [
        [after.document.array(target["POSITION"]).max() for target in each.get("targets", [])]
        for mesh in after.document.gltf["meshes"]
        for each in mesh["primitives"]
    ]
    assert sorted(targets) == [[], [0], [1], [1]]
