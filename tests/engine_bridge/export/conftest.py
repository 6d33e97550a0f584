"""One figure in many variants of glTF files."""

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np
import pygltflib as gltf
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation, Slerp

from engine_bridge.character.character import load_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.export.convert import Summary, convert
from engine_bridge.performance.clip import Clip
from engine_bridge.performance.settings import Settings
from solver.model.reduced_model import position_matrix

from ..conftest import encoded


@dataclass(frozen=True)
class Variant:
    """A character file, and the world positions of each primitive with triangles."""

    name: str
    path: Path
    shown: list


def part_of(shape, chosen):
    """Return the vertices and faces of a part, with vertices in the shape's order."""
    used, corners = np.unique(shape.faces[chosen], return_inverse=True)
    return used, corners.reshape(-1, 3).astype(np.uint32)


def add_animation(glb, name, node, path, times, values, pointer=None):
    """Add an animation with one channel, of a node or of a pointer, that interpolates values between times."""
    keys = [glb.add(np.float32(array), None) for array in (times, values)]
    target = gltf.AnimationChannelTarget(node=node, path=path)
    if pointer is not None:
        target = gltf.AnimationChannelTarget(path="pointer", extensions={"KHR_animation_pointer": {"pointer": pointer}})
    sampler = gltf.AnimationSampler(input=keys[0], output=keys[1], interpolation="LINEAR")
    channel = gltf.AnimationChannel(sampler=0, target=target)
    glb.file.animations.append(gltf.Animation(name=name, channels=[channel], samplers=[sampler]))


def textured(glb, shape):
    png = encoded(Image.fromarray((np.indices((8, 8)).sum(0) % 2 * 255).astype(np.uint8)))
    glb.file.images = [gltf.Image(bufferView=glb.view(png), mimeType="image/png", name="squares")]
    glb.file.samplers = [gltf.Sampler(magFilter=9728)]
    glb.file.textures = [gltf.Texture(source=0, sampler=0)]
    surface = gltf.PbrMetallicRoughness(baseColorTexture=gltf.TextureInfo(index=0), roughnessFactor=0.3)
    glb.file.materials = [gltf.Material(name="squares", pbrMetallicRoughness=surface, doubleSided=True)]
    more = {"NORMAL": shape.normals, "TEXCOORD_0": shape.uv}
    glb.show(shape.vertices, shape.faces, material=0, **more)
    return [shape.vertices]


def several_primitives(glb, shape):
    glb.file.materials = [
        gltf.Material(name=name, pbrMetallicRoughness=gltf.PbrMetallicRoughness(baseColorFactor=color))
        for name, color in (("left", [0.8, 0.2, 0.1, 1]), ("right", [0.1, 0.3, 0.9, 1]))
    ]
    left = shape.vertices[shape.faces].mean(axis=1)[:, 0] > 0
    primitives, shown = [], []
    for material, chosen in enumerate((left, ~left)):
        used, faces = part_of(shape, chosen)
        more = {"NORMAL": shape.normals[used], "TEXCOORD_0": shape.uv[used]}
        primitives.append(glb.primitive(shape.vertices[used], faces, material=material, **more))
        shown.append(shape.vertices[used])
    glb.node(glb.mesh(*primitives, name="two"))
    return shown


def mixed_primitives(glb, shape):
    """Lines, and parts with colours of bytes, with colours of floats and no normals, and without indices."""
    first, second, third = np.array_split(np.arange(len(shape.faces)), 3)
    (some, faces), (others, more), corners = part_of(shape, first), part_of(shape, second), shape.faces[third].ravel()
    rgba = np.round(np.pad(shape.colors, [(0, 0), (0, 1)], constant_values=1) * 255).astype(np.uint8)
    at, normals = shape.vertices, shape.normals
    glb.node(
        glb.mesh(
            glb.primitive(at[:10], mode=gltf.LINE_STRIP),
            glb.primitive(at[some], faces.astype(np.uint16), NORMAL=normals[some], COLOR_0=rgba[some]),
            glb.primitive(at[others], more, COLOR_0=shape.colors[others]),
            glb.primitive(at[corners], NORMAL=normals[corners]),
            name="mixed",
        )
    )
    return [at[some], at[others], at[corners]]


def transform(place=(0, 0, 0), turn=(0, 0, 0), scale=(1, 1, 1)):
    """Return a (4, 4) matrix for column vectors; Euler angles in degrees."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler("xyz", turn, degrees=True).as_matrix() * scale
    matrix[:3, 3] = place
    return matrix


def unit(vectors):
    """Return unit vectors (…, 3)."""
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(np.float32)


def moved(points, matrices):
    """Return points (n, 3) where a (4, 4) matrix, or one each, takes them."""
    matrices = np.broadcast_to(matrices, (len(points), 4, 4))
    return np.einsum("nab,nb->na", matrices[:, :3, :3], points) + matrices[:, :3, 3]


def node_transforms(glb, shape):
    """Head and arms, legs and the rest under nodes that are turned, stretched and mirrored."""
    to_above = transform([0.5, -1.0, 2.0], [30, -50, 110])
    turn = Rotation.from_matrix(to_above[:3, :3]).as_quat().tolist()
    above = glb.node(translation=[0.5, -1.0, 2.0], rotation=turn, name="above")
    mirror, matrix = transform(scale=[-1, 2, 0.5]), transform([0.0, 0.3, 0.1], [0, 0, 70], [3, 3, 3])
    height = shape.vertices[shape.faces].mean(axis=1)[:, 1]
    shown, nodes = [], []
    for chosen, to_world, where in (
        (height > 0.9, to_above @ mirror, {"parent": above, "scale": [-1, 2, 0.5]}),
        (height <= -0.3, matrix, {"matrix": matrix.T.ravel().tolist()}),
        ((height > -0.3) & (height <= 0.9), np.eye(4), {}),
    ):
        used, faces = part_of(shape, chosen)
        points = np.float32(moved(shape.vertices[used], np.linalg.inv(to_world)))
        normals = unit(shape.normals[used] @ to_world[:3, :3])
        faces = faces if np.linalg.det(to_world) > 0 else faces[:, ::-1]
        nodes.append((glb.mesh(glb.primitive(points, faces, NORMAL=normals)), where))
        shown.append(moved(points, to_world))
    for mesh, where in nodes:
        glb.node(mesh, **where)
    return shown


def shared_mesh(glb, shape):
    """One half for both sides, which a second node shows mirrored."""
    used, faces = part_of(shape, (shape.vertices[shape.faces][:, :, 0] > -0.06).all(axis=1))
    half = shape.vertices[used]
    half[np.abs(half[:, 0]) < 0.06, 0] = 0
    mesh = glb.mesh(glb.primitive(half, faces, NORMAL=shape.normals[used]), name="half")
    glb.node(mesh, name="left")
    glb.node(mesh, name="right", scale=[-1, 1, 1])
    return [half, half * [-1, 1, 1]]


def own_targets(glb, shape):
    """Two targets in the file; the figure has the first one at a weight of a quarter."""
    smile = np.float32(shape.vertices * [0.0, 0.1, 0.2])
    before = shape.vertices - np.float32(0.25) * smile
    targets = [{"POSITION": each, "NORMAL": 0 * each} for each in (smile, np.roll(smile, 1, axis=1))]
    primitive = glb.primitive(before, shape.faces, NORMAL=shape.normals, targets=targets)
    glb.node(glb.mesh(primitive, weights=[0.25, 0.0], extras={"targetNames": ["smile", "frown"], "author": "test"}))
    return [before + 0.25 * smile.astype(np.float64)]


def skinned(glb, shape):
    """Two bones that are bent from the bind pose and blended at the waist; the mesh's node is elsewhere."""
    lower, upper = transform([0.2, -0.1, 0.4]), transform([0.1, 0.3, 0.0], [20, -35, 50], [1.5] * 3)
    share = np.clip(shape.vertices[:, 1] / 0.6, 0, 1)
    weights = np.pad(np.float32([1 - share, share]).T, [(0, 0), (0, 2)])
    blend = np.einsum("nj,jab->nab", weights[:, :2], [lower, lower @ upper])
    bound = np.float32(moved(shape.vertices, np.linalg.inv(blend)))
    normals = unit(np.einsum("nba,nb->na", blend[:, :3, :3], shape.normals))
    hip = glb.node(matrix=lower.T.ravel().tolist(), name="hip")
    chest = glb.node(parent=hip, matrix=upper.T.ravel().tolist(), name="chest")
    identity = glb.add(np.float32([np.eye(4)] * 2), None)
    glb.file.skins = [gltf.Skin(joints=[hip, chest], inverseBindMatrices=identity, name="bones")]
    joints = np.uint8([0, 1, 0, 0] * (weights > 0))
    primitive = glb.primitive(bound, shape.faces, NORMAL=normals, JOINTS_0=joints, WEIGHTS_0=weights)
    glb.node(glb.mesh(primitive), skin=0, name="elsewhere")
    return [moved(bound, blend)]


def quantized(glb, shape):
    """Positions of 16 bits, which the node's transform restores (KHR_mesh_quantization)."""
    low, size = shape.vertices.min(axis=0), float(np.ptp(shape.vertices, axis=0).max())
    stored = np.round((shape.vertices - low) / size * 65535).astype(np.uint16)
    primitive = glb.primitive(stored, shape.faces, NORMAL=np.round(shape.normals * 127).astype(np.int8))
    glb.file.extensionsUsed = glb.file.extensionsRequired = ["KHR_mesh_quantization"]
    glb.node(glb.mesh(primitive), translation=low.tolist(), scale=[size] * 3)
    return [(stored / np.float32(65535)).astype(np.float64) * size + low]


def strips_and_fans(glb, shape):
    """The triangles around one vertex as a fan, and all others as a strip with degenerate triangles in between."""
    hub = int(shape.faces[0, 0])
    around = (shape.faces == hub).any(axis=1)
    follow = dict(np.roll(face, -face.tolist().index(hub))[1:].tolist() for face in shape.faces[around])
    ring = [next(iter(follow))]
    while len(ring) <= len(follow):
        ring.append(follow[ring[-1]])
    fan = np.array([hub, *ring], dtype=np.uint16)
    strip = shape.faces[~around][:, [0, 0, 0, 1, 2, 2]].astype(np.uint16)
    modes = (strip, gltf.TRIANGLE_STRIP), (fan, gltf.TRIANGLE_FAN)
    glb.node(glb.mesh(*(glb.primitive(shape.vertices, order, mode, NORMAL=shape.normals) for order, mode in modes)))
    return [shape.vertices, shape.vertices]


def bare_scene(glb, shape):
    """No normals, and no scene, so that all nodes without a parent are shown."""
    mesh = glb.mesh(glb.primitive(shape.vertices, shape.faces))
    glb.node(mesh, parent=glb.node(translation=[0, 0.5, 0]))
    glb.file.scene, glb.file.scenes = None, []
    return [shape.vertices + np.float32([0, 0.5, 0])]


VARIANTS = [
    *(textured, several_primitives, mixed_primitives, node_transforms, shared_mesh),
    *(own_targets, skinned, quantized, strips_and_fans, bare_scene),
]


@pytest.fixture(scope="session")
def variants(blob, new_glb, tmp_path_factory):
    """Each variant by name."""
    folder = tmp_path_factory.mktemp("variants")

    def make(build):
        glb = new_glb()
        shown = build(glb, blob)
        for number, each in enumerate((*glb.file.nodes, *glb.file.meshes)):
            each.name = each.name or f"thing_{number}"
        return Variant(build.__name__, glb.save(folder / f"{build.__name__}.glb"), shown)

    return {build.__name__: make(build) for build in VARIANTS}


@pytest.fixture(params=[build.__name__ for build in VARIANTS])
def variant(request, variants):
    """Each variant in turn."""
    return variants[request.param]


@dataclass(frozen=True)
class Export:
    """A variant, and the form, clip and summary of its conversion."""

    variant: Variant
    form: str
    clip: Clip
    summary: Summary

    @property
    def path(self):
        return Path(self.summary.output)

    @property
    def diagonal(self):
        return self.clip.motion.prepared.mesh.diagonal

    @cached_property
    def raw(self):
        return Raw(self.path)


REAL = ("cubevc", "kenney/character", "khronos_Fox", "nested", "quaternius_Adventurer")
"""Characters of others: colours, nodes that move, a skin without indices, nested nodes, fifteen surfaces."""

STILL = ("own_targets", "bare_scene")
"""Variants that are converted without a root as well."""

EXPORTS = [
    *((build.__name__, form) for build in VARIANTS for form in ("morph", "rig")),
    *((name, "frames") for name in ("textured", "node_transforms", "own_targets", "skinned")),
    *((name, "still") for name in STILL),
    *((name, "morph") for name in REAL),
]
"""Names of characters, and the form of each; "still" are morph targets without a root."""


@pytest.fixture(scope="session")
def export_of(variants, write_puppet, request):
    """Convert a variant, or a real character, which is moved by handles at its six outermost points."""

    def make(folder, log, name, form, **options):
        variant = variants.get(name)
        if variant is None:
            path = request.getfixturevalue("real_data") / "mesh" / "gltf" / f"{name}.glb"
            character = load_character(path)
            variant = Variant(name, path, [part.vertices for part in character.parts])
            scale = np.linalg.norm(np.ptp(character.vertices, axis=0)) / 4
            more = f"[retarget]\nscale = {scale}\n\n[solver]\nfields = 5\nisolines = 6\n"
            options = {"handles": outermost_handles(character.vertices), "more": more}
        puppet = write_puppet(folder / f"{variant.path.stem}_{form}.toml", variant.path, **options)
        settings = Settings(form="morph" if form == "still" else form)
        return Export(variant, form, *convert(log, puppet, puppet.with_suffix(".glb"), settings))

    return make


@pytest.fixture(scope="session")
def exported(export_of, take, tmp_path_factory):
    """Convert a character, once for all tests."""
    folder = tmp_path_factory.mktemp("exported")
    return cache(lambda name, form: export_of(folder, take, name, form, root=form != "still"))


@pytest.fixture(params=EXPORTS, ids=" as ".join)
def export(request, exported):
    """Each exported file in turn, of the variants and of real characters."""
    return exported(*request.param)


def solved_places(prepared, frames):
    """Return the float64 vertices (F, n, 3) of the solver's surface in frames, from W and R."""
    model, mesh = prepared.model, prepared.mesh
    W = position_matrix(
        model.to_model(mesh.vertices), model.isoline_coordinates.astype(np.float64), model.weights, model.isolines
    )
    return np.array([W @ R for R in frames.astype(np.float64)]) * model.diagonal + model.center


def solved(clip):
    """Return the same of a clip, with the root's translation."""
    root = 0 if clip.motion.prepared.puppet.root is None else clip.motion.root[:][:, None]
    return solved_places(clip.motion.prepared, clip.motion.R[:]) + root


def primitives(made):
    """Return the primitives of all nodes of the scene, in order."""
    nodes, meshes = made.file.nodes, made.file.meshes
    return [each for node in made.file.scenes[0].nodes for each in meshes[nodes[node].mesh].primitives]


def posed(document, time):
    """Return a document whose nodes are posed as at a time of its first animation; bones turn by the shortest arc."""
    shown, animation = document.copy(), document.gltf["animations"][0]
    for channel in animation["channels"]:
        sampler, path = animation["samplers"][channel["sampler"]], channel["target"]["path"]
        keyed, values = (document.array(sampler[name]).astype(np.float64) for name in ("input", "output"))
        at = np.clip(time, keyed[0], keyed[-1])
        if path == "rotation":
            value = Slerp(keyed, Rotation.from_quat(values))(at).as_quat()
        else:
            value = np.array([np.interp(at, keyed, column) for column in values.reshape(len(keyed), -1).T])
        shown.gltf["nodes"][channel["target"]["node"]][path] = value.tolist()
    return shown


def outermost_handles(vertices):
    """Return the tables of handles at the outermost points of a character."""
    picks = dict.fromkeys(int(pick) for axis in vertices.T for pick in (axis.argmin(), axis.argmax()))
    joints = ["hand_left", "hand_right", "head", "foot_left", "foot_right", "spine"]
    return "".join(
        f'[[handle]]\nname = "{joint}"\nposition = {vertices[pick].tolist()}\njoint = "{joint}"\n\n'
        for pick, joint in zip(picks, joints, strict=False)
    )


class Raw:
    """A .glb as read by pygltflib, with accessors as arrays; only to read."""

    def __init__(self, path):
        self.file = gltf.GLTF2().load(path)
        self._document = load_document(path)
        self.view = self._document.view

    def array(self, index):
        """Rows (count, width) of an accessor."""
        values = self._document.array(index)
        return values.reshape(len(values), -1)

    def weights(self, node):
        """Weights (F, K) of the channel that morphs a node."""
        animation = self.file.animations[0]
        channel = next(c for c in animation.channels if (c.target.node, c.target.path) == (node, "weights"))
        sampler = animation.samplers[channel.sampler]
        return self.array(sampler.output).reshape(self.file.accessors[sampler.input].count, -1).astype(np.float64)
