"""Exported files in other programs: what Blender, three.js, Babylon.js, Godot and assimp show is what was solved."""

import io
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pygltflib as gltf
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation, Slerp

from engine_bridge.clip import Clip
from engine_bridge.convert import Summary, convert
from engine_bridge.gltf.character import load_character
from engine_bridge.settings import Settings

PROGRAMS = ["Blender", "three.js", "Babylon.js", "Godot", "assimp"]
FORMS = ["morph", "skin", "frames"]
MADE = ["textured", "several_primitives", "node_transforms", "shared_mesh", "own_targets", "skinned", "animated"]
REAL = ["kaykit_Knight", "quaternius_Adventurer", "khronos_Fox"]

FPS = 30
FRAMES = 31
"""One second."""
TIMES = 13
"""Every two and a half frames: keyframes, and the middles between two, by turns."""
ROUNDING = 2e-6
"""Of the diagonal: what is left to the programs, which calculate in float32."""


@dataclass(frozen=True)
class File:
    """An exported file, and what it was made of."""

    form: str
    clip: Clip
    summary: Summary

    @property
    def path(self):
        return Path(self.summary.output)

    @property
    def gltf(self):
        return gltf.GLTF2().load(self.path)

    @property
    def diagonal(self):
        return self.clip.rig.mesh.diagonal


@pytest.fixture(scope="module")
def second(record, dance, tmp_path_factory):
    """A recording of one second."""
    return record(tmp_path_factory.mktemp("second") / "one_second.log", dance(FRAMES))


@pytest.fixture(scope="module")
def character(variants, blob, new_glb, request, tmp_path_factory):
    """Return the path of a character by its name; everything in those that are made here has a name of its own."""
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
            add_animations(made)
            add_texture(made, blob.uv)
        for kind in ("node", "mesh", "material", "image"):
            for index, thing in enumerate(getattr(made.file, f"{kind}es" if kind == "mesh" else f"{kind}s")):
                thing.name = thing.name or f"{kind}_{index}"
        return made.save(folder / f"{name}.glb")

    return of


def add_animations(glb):
    """Two animations that turn the upper of the two bones."""
    hip, chest = glb.file.skins[0].joints
    clock = glb.add(np.float32([0, 0.5, 1]), None)
    for name, bone, angle in (("nod", chest, 40), ("sway", hip, -25)):
        turns = Rotation.from_euler("y", [[0], [angle], [0]], degrees=True).as_quat().astype(np.float32)
        sampler = gltf.AnimationSampler(input=clock, output=glb.add(turns, None), interpolation="LINEAR")
        channel = gltf.AnimationChannel(sampler=0, target=gltf.AnimationChannelTarget(node=bone, path="rotation"))
        glb.file.animations.append(gltf.Animation(name=name, channels=[channel], samplers=[sampler]))


def add_texture(glb, uv):
    png = io.BytesIO()
    Image.fromarray((np.indices((8, 8)).sum(0) % 2 * 255).astype(np.uint8)).save(png, "PNG")
    glb.file.images = [gltf.Image(bufferView=glb.view(png.getvalue()), mimeType="image/png", name="squares")]
    glb.file.textures = [gltf.Texture(source=0)]
    surface = gltf.PbrMetallicRoughness(baseColorTexture=gltf.TextureInfo(index=0), metallicFactor=0)
    glb.file.materials = [gltf.Material(name="paint", pbrMetallicRoughness=surface)]
    primitive = glb.file.meshes[0].primitives[0]
    primitive.material, primitive.attributes.TEXCOORD_0 = 0, glb.add(uv)


@pytest.fixture(scope="module")
def file(character, second, write_puppet, tmp_path_factory):
    """Export a character, once for all tests; the made ones are moved by a root as well."""
    folder, exported = tmp_path_factory.mktemp("exported"), {}

    def make(name, form):
        path = character(name)
        puppet, output = folder / f"{name}.toml", folder / f"{name}_{form}.glb"
        if name in REAL:
            write_puppet(puppet, path, handles=tips(load_character(path).vertices))
        else:
            write_puppet(puppet, path)
        return File(form, *convert(second, puppet, output, Settings(form=form, bones=8 if form == "skin" else None)))

    def once(name, form):
        if form == "skin":
            pytest.importorskip("py_dem_bones")
        if (name, form) not in exported:
            exported[name, form] = make(name, form)
        return exported[name, form]

    return once


def tips(vertices):
    """Handles at the outermost points of a character."""
    picks = dict.fromkeys(int(pick) for axis in vertices.T for pick in (axis.argmin(), axis.argmax()))
    joints = ["hand_left", "hand_right", "head", "foot_left", "foot_right", "spine"]
    return "".join(
        f'[[handle]]\nname = "{joint}"\nposition = {vertices[pick].tolist()}\njoint = "{joint}"\n\n'
        for pick, joint in zip(picks, joints, strict=False)
    )


class Skinned:
    """A skinned file as the specification plays it, in float64: bones turn along the shortest arc."""

    def __init__(self, made):
        self.made, self.nodes = made, made.file.nodes
        self.parent = {child: index for index, node in enumerate(self.nodes) for child in node.children or []}
        animation = made.file.animations[0]
        self.tracks = {
            (channel.target.node, channel.target.path): animation.samplers[channel.sampler]
            for channel in animation.channels
        }

    def local(self, node, time):
        own, matrix = self.nodes[node], np.eye(4)
        matrix[:3, 3] = self.value(node, "translation", time, own.translation or [0, 0, 0])
        turn = Rotation.from_quat(self.value(node, "rotation", time, own.rotation or [0, 0, 0, 1]))
        matrix[:3, :3] = turn.as_matrix() * (own.scale or [1, 1, 1])
        return matrix if own.matrix is None else np.array(own.matrix).reshape(4, 4).T

    def value(self, node, path, time, rest):
        if (node, path) not in self.tracks:
            return rest
        sampler = self.tracks[node, path]
        times, values = (self.made.array(index).astype(np.float64) for index in (sampler.input, sampler.output))
        time = np.clip(time, times[0, 0], times[-1, 0])
        if path == "rotation":
            return Slerp(times[:, 0], Rotation.from_quat(values))(time).as_quat()
        return [np.interp(time, times[:, 0], column) for column in values.T]

    def world(self, node, time):
        local = self.local(node, time)
        return self.world(self.parent[node], time) @ local if node in self.parent else local

    def positions(self, part, times):
        node = self.nodes[part.node]
        skin, mesh = self.made.file.skins[node.skin], self.made.file.meshes[node.mesh]
        primitive = mesh.primitives[part.primitive]
        bound = self.made.array(primitive.attributes.POSITION).astype(np.float64)
        for target, weight in zip(primitive.targets or [], mesh.weights or [], strict=True):
            bound += weight * self.made.array(target["POSITION"])
        bound = np.column_stack([bound, np.ones(len(bound))])
        joints, weights = (self.made.array(getattr(primitive.attributes, name)) for name in ("JOINTS_0", "WEIGHTS_0"))
        back = self.made.array(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
        shown = []
        for time in times:
            bones = np.array([self.world(joint, time) for joint in skin.joints]) @ back
            shown.append(np.einsum("vj,vjab,vb->va", weights.astype(np.float64), bones[joints], bound)[:, :3])
        return np.array(shown)


@pytest.mark.parametrize("name", [*MADE, *REAL])
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("program", PROGRAMS)
def test_every_vertex_is_where_it_was_solved_to_be(program, form, name, show, file, players, raw):
    made = file(name, form)
    shown = show(program, made.path, TIMES)
    np.testing.assert_allclose(shown.times, np.arange(TIMES) * 2.5 / FPS, atol=1e-6)
    between = np.arange(TIMES) % 2 == 1
    expected = players.solved(made.clip)(shown.times)
    if form == "skin":  # between two keyframes bones turn, and do not go in straight lines
        exact = Skinned(raw(made.path))
        turned = {(p.node, p.primitive): exact.positions(p, shown.times) for p in made.clip.rig.character.parts}
        assert players.farthest(shown.meshes, turned) <= ROUNDING * made.diagonal
        expected = {key: np.where(between[:, None, None], turned[key], expected[key]) for key in expected}
    assert players.farthest(shown.meshes, expected) <= (made.summary.error + ROUNDING) * made.diagonal
    travels = np.linalg.norm(np.diff([positions[::2].mean(axis=1) for positions in expected.values()], axis=1), axis=2)
    assert (travels > 0).all()
