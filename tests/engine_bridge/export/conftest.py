"""One figure in many variants of glTF files."""

import hashlib
import io
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import igl
import numpy as np
import pygltflib as gltf
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation, Slerp

from engine_bridge.character.character import load_character
from engine_bridge.export.convert import Summary, convert
from engine_bridge.performance.clip import Clip
from engine_bridge.performance.settings import Settings
from solver.model.reduced_model import position_matrix


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


def add_texture(glb):
    """Add a material with squares."""
    png = io.BytesIO()
    Image.fromarray((np.indices((8, 8)).sum(0) % 2 * 255).astype(np.uint8)).save(png, "PNG")
    glb.file.images = [gltf.Image(bufferView=glb.view(png.getvalue()), mimeType="image/png", name="squares")]
    glb.file.samplers = [gltf.Sampler(magFilter=9728)]
    glb.file.textures = [gltf.Texture(source=0, sampler=0)]
    surface = gltf.PbrMetallicRoughness(baseColorTexture=gltf.TextureInfo(index=0), roughnessFactor=0.3)
    glb.file.materials = [gltf.Material(name="squares", pbrMetallicRoughness=surface, doubleSided=True)]


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
    add_texture(glb)
    more = {"NORMAL": shape.normals, "TEXCOORD_0": shape.uv}
    glb.show(shape.vertices, shape.faces, material=0, **more)
    return [shape.vertices]


def colored(glb, shape):
    rgba = np.round(np.column_stack([shape.colors, np.ones(len(shape.colors))]) * 255).astype(np.uint8)
    more = {"NORMAL": shape.normals, "COLOR_0": rgba}
    glb.node(glb.mesh(glb.primitive(shape.vertices, shape.faces.astype(np.uint16), **more), name="colored"))
    return [shape.vertices]


def float_colors(glb, shape):
    more = {"NORMAL": shape.normals, "COLOR_0": shape.colors}
    glb.show(shape.vertices, shape.faces, **more)
    return [shape.vertices]


def without_normals(glb, shape):
    glb.show(shape.vertices, shape.faces.astype(np.uint16))
    return [shape.vertices]


def without_indices(glb, shape):
    corners = shape.faces.ravel()
    glb.show(shape.vertices[corners], NORMAL=shape.normals[corners])
    return [shape.vertices[corners]]


def several_primitives(glb, shape):
    glb.file.materials = [gltf.Material(name=name) for name in ("left", "right")]
    left = shape.vertices[shape.faces].mean(axis=1)[:, 0] > 0
    primitives, shown = [], []
    for material, chosen in enumerate((left, ~left)):
        used, faces = part_of(shape, chosen)
        more = {"NORMAL": shape.normals[used], "TEXCOORD_0": shape.uv[used]}
        primitives.append(glb.primitive(shape.vertices[used], faces, material=material, **more))
        shown.append(shape.vertices[used])
    glb.node(glb.mesh(*primitives, name="two"))
    return shown


def with_lines(glb, shape):
    surface = glb.primitive(shape.vertices, shape.faces, NORMAL=shape.normals)
    outline = glb.primitive(shape.vertices[:10], mode=gltf.LINE_STRIP)
    glb.node(glb.mesh(outline, surface))
    return [shape.vertices]


def local(points, normals, to_world):
    """Convert world coordinates to a node's space."""
    back = np.linalg.inv(to_world)
    turned = normals @ to_world[:3, :3]
    return (
        (points @ back[:3, :3].T + back[:3, 3]).astype(np.float32),
        (turned / np.linalg.norm(turned, axis=1, keepdims=True)).astype(np.float32),
    )


def node_transforms(glb, shape):
    """Head and arms, legs and the rest under nodes that are turned, stretched and mirrored."""
    turn = Rotation.from_euler("xyz", [30, -50, 110], degrees=True)
    above = glb.node(translation=[0.5, -1.0, 2.0], rotation=turn.as_quat().tolist(), name="above")
    to_above = np.eye(4)
    to_above[:3, :3], to_above[:3, 3] = turn.as_matrix(), [0.5, -1.0, 2.0]
    mirror = np.diag([-1.0, 2.0, 0.5, 1.0])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = 3 * Rotation.from_euler("z", 70, degrees=True).as_matrix(), [0.0, 0.3, 0.1]
    height = shape.vertices[shape.faces].mean(axis=1)[:, 1]
    shown = []
    for chosen, to_world, where in (
        (height > 0.9, to_above @ mirror, {"parent": above, "scale": [-1, 2, 0.5]}),
        (height <= -0.3, matrix, {"matrix": matrix.T.ravel().tolist()}),
        ((height > -0.3) & (height <= 0.9), np.eye(4), {}),
    ):
        used, faces = part_of(shape, chosen)
        points, normals = local(shape.vertices[used], shape.normals[used], to_world)
        faces = faces if np.linalg.det(to_world) > 0 else faces[:, ::-1]
        mesh = glb.mesh(glb.primitive(points, faces, NORMAL=normals))
        shown.append((points.astype(np.float64) @ to_world[:3, :3].T + to_world[:3, 3], where, mesh))
    for _, where, mesh in shown:
        glb.node(mesh, **where)
    return [points for points, _, _ in shown]


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
    smile = (shape.vertices * [0.0, 0.1, 0.2]).astype(np.float32)
    frown = np.roll(smile, 1, axis=1)
    still = np.zeros_like(smile)
    before = (shape.vertices - np.float32(0.25) * smile).astype(np.float32)
    mesh = glb.mesh(
        glb.primitive(
            before,
            shape.faces,
            NORMAL=shape.normals,
            targets=[{"POSITION": smile, "NORMAL": still}, {"POSITION": frown, "NORMAL": still}],
        ),
        weights=[0.25, 0.0],
        extras={"targetNames": ["smile", "frown"], "author": "test"},
    )
    glb.node(mesh)
    return [before + 0.25 * smile.astype(np.float64)]


def skinned(glb, shape):
    """Two bones that are bent from the bind pose and blended at the waist; the mesh's node is elsewhere."""
    turn = Rotation.from_euler("xyz", [20, -35, 50], degrees=True)
    lower, upper = np.eye(4), np.eye(4)
    lower[:3, 3] = [0.2, -0.1, 0.4]
    upper[:3, :3], upper[:3, 3] = turn.as_matrix() * 1.5, [0.1, 0.3, 0.0]
    share = np.clip(shape.vertices[:, 1] / 0.6, 0, 1).astype(np.float32)
    share = np.column_stack([1 - share, share, np.zeros((len(share), 2), np.float32)])
    blend = np.einsum("nj,jab->nab", share[:, :2].astype(np.float64), [lower, lower @ upper])
    back = np.linalg.inv(blend)
    bound = (np.einsum("nab,nb->na", back[:, :3, :3], shape.vertices) + back[:, :3, 3]).astype(np.float32)
    normals = np.einsum("nba,nb->na", blend[:, :3, :3], shape.normals)
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    hip = glb.node(translation=[0.2, -0.1, 0.4], name="hip")
    chest = glb.node(
        parent=hip, translation=[0.1, 0.3, 0.0], rotation=turn.as_quat().tolist(), scale=[1.5] * 3, name="chest"
    )
    identity = np.tile(np.eye(4, dtype=np.float32), (2, 1, 1)).reshape(2, 16)
    glb.file.skins = [gltf.Skin(joints=[hip, chest], inverseBindMatrices=glb.add(identity, None), name="bones")]
    joints = (np.array([0, 1, 0, 0]) * (share > 0)).astype(np.uint8)
    primitive = glb.primitive(bound, shape.faces, NORMAL=normals)
    primitive.attributes.JOINTS_0, primitive.attributes.WEIGHTS_0 = glb.add(joints), glb.add(share)
    glb.node(glb.mesh(primitive), skin=0, name="elsewhere")
    return [np.einsum("nab,nb->na", blend[:, :3, :3], bound) + blend[:, :3, 3]]


def quantized(glb, shape):
    """Positions of 16 bits, which the node's transform restores (KHR_mesh_quantization)."""
    low, size = shape.vertices.min(axis=0), float(np.ptp(shape.vertices, axis=0).max())
    stored = np.round((shape.vertices - low) / size * 65535).astype(np.uint16)
    normals = np.round(shape.normals * 127).astype(np.int8)
    primitive = glb.primitive(np.zeros((3, 3)), shape.faces)
    padded = np.zeros((len(stored), 4), np.uint16)
    padded[:, :3] = stored
    primitive.attributes.POSITION = glb.add(padded, normalized=True)
    glb.file.accessors[-1].type = "VEC3"
    glb.file.accessors[-1].min, glb.file.accessors[-1].max = (
        [float(x) for x in f(stored, axis=0)] for f in (np.min, np.max)
    )
    glb.file.bufferViews[-1].byteStride = 8
    primitive.attributes.NORMAL = glb.add(np.pad(normals, ((0, 0), (0, 1))), normalized=True)
    glb.file.accessors[-1].type = "VEC3"
    glb.file.accessors[-1].min = glb.file.accessors[-1].max = None
    glb.file.bufferViews[-1].byteStride = 4
    glb.file.extensionsUsed = glb.file.extensionsRequired = ["KHR_mesh_quantization"]
    glb.node(glb.mesh(primitive), translation=low.tolist(), scale=[size] * 3)
    return [(stored / np.float32(65535)).astype(np.float64) * size + low]


def strips_and_fans(glb, shape):
    """The triangles around one vertex as a fan, and all others as a strip with degenerate triangles in between."""
    hub = int(shape.faces[0, 0])
    around = (shape.faces == hub).any(axis=1)
    follow = {}
    for face in shape.faces[around]:
        at = int(np.flatnonzero(face == hub)[0])
        follow[int(face[at - 2])] = int(face[at - 1])
    ring = [next(iter(follow))]
    while len(ring) <= len(follow):
        ring.append(follow[ring[-1]])
    fan = np.array([hub, *ring], dtype=np.uint16)
    strip = shape.faces[~around][:, [0, 0, 0, 1, 2, 2]].astype(np.uint16)
    more = {"NORMAL": shape.normals}
    glb.node(
        glb.mesh(
            glb.primitive(shape.vertices, strip, mode=gltf.TRIANGLE_STRIP, **more),
            glb.primitive(shape.vertices, fan, mode=gltf.TRIANGLE_FAN, **more),
        )
    )
    return [shape.vertices, shape.vertices]


def bare_scene(glb, shape):
    """No scene, so that all nodes without a parent are shown."""
    mesh = glb.mesh(glb.primitive(shape.vertices, shape.faces, NORMAL=shape.normals))
    glb.node(mesh, parent=glb.node(translation=[0, 0.5, 0]))
    glb.file.scene, glb.file.scenes = None, []
    return [shape.vertices + np.float32([0, 0.5, 0])]


VARIANTS = [
    *(textured, colored, float_colors, without_normals, without_indices, several_primitives, with_lines),
    *(node_transforms, shared_mesh, own_targets, skinned, quantized, strips_and_fans, bare_scene),
]


@pytest.fixture(scope="session")
def variants(blob, new_glb, tmp_path_factory):
    """Each variant by name."""
    folder = tmp_path_factory.mktemp("variants")

    def make(build):
        glb = new_glb()
        shown = build(glb, blob)
        return Variant(build.__name__, glb.save(folder / f"{build.__name__}.glb"), shown)

    return {build.__name__: make(build) for build in VARIANTS}


@pytest.fixture(params=[build.__name__ for build in VARIANTS])
def variant(request, variants):
    """Each variant in turn."""
    return variants[request.param]


@dataclass(frozen=True)
class Export:
    """A variant, and the clip and summary of its conversion."""

    variant: Variant
    clip: Clip
    summary: Summary

    @property
    def path(self):
        return Path(self.summary.output)


EXPORTS = [*((build.__name__, True) for build in VARIANTS), *((name, False) for name in ("own_targets", "bare_scene"))]
"""Names of the variants that are converted, and whether the puppet has a root."""


@pytest.fixture(scope="session")
def exports(variants, take, write_puppet):
    """All variants converted, by name and whether the puppet has a root."""

    def make(variant, root):
        name = f"{variant.name}_{'root' if root else 'still'}"
        puppet = write_puppet(variant.path.with_name(f"{name}.toml"), variant.path.name, root=root)
        return Export(variant, *convert(take, puppet, variant.path.with_name(f"{name}_out.glb"), Settings()))

    return {(name, root): make(variants[name], root) for name, root in EXPORTS}


REAL = ("cubevc", "kenney/character", "khronos_Fox", "nested", "quaternius_Adventurer")
"""Characters of others: colours, nodes that move, a skin without indices, nested nodes, fifteen surfaces."""


@pytest.fixture(scope="session")
def real_export(real_data, take, tmp_path_factory):
    """Convert a real character, moved by handles at its six outermost points."""
    folder = tmp_path_factory.mktemp("real")

    @cache
    def make(name):
        path, puppet = real_data / "mesh" / "gltf" / f"{name}.glb", folder / f"{Path(name).name}.toml"
        character = load_character(path)
        handles = outermost_handles(character.vertices)
        puppet.write_text(f'[character]\nmesh = "{path}"\n\n{handles}[root]\n\n[solver]\nfields = 5\nisolines = 6\n')
        shown = [part.vertices for part in character.parts]
        variant = Variant(name, path, shown)
        return Export(variant, *convert(take, puppet, puppet.with_suffix(".glb"), Settings()))

    return make


@pytest.fixture(params=[*EXPORTS, *REAL], ids=str)
def export(request):
    """Each exported file in turn, of the variants and of real characters."""
    if request.param in REAL:
        return request.getfixturevalue("real_export")(request.param)
    return request.getfixturevalue("exports")[request.param]


@pytest.fixture(scope="session")
def solved():
    """Return the float64 vertices of the solver's surface in each frame, from W and R, with the root's translation."""

    def vertices(clip):
        model, mesh = clip.rig.model, clip.rig.mesh
        W = position_matrix(
            model.to_model(mesh.vertices), model.isoline_coordinates.astype(np.float64), model.weights, model.isolines
        )
        moved = np.array([W @ R for R in clip.frames[:].astype(np.float64)]) * model.diagonal + model.center
        return moved + (clip.root[:, None] if clip.rig.puppet.root is not None else 0)

    return vertices


def between_keys(moved):
    """Return positions at 39 times over 58 frames: at every third frame, and on straight lines halfway between."""
    times = np.empty((39, *moved.shape[1:]))
    times[::2], times[1::2] = moved[::3], (moved[1::3] + moved[2::3]) / 2
    return times


def by_part(clip, moved):
    """Return positions (F, n, 3) of the solver's vertices for each part of the character."""
    return [moved[:, clip.rig.mesh.of_render[place]] for place in clip.rig.character.vertex_slices]


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


def normal_angles(seen, frames, mesh):
    """Return angles (F, N), in degrees, between normals and those of the moved surface."""
    true = np.array([igl.per_vertex_normals(frame, mesh.faces)[mesh.of_render] for frame in frames])
    return np.degrees(np.arccos(np.clip(np.einsum("fvc,fvc->fv", seen, true), -1, 1)))


def assert_same_primitive(before, old, after, new, changed=()):
    """Assert that a primitive has the arrays of another file's, but those with some names."""
    assert old.material == new.material
    if "indices" not in changed:
        assert old.mode == new.mode
        assert_same_array(before, old.indices, after, new.indices)
    for name, accessor in vars(old.attributes).items():
        if name not in changed:
            assert_same_array(before, accessor, after, getattr(new.attributes, name))
    for was, now in zip(old.targets, new.targets, strict=False):
        for name in {"POSITION", "NORMAL"}.difference(changed):
            assert_same_array(before, was[name], after, now[name])


def assert_same_array(before, old, after, new):
    """Assert that two accessors have the same type and bytes, or that there is none."""
    if old is None:
        assert new is None
        return
    a, b = before.file.accessors[old], after.file.accessors[new]
    assert (a.componentType, a.type, a.count, a.normalized) == (b.componentType, b.type, b.count, b.normalized)
    assert before.array(old).tobytes() == after.array(new).tobytes()


def outermost_handles(vertices):
    """Return the tables of handles at the outermost points of a character."""
    picks = dict.fromkeys(int(pick) for axis in vertices.T for pick in (axis.argmin(), axis.argmax()))
    joints = ["hand_left", "hand_right", "head", "foot_left", "foot_right", "spine"]
    return "".join(
        f'[[handle]]\nname = "{joint}"\nposition = {vertices[pick].tolist()}\njoint = "{joint}"\n\n'
        for pick, joint in zip(picks, joints, strict=False)
    )


class Raw:
    """A .glb as read by pygltflib, with accessors as arrays."""

    def __init__(self, path):
        self.file = gltf.GLTF2().load(path)
        self.blob = self.file.binary_blob()

    def array(self, index):
        accessor = self.file.accessors[index]
        view = self.file.bufferViews[accessor.bufferView]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor.type]
        kind = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}[accessor.componentType]
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        stride = view.byteStride or np.dtype(kind).itemsize * width
        rows = np.lib.stride_tricks.as_strided(
            np.frombuffer(self.blob, "u1")[start:].view(),
            (accessor.count, np.dtype(kind).itemsize * width),
            (stride, 1),
        )
        values = np.ascontiguousarray(rows).view(kind).reshape(accessor.count, width)
        return values / np.float32(np.iinfo(kind).max) if accessor.normalized else values

    def view(self, index):
        view = self.file.bufferViews[index]
        return self.blob[view.byteOffset or 0 :][: view.byteLength]

    def weights(self, node):
        """Weights (F, K) of the channel that morphs a node."""
        animation = self.file.animations[0]
        channel = next(c for c in animation.channels if (c.target.node, c.target.path) == (node, "weights"))
        sampler = animation.samplers[channel.sampler]
        return self.array(sampler.output).reshape(self.file.accessors[sampler.input].count, -1).astype(np.float64)


@pytest.fixture(scope="session")
def raw():
    """Open a .glb without the project's own reader, to read only: the same content is parsed once."""
    parse = lru_cache(maxsize=64)(lambda path, _digest: Raw(path))

    def read(path):
        return parse(path, hashlib.sha256(Path(path).read_bytes()).digest())

    return read
