"""Exported files of all variants of the figure and of real characters, in all forms."""

import json

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.character import load_character
from engine_bridge.export.animation import Keyframes, animate
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings

from ..character.conftest import CORNERS, SIDES
from .conftest import REAL, Raw, assert_same_array, assert_same_primitive, normal_angles, solved

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
    shown = [played.pop((part.node, part.primitive)) for part in clip.rig.character.parts]
    assert not played
    away = np.concatenate([each.positions for each in shown], axis=1) - expected[:, clip.rig.mesh.of_render]
    worst = np.linalg.norm(away, axis=-1).max() / clip.rig.mesh.diagonal
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
    assert np.percentile(normal_angles(seen, solved(export.clip)[::3], export.clip.rig.mesh), 99) < degrees


def test_content_that_does_not_move_is_kept_to_the_bit(export):
    before, after, name = Raw(export.variant.path), Raw(export.path), export.variant.name
    of_rig = {"JOINTS_0", "WEIGHTS_0"} | (set() if name in IN_THE_WORLD else {"POSITION", "NORMAL"})
    moved, placed, kinds, of_mesh = of_rig, (), (), ("extras", "weights")
    if export.form != "rig":
        moved, placed, of_mesh = set(), ("matrix", "rotation", "scale", "translation", "children", "skin"), ()
        kinds = ("cameras", "extensions", "extensionsRequired", "extras")
        assert_same_skins_and_animations(before, after)
    parts = {(part.node, part.primitive): part for part in export.clip.rig.character.parts}
    for number, (node, same) in enumerate(zip(before.file.nodes, after.file.nodes, strict=False)):
        assert_same(node, same, "name", "extras", *placed)
        if node.mesh is None:
            continue
        was, now = before.file.meshes[node.mesh], after.file.meshes[same.mesh]
        assert_same(was, now, "name", *of_mesh)
        flipped = {"indices"} if (export.form, number) == ("rig", 1) and name in MIRRORED else set()
        for index, (old, new) in enumerate(zip(was.primitives, now.primitives, strict=True)):
            assert_same_primitive(before, old, after, new, moved | flipped)
            if flipped:
                assert_array_equal(after.array(new.indices).reshape(-1, 3), parts[number, index].triangles)
            if "NORMAL" in moved and new.attributes.NORMAL is not None:
                within = 0.02 if name == "own_targets" else 1e-4
                normals = after.array(new.attributes.NORMAL)
                assert_allclose(normals, parts[number, index].normals, atol=within)
    assert_same(before.file, after.file, "materials", "textures", "samplers", *kinds)
    for old, new in zip(before.file.images, after.file.images, strict=True):
        assert old.name == new.name
        assert old.mimeType in (None, new.mimeType)  # a file beside has none
        assert picture(before, old, export.variant.path) == picture(after, new, export.path)


def assert_same(one, other, *keys):
    for key in keys:
        assert getattr(one, key) == getattr(other, key), key


def assert_same_skins_and_animations(before, after):
    for old, new in zip(before.file.skins, after.file.skins, strict=True):
        assert_same(old, new, "joints", "skeleton", "name")
        assert_same_array(before, old.inverseBindMatrices, after, new.inverseBindMatrices)
    for old, new in zip(before.file.animations, after.file.animations[1:], strict=True):  # the first one is ours
        assert old.channels == new.channels
        for was, now in zip(old.samplers, new.samplers, strict=True):
            assert_same_array(before, was.input, after, now.input)
            assert_same_array(before, was.output, after, now.output)


def picture(made, image, path):
    return made.view(image.bufferView) if image.uri is None else (path.parent / image.uri).read_bytes()


def test_targets_have_names_after_those_of_the_file_which_keep_their_weights(exported):
    export = exported("own_targets", "morph")
    made, count = Raw(export.path), export.summary.targets
    (mesh,) = made.file.meshes
    assert mesh.extras == {"author": "test", "targetNames": ["smile", "frown", *(f"motion_{i}" for i in range(count))]}
    assert mesh.weights == [0.25, 0, *[0] * count]
    assert_array_equal(made.weights(0)[:, :2], np.tile([0.25, 0], (58, 1)))
    assert [animation.name for animation in made.file.animations] == ["dance"]


@pytest.mark.parametrize(("form", "added"), [("morph", ["puppetline_root"]), ("still", [])])
def test_the_root_is_one_more_node(exported, form, added):
    export = exported("bare_scene", form)
    before, after = (Raw(path).file.nodes for path in (export.variant.path, export.path))
    assert [node.name for node in after[len(before) :]] == added


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
    assert file.meshes[0].weights == [0.25, 0]
    assert json.loads(json.dumps(file.meshes[0].extras))["targetNames"] == ["smile", "frown"]


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
    primitives = [each for mesh in after.document.gltf["meshes"] for each in mesh["primitives"]]
    targets = [
        [after.document.array(target["POSITION"]).max() for target in each.get("targets", [])] for each in primitives
    ]
    assert sorted(targets) == [[], [0], [1], [1]]
