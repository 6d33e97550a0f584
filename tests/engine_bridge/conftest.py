"""A small character, a performer, a take and a puppet, all made here."""

import io
import wave
from dataclasses import dataclass

import igl
import numpy as np
import pygltflib as gltf
import pytest

from capture.skeleton import JOINT_INDEX, JOINTS, LOST, SkeletonFrame
from engine_bridge.performance.clip import load_timeline, perform
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings

from .. import recordings


def capsules(table):
    """Return from, to and radius of what a shape is made of, a line each."""
    rows = np.array([line.split() for line in table.strip().splitlines()], dtype=np.float64)
    return [(row[:3], row[3:6], row[6]) for row in rows]


LIMBS = capsules("""
0.0 0.0 0.0  0.0 1.2 0.0  0.30
0.0 1.2 0.0  0.0 1.9 0.25  0.22
0.1 1.1 0.0  1.4 1.3 0.1  0.17
-0.1 1.1 0.0  -1.35 1.2 -0.05  0.16
0.05 0.0 0.0  0.5 -1.5 0.1  0.19
-0.05 0.0 0.0  -0.55 -1.45 0.0  0.20
""")
"""From, to and radius of what a figure is made of; it stands upright and faces +z, so that its left hand is at +x."""

PERFORMER_TABLE = """
hip_center      0 0.9 2.5
spine           0 0.97 2.5
shoulder_center 0 1.31 2.5
head            0 1.51 2.48
shoulder        0.19 1.28 2.5
elbow           0.45 1.26 2.5
wrist           0.7 1.25 2.49
hand            0.78 1.25 2.48
hip             0.1 0.87 2.5
knee            0.12 0.45 2.48
ankle           0.13 0.08 2.5
foot            0.14 0.03 2.42
"""
HALF = {name: tuple(map(float, place)) for name, *place in map(str.split, PERFORMER_TABLE.strip().splitlines())}
PERFORMER = HALF | {f"{name}_right": place for name, place in HALF.items()}
PERFORMER |= {f"{name}_left": (-x, y, z) for name, (x, y, z) in HALF.items()}
"""Metres, sensor frame: the performer's right hand is at +x."""

HANDLES = """
[[handle]]
name = "left hand"
position = [1.55, 1.32, 0.1]
joint = "hand_left"

[[handle]]
name = "right hand"
position = [-1.5, 1.2, -0.05]
joints = ["hand_right", "wrist_right"]

[[handle]]
name = "head"
position = [0.0, 2.1, 0.3]
joint = "head"
axes = "xz"
gain = 0.8

[[handle]]
name = "left foot"
position = [0.55, -1.65, 0.1]

[[handle]]
name = "right foot"
position = [-0.6, -1.6, 0.0]
"""
LIMB_TABLES = """
[[limb]]
name = "trunk"
points = [[0.0, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, 1.2, 0.0]]
joints = ["hip_center", "spine", "shoulder_center"]

[[limb]]
name = "head"
points = [[0.0, 1.25, 0.0], [0.0, 1.9, 0.25]]
joints = ["shoulder_center", "head"]

[[limb]]
name = "left arm"
points = [[0.2, 1.12, 0.01], [0.8, 1.21, 0.055], [1.4, 1.3, 0.1]]
joints = ["shoulder_left", "elbow_left", "wrist_left"]

[[limb]]
name = "right arm"
points = [[-0.2, 1.11, -0.005], [-0.78, 1.155, -0.03], [-1.35, 1.2, -0.05]]
joints = ["shoulder_right", "elbow_right", "wrist_right"]

[[limb]]
name = "left leg"
points = [[0.095, -0.15, 0.01], [0.3, -0.825, 0.055], [0.5, -1.5, 0.1]]
joints = ["hip_left", "knee_left", "ankle_left"]

[[limb]]
name = "right leg"
points = [[-0.1, -0.15, 0.0], [-0.325, -0.8, 0.0], [-0.55, -1.45, 0.0]]
joints = ["hip_right", "knee_right", "ankle_right"]
"""
"""The figure's limbs; its back has a handle that follows the head."""

HUMP = """
[[handle]]
name = "hump"
position = [0.0, 0.6, -0.3]
joint = "head"
"""

SMALL = "[retarget]\nscale = 1.3\n\n[solver]\nfields = 5\nisolines = 6\n"
"""A quick model, and no search for how far the handles may go."""

ROOT = '[root]\njoint = "hip_center"\naxes = "xz"\n'


@pytest.fixture(scope="session", autouse=True)
def own_cache(of_all_workers):
    """Keep reduced models of tests out of the user's cache, in child processes as well."""
    folder = of_all_workers / "cache"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder


@dataclass(frozen=True)
class Shape:
    """A closed surface with all that a vertex may carry."""

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    colors: np.ndarray

    @property
    def diagonal(self):
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0)))


def in_picture(camera, points, size):
    """Return points (n, 2) as shares of the picture from its top left corner."""
    clip = np.column_stack([points, np.ones(len(points))]) @ camera.matrix(size).astype(float)
    assert (clip[:, 3] > 0).all()
    return clip[:, :2] / clip[:, 3:] / 2 + 0.5


def encoded(picture, kind="PNG"):
    """Return the file of a picture."""
    file = io.BytesIO()
    picture.save(file, kind)
    return file.getvalue()


def distance_to_limb(points, start, end, radius):
    start, along = np.array(start), np.array(end) - np.array(start)
    share = np.clip((points - start) @ along / (along @ along), 0, 1)
    return np.linalg.norm(points - start - share[:, None] * along, axis=1) - radius


@pytest.fixture(scope="session")
def make_shape():
    """Triangulate a union of limbs, float32 positions as a file holds them."""

    def make(limbs, step=0.097):
        ends = np.array([end for limb in limbs for end in limb[:2]])
        radius = max(limb[2] for limb in limbs)
        low = ends.min(axis=0) - radius - 2 * step + 0.013  # no vertex of the grid on a limb's axis
        counts = np.ceil((ends.max(axis=0) + radius + 2 * step - low) / step).astype(int) + 1
        grid = igl.grid(counts) * ((counts - 1) * step) + low
        distance = np.min([distance_to_limb(grid, *limb) for limb in limbs], axis=0)
        v, f, _ = igl.marching_cubes(distance, grid, *map(int, counts), 0.0)
        v = v.astype(np.float32)
        normals = igl.per_vertex_normals(v.astype(np.float64), f).astype(np.float32)
        colors = np.random.default_rng(7).uniform(0, 1, v.shape).astype(np.float32)
        return Shape(v, f, normals, v[:, :2] * np.float32(0.1) + np.float32(0.5), colors)

    return make


@pytest.fixture(scope="session")
def blob(make_shape):
    """A figure of about 1,500 vertices with a head, arms and legs."""
    return make_shape(LIMBS)


class Glb:
    """A .glb put together by hand: one buffer, one view an array."""

    def __init__(self):
        self.file = gltf.GLTF2(scene=0, scenes=[gltf.Scene(nodes=[])])
        self.blob = b""

    def view(self, data, target=None):
        self.blob += bytes(-len(self.blob) % 4)
        self.file.bufferViews.append(
            gltf.BufferView(buffer=0, byteOffset=len(self.blob), byteLength=len(data), target=target)
        )
        self.blob += data
        return len(self.file.bufferViews) - 1

    def add(self, array, target=gltf.ARRAY_BUFFER, normalized=False):
        codes = {"u1": 5121, "u2": 5123, "u4": 5125, "f4": 5126, "i1": 5120, "i2": 5122}
        flat = array.reshape(len(array), -1)
        padding = -flat[:1].nbytes % 4 // flat.itemsize if target == gltf.ARRAY_BUFFER else 0
        view = self.view(np.pad(flat, [(0, 0), (0, padding)]).tobytes(), target)
        if padding:
            self.file.bufferViews[view].byteStride = (flat.shape[1] + padding) * flat.itemsize
        self.file.accessors.append(
            gltf.Accessor(
                bufferView=view,
                componentType=codes[array.dtype.str[1:]],
                count=len(array),
                type={1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[flat.shape[1]],
                normalized=normalized,
                min=flat.min(axis=0).tolist(),
                max=flat.max(axis=0).tolist(),
            )
        )
        return len(self.file.accessors) - 1

    def primitive(self, positions, indices=None, mode=None, material=None, targets=(), **attributes):
        """Arrays in, primitive out; `targets` are dicts of arrays."""
        positions = np.asarray(positions)
        arrays = {"POSITION": positions if positions.dtype.kind == "u" else np.float32(positions), **attributes}
        return gltf.Primitive(
            attributes=gltf.Attributes(
                **{
                    key: self.add(array, normalized=array.dtype.kind in "iu" and key != "JOINTS_0")
                    for key, array in arrays.items()
                }
            ),
            indices=None if indices is None else self.add(self._indices(indices), gltf.ELEMENT_ARRAY_BUFFER),
            mode=mode,
            material=material,
            targets=[gltf.Attributes(**{key: self.add(array) for key, array in each.items()}) for each in targets],
        )

    @staticmethod
    def _indices(corners):
        return corners.ravel().astype(np.uint32 if corners.dtype.kind == "i" else corners.dtype)

    def mesh(self, *primitives, **more):
        self.file.meshes.append(gltf.Mesh(primitives=list(primitives), **more))
        return len(self.file.meshes) - 1

    def node(self, mesh=None, parent=None, **more):
        self.file.nodes.append(gltf.Node(mesh=mesh, **more))
        index = len(self.file.nodes) - 1
        (self.file.scenes[0].nodes if parent is None else self.file.nodes[parent].children).append(index)
        return index

    def show(self, *arrays, **attributes):
        """Add a node that shows a primitive, and return its number."""
        return self.node(self.mesh(self.primitive(*arrays, **attributes)))

    def save(self, path):
        self.file.buffers = [gltf.Buffer(byteLength=len(self.blob))]
        self.file.set_binary_blob(self.blob)
        self.file.save_binary(path)
        return path


@pytest.fixture
def glb():
    """An empty file to build on."""
    return Glb()


@pytest.fixture(scope="session")
def new_glb():
    """Make empty files to build on."""
    return Glb


@pytest.fixture(scope="session")
def blob_file(blob, tmp_path_factory):
    """The figure as a plain .glb."""
    made = Glb()
    made.node(made.mesh(made.primitive(blob.vertices, blob.faces, NORMAL=blob.normals), name="blob"))
    return made.save(tmp_path_factory.mktemp("blob") / "blob.glb")


@pytest.fixture(scope="session")
def standing():
    """(20, 3): the performer at rest, arms stretched out."""
    return np.array([PERFORMER[name] for name in JOINTS])


@pytest.fixture(scope="session")
def dance(standing):
    """Joints of a performer who moves arms, head and hips, (T, 20, 3); the first frame is the rest pose."""

    def move(count=58):
        t = np.arange(count) / 30
        positions = np.tile(standing, (count, 1, 1))
        sway = np.stack([0.25 * np.sin(1.9 * t), -0.05 * np.sin(3 * t) ** 2, 0.2 * (np.cos(2.3 * t) - 1)], axis=-1)
        positions += sway[:, None]
        for name, lift, phase in (("left", 0.5, 1.0), ("right", 0.35, -1.3)):
            for joint, share in (("elbow", 0.3), ("wrist", 0.8), ("hand", 1.0)):
                swing = np.stack([0 * t, np.sin(2.7 * t) ** 2, 0.6 * np.sin(phase * 1.7 * t)], axis=-1)
                positions[:, JOINT_INDEX[f"{joint}_{name}"]] += share * lift * swing
        positions[:, JOINT_INDEX["head"]] += np.stack([0.1 * np.sin(4 * t), 0 * t, -0.12 * np.sin(2 * t)], axis=-1)
        return positions

    return move


@pytest.fixture(scope="session")
def frames():
    """Turn (T, 20, 3) joints into the frames of a sensor with 30 of them a second; NaN is lost."""

    def make(positions, start=0.0):
        positions = np.ascontiguousarray(positions)  # as sensors give them; others need code compiled for them
        known = np.where(np.isnan(positions).any(axis=-1), LOST, 1).astype(np.float32)
        return [SkeletonFrame(start + i / 30, 1, place, known[i]) for i, place in enumerate(positions)]

    return make


@pytest.fixture(scope="session")
def record_events():
    """Write events as a recording of the project's own format; return its path."""
    return recordings.record


@pytest.fixture(scope="session")
def record(record_events, frames):
    """The same of joints."""
    return lambda path, positions: record_events(path, frames(positions))


@pytest.fixture(scope="session")
def take(record, dance, tmp_path_factory):
    """A recording of 58 frames: 20 evenly spaced times fall onto every third of them."""
    return record(tmp_path_factory.mktemp("take") / "dance.log", dance())


@pytest.fixture(scope="session")
def write_puppet():
    """Write a puppet file for the figure beside its mesh; no two tests write different ones to the same path."""

    def write(path, mesh, root=True, more=SMALL, handles=HANDLES, character="", replaces=False):
        text = f'[character]\nmesh = "{mesh}"\n{character}{handles}\n{ROOT if root else ""}\n{more}'
        if path.exists() and not replaces:
            assert path.read_text() == text, f"{path} is the puppet file of another test"
        path.write_text(text)
        return path

    return write


@pytest.fixture(scope="session")
def blob_puppet(blob_file, write_puppet):
    """A puppet file for the figure, with a root."""
    return write_puppet(blob_file.with_name("blob.toml"), blob_file.name)


@pytest.fixture(scope="session")
def prepared_blob(blob_puppet):
    """The figure's puppet, mesh and reduced model."""
    return load_prepared(blob_puppet)


@pytest.fixture(scope="session")
def limb_tables():
    """Tables of the figure's limbs and of one handle."""
    return LIMB_TABLES + HUMP


@pytest.fixture(scope="session")
def limbed_puppet(blob_file, write_puppet):
    """A puppet file for the figure with limbs and one handle."""
    return write_puppet(blob_file.with_name("limbed.toml"), blob_file.name, handles=LIMB_TABLES + HUMP)


@pytest.fixture(scope="session")
def limbed_figure(limbed_puppet):
    """The same, with its mesh and reduced model."""
    return load_prepared(limbed_puppet)


@pytest.fixture(scope="session")
def clip_of(take):
    """Perform a recording with a puppet file, as `convert` does; return the clip."""

    def make(puppet, log=take):
        timeline, notes = load_timeline(log, Settings())
        return perform(load_prepared(puppet), timeline, Settings(), notes, lambda *_: None)

    return make


@pytest.fixture
def talking(glb, blob, write_puppet, limb_tables, tmp_path):
    """Return the puppet file of a figure with a target "jaw", with limbs or handles."""
    down = np.zeros_like(blob.vertices)
    down[blob.vertices[:, 1] > 1.6] = [0, -0.2, 0.1]
    made = glb.primitive(blob.vertices, blob.faces, NORMAL=blob.normals, targets=[{"POSITION": down}])
    glb.node(glb.mesh(made, extras={"targetNames": ["jaw"]}))
    glb.save(tmp_path / "talking.glb")

    def make(limbs):
        options = {"handles": limb_tables} if limbs else {}
        path = write_puppet(tmp_path / "talking.toml", "talking.glb", **options, replaces=True)
        path.write_text(path.read_text() + '\n[[morph]]\ntarget = "jaw"\nchannel = "voice"\n')
        return path

    return make


@pytest.fixture
def write_wav(tmp_path):
    """Write samples (n,) or (n, channels) within [-1, 1] as a .wav of 16 bits."""

    def write(samples, rate=48_000, name="sound.wav"):
        samples = np.asarray(samples, float).reshape(len(samples), -1)
        with wave.open(str(tmp_path / name), "wb") as file:
            file.setnchannels(samples.shape[1])
            file.setsampwidth(2)
            file.setframerate(rate)
            file.writeframes(np.rint(samples * 32767).astype("<i2").tobytes())
        return tmp_path / name

    return write
