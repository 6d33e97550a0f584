"""Exported files in Blender, three.js, Babylon.js, Godot and assimp, compared with the solver."""

import io
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose
from PIL import Image
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import from_document, load_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.export.convert import Summary, convert, write
from engine_bridge.performance.clip import Clip
from engine_bridge.performance.frame_store import FrameStore
from engine_bridge.performance.settings import Settings

from .conftest import add_animation, add_texture, outermost_handles, posed

pytestmark = pytest.mark.slow

PROGRAMS = ["Blender", "three.js", "Babylon.js", "Godot", "assimp"]
CHARACTERS = {
    "textured": "rig",
    "several_primitives": "rig",
    "node_transforms": "frames",
    "shared_mesh": "morph",
    "own_targets": "morph",
    "skinned": "frames",
    "animated": "morph",
    "kaykit_Knight": None,
    "quaternius_Adventurer": "frames",
    "khronos_Fox": "morph",
}
"""Characters, and the form in which every program sees them; the last three are of others, and have no made rigs.

The knight takes minutes, and is seen in the full product only.
"""

REAL = list(CHARACTERS)[-3:]
CASES = [
    pytest.param(program, form, name, marks=[] if CHARACTERS[name] == form else pytest.mark.exhaustive)
    for program in PROGRAMS
    for form in ("morph", "frames", "rig")
    for name in CHARACTERS
    if form != "rig" or name not in REAL
]

FPS = 30
FRAMES = 31
"""Number of frames of one second."""
TIMES = 13
"""Number of times, two and a half frames apart: alternately at a keyframe and in the middle between two."""
ROUNDING = 2e-6
"""Maximum error of the programs, which use float32, as a fraction of the diagonal."""


@dataclass(frozen=True)
class File:
    """An exported file with its clip and summary."""

    raw: Callable
    clip: Clip
    summary: Summary

    @property
    def path(self):
        return Path(self.summary.output)

    @cached_property
    def reader(self):
        """The file as read by another library."""
        return self.raw(self.path)

    @property
    def gltf(self):
        return self.reader.file

    @property
    def diagonal(self):
        return self.clip.rig.mesh.diagonal


@pytest.fixture(scope="module")
def second(record, dance, tmp_path_factory):
    """A recording of one second."""
    return record(tmp_path_factory.mktemp("second") / "one_second.log", dance(FRAMES))


@pytest.fixture(scope="module")
def character(variants, blob, new_glb, request, tmp_path_factory):
    """Return the path of a character by its name; all objects in synthetic ones have different names."""
    folder = tmp_path_factory.mktemp("characters")

    def opened(path):
        made = new_glb()
        made.file = gltf.GLTF2().load(path)
        made.blob = made.file.binary_blob()
        return made

    def of(name):
        if name in REAL:
            return request.getfixturevalue("real_data") / "mesh" / "gltf" / f"{name}.glb"
        made = opened(variants["skinned" if name == "animated" else name].path)
        if name == "animated":
            for called, bone, angle in (("nod", 1, 40), ("sway", 0, -25)):
                turns = Rotation.from_euler("y", [[0], [angle], [0]], degrees=True).as_quat()
                add_animation(made, called, made.file.skins[0].joints[bone], "rotation", [0, 0.5, 1], turns)
            add_texture(made)
            primitive = made.file.meshes[0].primitives[0]
            primitive.material, primitive.attributes.TEXCOORD_0 = 0, made.add(blob.uv)
        if name == "several_primitives":
            for material, color in zip(made.file.materials, ([0.8, 0.2, 0.1, 1], [0.1, 0.3, 0.9, 1]), strict=True):
                material.pbrMetallicRoughness = gltf.PbrMetallicRoughness(baseColorFactor=color)
        for kind in ("node", "mesh", "material", "image"):
            for index, thing in enumerate(getattr(made.file, f"{kind}es" if kind == "mesh" else f"{kind}s")):
                thing.name = thing.name or f"{kind}_{index}"
        return made.save(folder / f"{name}.glb")

    return of


@pytest.fixture(scope="module")
def file(character, second, write_puppet, limb_tables, raw, tmp_path_factory):
    """Export a character, once for all tests; synthetic ones have a root, and limbs for a rig."""
    folder, exported = tmp_path_factory.mktemp("exported"), {}

    def make(name, form):
        path = character(name)
        puppet, output = folder / f"{name}_{form}.toml", folder / f"{name}_{form}.glb"
        if form == "rig":
            write_puppet(puppet, path, handles=limb_tables)
        elif name in REAL:
            vertices = load_character(path).vertices
            scale = np.linalg.norm(np.ptp(vertices, axis=0)) / 4
            more = f"[retarget]\nscale = {scale}\n\n[solver]\nfields = 5\nisolines = 6\n"
            write_puppet(puppet, path, handles=outermost_handles(vertices), more=more)
        else:
            write_puppet(puppet, path)
        return File(raw, *convert(second, puppet, output, Settings(form=form)))

    def once(name, form):
        if (name, form) not in exported:
            exported[name, form] = make(name, form)
        return exported[name, form]

    return once


def allowed(program, made, expected):
    """Maximum distance of a vertex from its position in the file, in the character's units."""
    rounding = ROUNDING * made.diagonal
    if program == "Godot" and made.gltf.skins:  # keeps each of at most four weights of a vertex in 16 bits
        rounding += 4 / 65535 * max(np.linalg.norm(positions, axis=2).max() for positions in expected.values())
    return rounding


PLAIN = str.maketrans(dict.fromkeys('.:@/"%', "_"))
"""Godot's replacements of characters that are not allowed in names of nodes."""


def targets(made, node):
    """The names of the morph targets of a node's mesh."""
    return (made.gltf.meshes[made.gltf.nodes[node].mesh].extras or {}).get("targetNames") or []


def looks(made, node, primitive):
    """Name, base colour, and the texture's name and size, or None, of a primitive's material."""
    file = made.gltf
    index = file.meshes[file.nodes[node].mesh].primitives[primitive].material
    if index is None:
        return None
    material = file.materials[index]
    surface = material.pbrMetallicRoughness
    if surface.baseColorTexture is None:
        return material.name, surface.baseColorFactor, None
    image = file.images[file.textures[surface.baseColorTexture.index].source]
    with Image.open(io.BytesIO(made.reader.view(image.bufferView))) as picture:
        return material.name, surface.baseColorFactor, (image.name, picture.size)


def assert_has_the_names_of_the_file(program, made, report):
    """Assert that animations, nodes and targets have the names that the file gives them."""
    own = made.gltf
    animations, nodes = [each.name for each in own.animations], {node.name for node in own.nodes}
    assert animations[0] == "one_second"
    seen = report["actions" if program == "Blender" else "animations"]
    assert sorted(seen) == sorted(animations)
    objects = {*report["objects"], *(bone for bones in report.get("bones", {}).values() for bone in bones)}
    if program == "Godot":
        nodes, objects = ({name.translate(PLAIN) for name in names} for names in (nodes, objects))
    assert nodes <= objects
    for mesh in report["meshes"]:
        shown = [key["name"] for key in mesh["shape_keys"]] if program == "Blender" else mesh["targets"]
        assert shown == targets(made, mesh["node"])


def assert_has_the_materials_of_the_file(program, made, report):
    """Assert that every part has its material."""
    own = made.gltf
    for mesh in report["meshes"]:
        if program == "Blender":  # one mesh for all primitives of a node, with the materials that they have
            count = len(own.meshes[own.nodes[mesh["node"]].mesh].primitives)
            expected = list({str(look): look for look in (looks(made, mesh["node"], i) for i in range(count))}.values())
        else:
            expected = [looks(made, mesh["node"], mesh["primitive"])]
        for (material, color, texture), seen in zip(filter(None, expected), mesh["materials"], strict=True):
            assert seen["name"] == material
            if texture is None:
                assert_allclose(seen["base_color"][:3], color[:3], atol=1e-6)
                assert seen["images"] == []
            else:
                (image,) = seen["images"]
                assert tuple(image.get("size", texture[1])) == texture[1]
                if texture[0] is not None and program not in ("Babylon.js", "assimp"):  # which name it after its use
                    assert image["name"] == texture[0]


def assert_plays_at_once(made, report, form):
    """Assert that Blender plays the recording without further ado, with one keyframe per frame."""
    assert report["fps"] == FPS
    assert report["actions"]["one_second"]["frames"] == [0, FRAMES - 1]
    active = [owner for owner in report["animated"] if owner["action"] is not None]
    assert {owner["action"] for owner in active} == {"one_second"}
    for owner in active:
        assert owner["slot"] == owner["object"]
        assert "one_second" in {track["name"] for track in owner["tracks"]}
    keyed = {owner["object"] for owner in active if owner["kind"] == "KEY"}
    for mesh in report["meshes"]:
        assert (mesh["name"] in keyed) == bool(form != "rig" or targets(made, mesh["node"]))
        for key in mesh["shape_keys"]:
            low, high = key["slider"]
            assert low <= key["asked"][0] <= key["asked"][1] <= high


@pytest.mark.parametrize(("program", "form", "name"), CASES)
def test_every_vertex_is_where_it_was_solved_to_be_with_its_names_and_materials(
    program, form, name, file, player, players
):
    run, made = player(program), file(name, form)
    shown = run(made.path, TIMES)
    assert_allclose(shown.times, np.arange(TIMES) * 2.5 / FPS, atol=1e-6)
    expected = players.solved(made.clip)(shown.times)
    rounding = allowed(program, made, expected)
    if form == "rig":  # between two keyframes bones turn, and do not go in straight lines
        document, between = load_document(made.path), np.arange(TIMES) % 2 == 1
        poses = [from_document(posed(document, time)).parts for time in shown.times]
        exact = {(p.node, p.primitive): np.array([each[k].vertices for each in poses]) for k, p in enumerate(poses[0])}
        assert players.farthest(shown.meshes, exact) <= rounding
        expected = {key: np.where(between[:, None, None], exact[key], expected[key]) for key in expected}
    assert players.farthest(shown.meshes, expected) <= made.summary.error * made.diagonal + rounding
    everything = np.concatenate(list(shown.meshes.values()), axis=1)
    moved = np.nanmax(np.linalg.norm(everything - everything[0], axis=2), axis=1)
    assert moved[1:].min() > 0.005 * made.diagonal
    if name in ("animated", "several_primitives", *REAL):
        assert_has_the_names_of_the_file(program, made, shown.report)
        assert_has_the_materials_of_the_file(program, made, shown.report)
    if program == "Blender":
        assert_plays_at_once(made, shown.report, form)


@pytest.mark.parametrize(
    "form", ["rig", *(pytest.param(form, marks=pytest.mark.exhaustive) for form in ("morph", "frames"))]
)
def test_blender_plays_in_seconds_whatever_the_frame_rate_of_the_scene(form, player, file, players):
    blender = player("Blender")
    made = file("textured", form)
    shown = blender(made.path, FRAMES, "24")
    assert shown.report["fps"] == 24
    assert_allclose(shown.times, np.arange(FRAMES) / FPS, atol=1e-6)
    off = players.farthest(shown.meshes, players.solved(made.clip)(shown.times))
    assert off <= (made.summary.error + ROUNDING) * made.diagonal


@pytest.mark.parametrize("form", ["morph", "rig"])
def test_godots_editor_imports_every_vertex_when_its_optimizer_is_off(form, player, file, players, tmp_path):
    player("Godot")
    made, project = file("animated", form), tmp_path / "project"
    shutil.copytree(players.PEERS / "godot", project, ignore=shutil.ignore_patterns(".godot"))
    shutil.copy(made.path, project / "figure.glb")
    (project / "figure.glb.import").write_text(
        '[remap]\n\nimporter="scene"\n\n[params]\n\n'
        '_subresources={"nodes": {"PATH:AnimationPlayer": {"optimizer/enabled": false}}}\n'
    )
    command = players.commands()["Godot"]
    command[command.index("--path") + 1] = project
    subprocess.run([*command[:4], "--import"], capture_output=True, check=True)
    shown = players.play(command, made.path, TIMES, tmp_path / "shown", "res://figure.glb")
    keys = slice(None, None, 2)
    expected = players.solved(made.clip)(shown.times[keys])
    for key, positions in expected.items():  # the editor puts vertices in another order: each is known by its path
        paths, seen = (np.concatenate(table, axis=1) for table in (positions, shown.meshes[key][keys]))
        far = made.summary.error * made.diagonal + allowed("Godot", made, expected)
        for one, other in ((paths, seen), (seen, paths)):
            _, nearest = cKDTree(one).query(other)
            moved = (one[nearest] - other).reshape(len(other), -1, 3)
            assert np.linalg.norm(moved, axis=2).max() <= far


@pytest.fixture(scope="module")
def hour(file, tmp_path_factory):
    """An hour at 30 frames per second, in which one second is played forwards and backwards in a loop."""
    made = file("textured", "morph")
    there_and_back = np.abs((np.arange(3600 * FPS + 1) + FRAMES - 1) % (2 * FRAMES - 2) - (FRAMES - 1))
    store, second = FrameStore(made.clip.frames[0].shape), made.clip.frames[:]
    for some in np.array_split(there_and_back, 100):
        store.append(second[some])
    timeline = replace(made.clip.timeline, positions=made.clip.timeline.positions[there_and_back])
    clip = replace(made.clip, frames=store, root=made.clip.root[there_and_back], timeline=timeline)
    output = tmp_path_factory.mktemp("hour") / "hour.glb"
    return File(made.raw, clip, write(clip, output, "hour", Settings(), lambda *_: None))


MERGED = 1e-5
"""Relative difference of times below which Godot merges keyframes."""


@pytest.mark.parametrize("program", PROGRAMS)
def test_an_hour_plays_to_its_end(program, player, request, players):
    run, hour = player(program), request.getfixturevalue("hour")
    shown = run(hour.path, 65)  # keyframes, and the middles between two, by turns
    assert shown.times[-1] == pytest.approx(3600, abs=1e-3)
    assert hour.summary.frames == 3600 * FPS + 1
    expected = players.solved(hour.clip)(shown.times)
    second = players.solved(hour.clip)(np.arange(FRAMES) / FPS)
    step = max(np.linalg.norm(np.diff(positions, axis=0), axis=2).max() for positions in second.values())
    late = np.spacing(np.float32(3600)) * FPS * step  # a file's clock is float32
    if program == "Godot":  # merges keyframes nearer than its tolerance, and those nearer than twice that to a time
        exact = shown.times < 0.5 / FPS / MERGED
        shown = replace(shown, meshes={key: positions[exact] for key, positions in shown.meshes.items()})
        expected = {key: positions[exact] for key, positions in expected.items()}
    assert players.farthest(shown.meshes, expected) <= (hour.summary.error + ROUNDING) * hour.diagonal + late
