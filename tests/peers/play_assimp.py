"""play_assimp.py FILE N OUTBASE: play what assimp imports of a .glb's first animation and write what every vertex does.

Assimp reads files and plays none. Everything here is computed from what its C library gives: nodes, channels, morph
weights and bones, by assimp's own conventions (an anim mesh holds whole positions; a bone's matrix is its node's world
transform times its offset matrix), with straight lines between keys and quaternions turned along the shortest arc. The
structures are those of versions 5.1 and 5.2; later ones have more fields and are refused. Output is that of play.mjs.
"""

import ctypes
import ctypes.util
import json
import sys
from ctypes import POINTER, Structure, c_char, c_char_p, c_double, c_float, c_uint, c_void_p
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp


def fields(**types):
    return list(types.items())


class Text(Structure):
    _fields_ = fields(length=c_uint, data=c_char * 1024)

    def __str__(self):
        return self.data[: self.length].decode()


class Node(Structure):
    pass


Node._fields_ = [
    *fields(name=Text, transformation=c_float * 16, parent=POINTER(Node), children_count=c_uint),
    *fields(children=POINTER(POINTER(Node)), meshes_count=c_uint, meshes=POINTER(c_uint), metadata=c_void_p),
]


class VertexWeight(Structure):
    _fields_ = fields(vertex=c_uint, weight=c_float)


class Bone(Structure):
    _fields_ = fields(name=Text, weights_count=c_uint, armature=POINTER(Node), node=POINTER(Node))
    _fields_ += fields(weights=POINTER(VertexWeight), offset=c_float * 16)


class AnimMesh(Structure):
    _fields_ = fields(name=Text, vertices=POINTER(c_float), others=c_void_p * 19, vertices_count=c_uint, weight=c_float)


class Mesh(Structure):
    _fields_ = fields(primitives=c_uint, vertices_count=c_uint, faces_count=c_uint, vertices=POINTER(c_float))
    _fields_ += fields(others=c_void_p * 19, uv_components=c_uint * 8, faces=c_void_p, bones_count=c_uint)
    _fields_ += fields(bones=POINTER(POINTER(Bone)), material=c_uint, name=Text, anim_meshes_count=c_uint)
    _fields_ += fields(anim_meshes=POINTER(POINTER(AnimMesh)))


VECTOR_KEY = np.dtype([("time", "f8"), ("value", "f4", 3)], align=True)
QUATERNION_KEY = np.dtype([("time", "f8"), ("value", "f4", 4)], align=True)


class NodeChannel(Structure):
    _fields_ = fields(name=Text, positions_count=c_uint, positions=c_void_p, rotations_count=c_uint)
    _fields_ += fields(rotations=c_void_p, scalings_count=c_uint, scalings=c_void_p, states=c_uint * 2)


class MorphKey(Structure):
    _fields_ = fields(time=c_double, values=POINTER(c_uint), weights=POINTER(c_double), count=c_uint)


class MorphChannel(Structure):
    _fields_ = fields(name=Text, keys_count=c_uint, keys=POINTER(MorphKey))


class Animation(Structure):
    _fields_ = fields(name=Text, duration=c_double, ticks=c_double, channels_count=c_uint)
    _fields_ += fields(channels=POINTER(POINTER(NodeChannel)), mesh_channels_count=c_uint, mesh_channels=c_void_p)
    _fields_ += fields(morph_channels_count=c_uint, morph_channels=POINTER(POINTER(MorphChannel)))


class Scene(Structure):
    _fields_ = fields(flags=c_uint, root=POINTER(Node), meshes_count=c_uint, meshes=POINTER(POINTER(Mesh)))
    _fields_ += fields(materials_count=c_uint, materials=c_void_p, animations_count=c_uint)
    _fields_ += fields(animations=POINTER(POINTER(Animation)))


def each(count, pointers):
    return [pointers[index].contents for index in range(count)]


def floats(pointer, count, width):
    return np.ctypeslib.as_array(pointer, (count * width,)).reshape(count, width).astype(np.float64)


def keys(count, address, kind):
    """Return an array of (time, value) structures as (count,) times and (count, width) values."""
    rows = np.frombuffer(ctypes.string_at(address, count * kind.itemsize), kind)
    return rows["time"], rows["value"].astype(np.float64)


def straight(times, values, time):
    """Return a value between keys; before the first and after the last one it is held."""
    return np.array([np.interp(time, times, column) for column in values.T])


def arc(times, quaternions, time):
    """Return a rotation between keys, whose scalars come first."""
    rotations = Rotation.from_quat(np.roll(quaternions, -1, axis=1))
    return Slerp(times, rotations)(np.clip(time, times[0], times[-1])) if len(times) > 1 else rotations[0]


class Player:
    """One animation of a scene: where vertices are at a time."""

    def __init__(self, scene, animation):
        self.meshes = each(scene.meshes_count, scene.meshes)
        self.nodes = []  # depth first: (name, parent, transform, meshes)
        self._collect(scene.root.contents, -1)
        self.number = {name: index for index, (name, *_) in enumerate(self.nodes)}
        self.channels = {
            str(channel.name): (
                keys(channel.positions_count, channel.positions, VECTOR_KEY),
                keys(channel.rotations_count, channel.rotations, QUATERNION_KEY),
                keys(channel.scalings_count, channel.scalings, VECTOR_KEY),
            )
            for channel in each(animation.channels_count, animation.channels)
        }
        self.morphs = {}
        for channel in each(animation.morph_channels_count, animation.morph_channels):
            rows = channel.keys[: channel.keys_count]
            if any(row.values[: row.count] != [*range(row.count)] for row in rows):
                raise SystemExit(f"{channel.name}: morph keys that leave targets out")
            weights = np.array([row.weights[: row.count] for row in rows])
            self.morphs[str(channel.name)] = [row.time for row in rows], weights
        self.base = [floats(mesh.vertices, mesh.vertices_count, 3) for mesh in self.meshes]
        self.targets = [each(mesh.anim_meshes_count, mesh.anim_meshes) for mesh in self.meshes]
        self.moves = [
            np.array([floats(target.vertices, target.vertices_count, 3) - base for target in targets])
            for targets, base in zip(self.targets, self.base, strict=True)
        ]
        self.bones = [self._bones(mesh) for mesh in self.meshes]

    def _collect(self, node, parent):
        own = len(self.nodes)
        transform = np.array(node.transformation, dtype=np.float64).reshape(4, 4)
        self.nodes.append((str(node.name), parent, transform, list(node.meshes[: node.meshes_count])))
        for child in each(node.children_count, node.children):
            self._collect(child, own)

    def _bones(self, mesh):
        """Return each bone's name, offset matrix, vertices and their weights."""
        found = []
        for bone in each(mesh.bones_count, mesh.bones):
            weights = bone.weights[: bone.weights_count]
            vertices = np.array([weight.vertex for weight in weights], dtype=int)
            shares = np.array([weight.weight for weight in weights], dtype=np.float64)
            found.append((str(bone.name), np.array(bone.offset, dtype=np.float64).reshape(4, 4), vertices, shares))
        return found

    def to_world(self, ticks):
        matrices = []
        for name, parent, transform, _ in self.nodes:
            local = transform
            if name in self.channels:
                positions, rotations, scalings = self.channels[name]
                local = np.eye(4)
                local[:3, :3] = arc(*rotations, ticks).as_matrix() * straight(*scalings, ticks)
                local[:3, 3] = straight(*positions, ticks)
            matrices.append(local if parent < 0 else matrices[parent] @ local)
        return matrices

    def positions(self, node, mesh, ticks, matrices):
        name = self.nodes[node][0]
        local = self.base[mesh]
        if len(self.moves[mesh]):
            weights = [target.weight for target in self.targets[mesh]]
            if name in self.morphs:
                weights = straight(*self.morphs[name], ticks)
            local = local + np.tensordot(weights, self.moves[mesh], axes=1)
        padded = np.column_stack([local, np.ones(len(local))])
        if not self.bones[mesh]:
            return (padded @ matrices[node].T)[:, :3]
        shown = np.zeros_like(padded)
        for name, offset, vertices, shares in self.bones[mesh]:
            shown[vertices] += shares[:, None] * (padded[vertices] @ (matrices[self.number[name]] @ offset).T)
        return shown[:, :3]


def main():
    file, count, base = sys.argv[1], int(sys.argv[2]), sys.argv[3]
    library = ctypes.CDLL(ctypes.util.find_library("assimp") or "libassimp.so.5")
    library.aiImportFile.restype, library.aiGetErrorString.restype = POINTER(Scene), c_char_p
    imported = library.aiImportFile(str(file).encode(), 0)
    if not imported:
        raise SystemExit(f"{file}: {library.aiGetErrorString().decode()}")
    scene = imported.contents
    animation = scene.animations[0].contents
    player = Player(scene, animation)

    shown = [(node, place, mesh) for node, (*_, meshes) in enumerate(player.nodes) for place, mesh in enumerate(meshes)]
    end = animation.duration
    blocks = [[] for _ in shown]
    for ticks in np.linspace(0, end, count):
        matrices = player.to_world(ticks)
        for block, (node, _, mesh) in zip(blocks, shown, strict=True):
            block.append(player.positions(node, mesh, ticks, matrices))
    described, start = [], 0
    with Path(f"{base}.bin").open("wb") as binary:
        for block, (node, place, mesh) in zip(blocks, shown, strict=True):
            described.append(
                {"node": player.nodes[node][0], "primitive": place, "count": len(player.base[mesh]), "positions": start}
            )
            binary.write(np.array(block, "<f4").tobytes())
            start += np.size(block)
    report = {"times": np.linspace(0, end / animation.ticks, count).tolist(), "meshes": described}
    Path(f"{base}.json").write_text(json.dumps(report), encoding="utf-8")


main()
