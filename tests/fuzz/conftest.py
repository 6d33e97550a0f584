"""Character files to damage, ways to damage them, and the road that what comes of them must go or be refused on.

``PUPPETLINE_FUZZ=20`` damages twenty times as many files as otherwise, the same ones first.
"""

import base64
import io
import json
import math
import re
import signal
import struct
import zlib
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from PIL import Image

from engine_bridge.character.character import load_character
from engine_bridge.cli.inspection import inspect
from engine_bridge.export.animation import Keyframes, animate
from puppetline.errors import PuppetlineError

from ..effort import EFFORT

RAW = "\ue000"
"""Begins a string that goes into JSON as it is, without quotes."""

HOSTILE = (
    *(-1, 0, 1, 2, 7, 255, 65536, 2**31, 2**32, 2**53, 2**62, 2**63, 2**64, 10**30, 10**400, -(2**63)),
    *(0.5, -0.0, 1e-320, 1e-30, 1e30, 1e39, 1e154, 1e300, -1e308),
    *(None, True, False, "", "text", "\ud800", "\0", "data:,", "..", ".", "https://a/b", "é" * 5000, "%00", "9" * 5000),
    *([], {}, [1], [[0]], [None], {"": 0}, [0] * 16, [1e300] * 16, [0] * 4, [1e-200] * 4, [1e-200] * 3, [0] * 4000),
    *(RAW + text for text in ("NaN", "-Infinity", "1e999", "9" * 4000, '{"a":1,"a":[]}', "[" * 500 + "]" * 500)),
)

LAYOUT = (
    *("byteOffset", "byteLength", "byteStride", "count", "componentType", "type", "bufferView", "buffer", "normalized"),
    *("indices", "material", "mode", "mesh", "skin", "joints", "inverseBindMatrices", "input", "output", "sampler"),
    *("source", "index", "texCoord", "POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0", "JOINTS_0", "WEIGHTS_0"),
)
"""Names of values that say where arrays lie and what they are for."""

NEAR = (-4, -1, 1, 4, 1000, 2**31, 2**63)
"""What is added to them."""

FLOATS = np.array(
    [np.nan, np.inf, -np.inf, 0, -0.0, 1e-45, 1e-38, 1e-30, 1e-20, 1e18, 1e30, 3e38, -3e38, 1, -1], np.float32
)

WORDS = (
    b"nan -inf 1e999 1e30 1e-30 1e-320 -0 0 -1 1 3 4 2147483648 4294967296 9223372036854775808 1_0 0x10 1/2/3 1//1 //"
    b" -99/-99/-99 999999999999999999999 1.5 . - + / # \\ v f vt vn vertex face facet endfacet loop element property"
    b" list uchar char int uint float double end_header ascii binary_little_endian OFF STL solid usemtl mtllib map_Kd"
).split(b" ")
"""What stands, or should not stand, in mesh files of text."""


@dataclass
class Parts:
    """A glTF file being put together: a description and its bytes."""

    gltf: dict[str, Any]
    binary: bytes = b""

    def __post_init__(self):
        self.gltf = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], **self.gltf}

    def view(self, content, **more):
        self.binary += bytes(-len(self.binary) % 4)
        self.gltf["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content), **more}
        )
        self.binary += content
        return len(self.gltf["bufferViews"]) - 1

    def add(self, array, stride=None, **more):
        rows = array.reshape(len(array), -1)
        accessor = {
            "bufferView": self.view(rows.tobytes(), **({"byteStride": stride} if stride else {})),
            "componentType": {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}[
                array.dtype.str[1:]
            ],
            "count": len(rows),
            "type": {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}[rows.shape[1]],
        }
        self.gltf["accessors"].append({**accessor, **more})
        return len(self.gltf["accessors"]) - 1

    def glb(self):
        self.gltf["buffers"] = [{"byteLength": len(self.binary)}]
        return pack(self.gltf, self.binary)


def pack(gltf, binary):
    """Make a .glb of its description and its bytes."""
    text = text_of(gltf)
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def unpack(content):
    """Split a .glb into its description and its bytes."""
    size = int.from_bytes(content[12:16], "little")
    return json.loads(content[20 : 20 + size]), content[28 + size :]


def text_of(gltf):
    """Write JSON, and what stands behind `RAW` as it is."""
    quoted = rf'"\\u{ord(RAW):x}((?:[^"\\]|\\.)*)"'
    return re.sub(quoted, lambda match: json.loads(f'"{match[1]}"'), json.dumps(gltf)).encode()


def ball(rings=4, around=6):
    """A sphere: (n, 3) float32 unit positions, (t, 3) uint16 triangles."""
    height = np.linspace(0, np.pi, rings + 2)[1:-1, None]
    turn = np.linspace(0, 2 * np.pi, around, endpoint=False)
    side = np.stack(np.broadcast_arrays(np.sin(height) * np.cos(turn), np.cos(height), np.sin(height) * np.sin(turn)))
    points = np.vstack([[0, 1, 0], side.reshape(3, -1).T, [0, -1, 0]]).astype(np.float32)
    last, faces = len(points) - 1, []
    for a in range(around):
        b = (a + 1) % around
        faces += [[0, 1 + b, 1 + a], [last, last - around + a, last - around + b]]
        for start in range(1, last - around, around):
            faces += [[start + a, start + b, start + around + b], [start + a, start + around + b, start + around + a]]
    return points, np.array(faces, np.uint16)


def picture(kind="PNG"):
    """A small picture's file."""
    file = io.BytesIO()
    Image.fromarray((np.indices((8, 8)).sum(0) % 2 * 255).astype(np.uint8)).save(file, kind)
    return file.getvalue()


def textured():
    """Every attribute that a picture is made of, and a texture inside."""
    points, faces = ball()
    parts = Parts({"scene": 0, "scenes": [{"nodes": [0]}], "extensionsUsed": ["KHR_materials_unlit"]})
    attributes = {
        "POSITION": parts.add(points, min=[-1, -1, -1], max=[1, 1, 1]),
        "NORMAL": parts.add(points),
        "TEXCOORD_0": parts.add(points[:, :2].copy()),
        "COLOR_0": parts.add(np.full((len(points), 4), 128, np.uint8), normalized=True),
    }
    surface = {"baseColorFactor": [1, 0.5, 0, 1], "baseColorTexture": {"index": 0, "texCoord": 0}}
    parts.gltf |= {
        "images": [{"bufferView": parts.view(picture()), "mimeType": "image/png"}],
        "samplers": [{}],
        "textures": [{"source": 0, "sampler": 0}],
        "materials": [{"name": "skin", "pbrMetallicRoughness": surface, "extensions": {"KHR_materials_unlit": {}}}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": parts.add(faces.ravel()), "material": 0}]}],
        "nodes": [{"name": "body", "mesh": 0, "extras": {"who": ["made", {"it": None}]}}],
    }
    return parts.glb()


def skinned():
    """Two bones that bend a ball, a hat on one of them, and an animation of the bones."""
    points, faces = ball()
    share = np.clip(points[:, 1], 0, 1)
    parts = Parts({"scene": 0, "scenes": [{"nodes": [0, 2]}]})
    attributes = {
        "POSITION": parts.add(points),
        "NORMAL": parts.add(points),
        "JOINTS_0": parts.add(np.tile(np.uint8([0, 1, 0, 0]), (len(points), 1))),
        "WEIGHTS_0": parts.add(np.column_stack([1 - share, share, 0 * share, 0 * share]).astype(np.float32)),
    }
    indices = parts.add(faces.ravel())
    hat = {"POSITION": attributes["POSITION"]}
    clock = parts.add(np.float32([0, 1]), min=[0], max=[1])
    turn = parts.add(np.float32([[0, 0, 0, 1], [0.6, 0, 0, 0.8]]))
    parts.gltf |= {
        "meshes": [
            {"primitives": [{"attributes": attributes, "indices": indices}]},
            {"name": "hat", "primitives": [{"attributes": hat, "indices": indices}]},
        ],
        "skins": [
            {
                "joints": [0, 1],
                "skeleton": 0,
                "inverseBindMatrices": parts.add(np.tile(np.eye(4, dtype="f4"), (2, 1, 1))),
            }
        ],
        "nodes": [
            {"name": "hip", "translation": [0, 1, 0], "rotation": [0, 0, 0.6, 0.8], "children": [1]},
            {"name": "chest", "scale": [1, 2, 1.5], "children": [3, 4]},
            {"name": "body", "mesh": 0, "skin": 0},
            {"mesh": 1, "matrix": [0.5, 0, 0, 0, 0, -0.5, 0, 0, 0, 0, 0.5, 0, 0, 1, 0, 1]},
            {"mesh": 1, "translation": [3, 0, 0]},
        ],
        "animations": [
            {
                "channels": [{"sampler": 0, "target": {"node": 1, "path": "rotation"}}],
                "samplers": [{"input": clock, "output": turn, "interpolation": "LINEAR"}],
            }
        ],
    }
    return parts.glb()


def packed():
    """Quantised and sparse arrays, a strip, a fan and points, and morph targets of its own that move."""
    points, faces = ball()
    stored = np.zeros((len(points), 4), np.int16)
    stored[:, :3] = np.round(points * 32767)
    parts = Parts({"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]})
    position = parts.add(stored, stride=8, normalized=True)
    normal = parts.add(np.pad(np.round(points * 127).astype(np.int8), ((0, 0), (0, 1))), stride=4, normalized=True)
    count = len(points)
    rows, moved = parts.view(np.uint16([0, 5]).tobytes()), parts.view(np.float32([[0, 1, 0], [1, 0, 0]]).tobytes())
    sparse = {"count": 2, "indices": {"bufferView": rows, "componentType": 5123}, "values": {"bufferView": moved}}
    for index in (position, normal):
        parts.gltf["accessors"][index]["type"] = "VEC3"
    parts.gltf["accessors"].append({"componentType": 5126, "count": count, "type": "VEC3", "sparse": sparse})
    attributes, target = {"POSITION": position, "NORMAL": normal}, {"POSITION": len(parts.gltf["accessors"]) - 1}
    strip = faces[:, [0, 0, 0, 1, 2, 2]].ravel()
    fan = np.uint16([0, *range(6, 0, -1), 6])
    clock, keys = parts.add(np.float32([0, 1]), max=[1.0]), parts.add(np.float32([0, 0, 1, 0.5]))
    parts.gltf |= {
        "meshes": [
            {
                "primitives": [
                    {"attributes": attributes, "indices": parts.add(strip), "mode": 5, "targets": [target, target]},
                    {"attributes": attributes, "indices": parts.add(fan), "mode": 6, "targets": [target, target]},
                    {"attributes": attributes, "mode": 0, "targets": [target, target]},
                ],
                "weights": [0.5, 0.25],
                "extras": {"targetNames": ["up", "down"]},
            }
        ],
        "nodes": [{"mesh": 0, "scale": [2, 2, 2], "weights": [0.25, 0]}],
        "animations": [
            {
                "name": "nod",
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}],
                "samplers": [{"input": clock, "output": keys}],
            }
        ],
    }
    return parts.glb()


def apart():
    """A .gltf without indices, its bytes in data URIs and in files beside it (`BESIDE`)."""
    points, faces = ball()
    corners = points[faces.ravel()]
    gltf, _ = unpack(textured())
    gltf["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]
    gltf["accessors"] = [
        {"bufferView": 0, "componentType": 5126, "count": len(corners), "type": "VEC3"},
        {"bufferView": 1, "componentType": 5126, "count": len(corners), "type": "VEC2"},
    ]
    gltf["buffers"] = [
        {"byteLength": corners.nbytes, "uri": "data:application/octet-stream;base64," + b64(corners.tobytes())},
        {"byteLength": len(BESIDE["uv.bin"]), "uri": "uv.bin"},
    ]
    gltf["bufferViews"] = [
        {"buffer": index, "byteLength": buffer["byteLength"]} for index, buffer in enumerate(gltf["buffers"])
    ]
    gltf["images"] = [{"uri": "data:image/png;base64," + b64(picture())}, {"uri": "my%20skin.jpg", "name": "skin"}]
    gltf["textures"] = [{"source": 0}, {"source": 1}]
    return text_of(gltf)


def b64(content):
    return base64.b64encode(content).decode()


BESIDE = {
    "uv.bin": np.ascontiguousarray(ball()[0][ball()[1].ravel()][:, :2]).tobytes(),
    "my skin.jpg": picture("JPEG"),
    "skin.mtl": b"newmtl skin\nKd 1 0.5 0\nd 0.5\nNs 20\nmap_Kd -s 1 1 1 my skin.jpg\nmap_Bump none.png\n",
}
"""Files that others name."""


def obj():
    points, faces = ball()
    lines = ["mtllib skin.mtl", "o body", *("v {} {} {} 1 0.5 0".format(*point) for point in points.tolist())]
    lines += [*("vt {} {}".format(*point[:2]) for point in points.tolist()), "vn 0 1 0", "usemtl skin", "g \\", "front"]
    lines += ["f " + " ".join(f"{i + 1}/{i + 1}/1" for i in face) for face in faces[::2].tolist()]
    lines += ["usemtl other", *("f " + " ".join(str(i - len(points)) for i in face) for face in faces[1::2].tolist())]
    return "\n".join([*lines, "f 1 2 3 4 5 # a polygon", "l 1 2", ""]).encode()


def off():
    points, faces = ball()
    lines = ["OFF", "# a comment", f"{len(points)} {len(faces)} 0", *("{} {} {}".format(*p) for p in points.tolist())]
    return "\n".join([*lines, *("3 {} {} {} 255 0 0".format(*face) for face in faces.tolist()), ""]).encode()


def ply(kind):
    points, faces = ball()
    header = f"ply\nformat {kind} 1.0\ncomment made here\nelement vertex {len(points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz") + "property uchar red\nproperty uchar green\n"
    header += f"property uchar blue\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    if kind == "ascii":
        lines = ["{} {} {} 255 128 0".format(*point) for point in points.tolist()]
        return (header + "\n".join([*lines, *("3 {} {} {}".format(*face) for face in faces.tolist()), ""])).encode()
    order = "<" if kind == "binary_little_endian" else ">"
    vertices = b"".join(struct.pack(f"{order}3f3B", *point, 255, 128, 0) for point in points.tolist())
    return header.encode() + vertices + b"".join(struct.pack(f"{order}B3i", 3, *face) for face in faces.tolist())


def stl():
    points, faces = ball()
    triangles = [struct.pack("<12fH", 0, 0, 0, *points[face].ravel(), 0) for face in faces]
    return bytes(80) + struct.pack("<I", len(triangles)) + b"".join(triangles)


def text_stl():
    points, faces = ball()
    lines = ["solid ball"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop", *("vertex {} {} {}".format(*p) for p in points[face].tolist())]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid ball", ""]).encode()


CORPUS = {
    "textured.glb": textured(),
    "skinned.glb": skinned(),
    "packed.glb": packed(),
    "apart.gltf": apart(),
    "a.obj": obj(),
    "a.off": off(),
    "text.ply": ply("ascii"),
    "little.ply": ply("binary_little_endian"),
    "big.ply": ply("binary_big_endian"),
    "binary.stl": stl(),
    "text.stl": text_stl(),
}
"""Small files that have, between them, all that is read."""


def bytes_damaged(rng, content, others=()):
    """Flip, set, insert, delete or repeat bytes, or go on with the end of another file, which may be nothing."""
    content = bytearray(content)
    for _ in range(rng.geometric(0.6)):
        place = int(rng.integers(len(content) + 1))
        run = int(rng.integers(1, 33))
        match rng.integers(8):
            case 0:
                content[place : place + 1] = rng.choice([b"\0", b"\1", b"\n", b" ", b"-", b"0", b"9", b"\x80", b"\xff"])
            case 1:
                content[place:place] = rng.bytes(run)
            case 2:
                del content[place : place + run]
            case 3:
                content[place:place] = content[place : place + 8 * run]
            case 4 if others and rng.integers(3) == 0:
                other = others[rng.integers(len(others))]
                content[place:] = other[int(rng.integers(len(other) + 1)) :]
            case 5:
                content[place & ~3 : (place & ~3) + 4] = FLOATS[rng.integers(len(FLOATS))].tobytes()
            case 6:
                whole = int(rng.choice([0, 1, 3, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1])).to_bytes(4, "little")
                content[place : place + 4] = whole
            case _ if place < len(content):
                content[place] ^= 1 << int(rng.integers(8))
    return bytes(content)


def words_damaged(rng, content, others=()):
    """Replace, repeat, drop or swap words of a text, or of a header before bytes."""
    text, header_end, rest = content.partition(b"end_header")
    words = re.split(rb"(\s+)", text)
    for _ in range(rng.geometric(0.6)):
        place = min(int(rng.integers(len(words) // 2 + 1)) * 2, len(words) - 1)
        match rng.integers(5):
            case 0 | 1:
                words[place] = WORDS[rng.integers(len(WORDS))]
            case 2:
                words[place : place + 2] = words[place : place + 2] * int(rng.choice([2, 3, 300]))
            case 3:
                del words[place : place + 2]
            case 4:
                other = int(rng.integers(len(words) // 2)) * 2 if len(words) > 1 else 0
                words[place], words[other] = words[other], words[place]
        words = words or [b""]
    return b"".join(words) + header_end + rest


def places(value, path=()):
    """Every place in nested JSON: the container and the key in it."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in list(items):
        yield value, key
        yield from places(item)


def described_otherwise(rng, gltf):
    """Replace, remove, repeat or copy values anywhere in a description."""
    for _ in range(rng.geometric(0.6)):
        found = list(places(gltf))
        if not found:
            break
        inner, key = found[rng.integers(len(found))]
        other, elsewhere = found[rng.integers(len(found))]
        match rng.integers(8):
            case 0:
                del inner[key]
            case 1 if isinstance(inner, list):
                inner[key:key] = [deepcopy(inner[key])] * int(rng.choice([1, 2, 100]))
            case 2:
                inner[key] = deepcopy(other[elsewhere])
            case 3 | 4:
                inner[key] = deepcopy(HOSTILE[rng.integers(len(HOSTILE))])
            case _:
                alike = [value for value in HOSTILE if type(value) is type(inner[key])] or HOSTILE
                inner[key] = deepcopy(alike[rng.integers(len(alike))])


def laid_out_otherwise(rng, gltf):
    """Change numbers that say where arrays lie, how long they are, what they hold and what they are for."""
    found = [(inner, key) for inner, key in places(gltf) if key in LAYOUT and not isinstance(inner[key], list | dict)]
    for _ in range(rng.geometric(0.6)):
        inner, key = found[rng.integers(len(found))]
        if key == "type":
            inner[key] = str(rng.choice(["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]))
        elif key == "componentType":
            inner[key] = int(rng.integers(5119, 5128))
        elif rng.integers(2) and not isinstance(inner[key], str):
            inner[key] = max(0, inner[key] + NEAR[rng.integers(len(NEAR))])
        else:
            inner[key] = int(rng.choice([0, 1, 2, 3, 4, 5, 6, 8, 252]))
    views = gltf.get("bufferViews", [])
    if views and rng.integers(4) == 0:
        views[rng.integers(len(views))]["byteStride"] = int(rng.choice([0, 1, 2, 4, 12, 16, 252, 2**40]))


def gltf_damaged(change):
    """Damage the description of a .glb or .gltf."""

    def damaged(rng, content, others=()):
        is_binary = content[:4] == b"glTF"
        gltf, binary = unpack(content) if is_binary else (json.loads(content), b"")
        change(rng, gltf)
        return pack(gltf, binary) if is_binary else text_of(gltf)

    return damaged


def arrays_damaged(rng, content, others=()):
    """Damage only the bytes behind the description of a .glb, without changing their number."""
    gltf, binary = unpack(content)
    values = bytearray(binary)
    for _ in range(rng.geometric(0.6)):
        place = int(rng.integers(len(values) // 4)) * 4
        match rng.integers(3):
            case 0:
                values[place : place + 4] = FLOATS[rng.integers(len(FLOATS))].tobytes()
            case 1:
                values[place : place + 4] = rng.bytes(4)
            case 2:
                span = int(rng.choice([4, 12, 48, 400])) // 4
                some = FLOATS[rng.integers(len(FLOATS), size=span)].tobytes()[: len(values) - place]
                values[place : place + len(some)] = some
    return pack(gltf, bytes(values))


DAMAGES = {
    "bytes": bytes_damaged,
    "words": words_damaged,
    "values": gltf_damaged(described_otherwise),
    "layout": gltf_damaged(laid_out_otherwise),
    "arrays": arrays_damaged,
}


def of_kind(name):
    """The ways that make sense for a kind of file."""
    ending = name.rpartition(".")[2].lower()
    return {
        "glb": ("bytes", "values", "layout", "arrays"),
        "gltf": ("bytes", "values", "layout"),
        "obj": ("bytes", "words"),
        "off": ("bytes", "words"),
        "ply": ("bytes", "words"),
        "stl": ("bytes",) if name == "binary.stl" else ("bytes", "words"),
    }[ending]


STILL = Keyframes("still", np.float32([0, 1]), np.zeros((2, 1), np.float32), np.zeros((2, 3), np.float32))


def go_all_the_way(path):
    """Read a file, look at it, weld it, animate it without moving it, write it, and read that again.

    What was written must hold the same character.
    """
    character = load_character(path)
    colors = character.colors
    assert colors is None or colors.shape == character.vertices.shape
    mesh = character.solver_mesh()
    json.dumps(inspect(path)).encode()
    still = [(np.zeros((1, *part.vertices.shape), np.float32), None) for part in character.parts]
    made = path.with_name("made.glb")
    animate(character, STILL, still.__getitem__).save(made)
    try:
        again = load_character(made)
    except PuppetlineError as error:
        raise AssertionError("what was written cannot be read") from error
    np.testing.assert_array_equal(again.vertices, character.vertices)
    np.testing.assert_array_equal(again.triangles, character.triangles)
    np.testing.assert_array_equal(again.solver_mesh().vertices, mesh.vertices)
    return character


@contextmanager
def no_hang(seconds=120):
    """Turn a road without end into a failure."""

    def stop(number, frame):
        raise TimeoutError(f"no end after {seconds} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="session")
def go():
    return go_all_the_way


@pytest.fixture(scope="session")
def try_damaged():
    """Damage a file in one way, the same each time, and take each on a road; count what came of it.

    This is done `count` times, or with less effort until each outcome has come about `enough` times.
    """

    def run(path, kind, count, enough, road=go_all_the_way):
        name, content, others = path.name, path.read_bytes(), list(CORPUS.values())
        outcomes = {"read": 0, "refused": 0}
        for number in range(math.ceil(count * max(1, EFFORT))):
            if number >= count * EFFORT and min(outcomes.values()) >= enough:
                break
            rng = np.random.default_rng([zlib.crc32(f"{name} {kind}".encode()), number])
            path.write_bytes(DAMAGES[kind](rng, content, others))
            try:
                with no_hang():
                    road(path)
                outcomes["read"] += 1
            except PuppetlineError:
                outcomes["refused"] += 1
            except Exception as error:
                pytest.fail(f"{path} ({kind}, number {number}): {type(error).__name__}: {error}")
        return outcomes

    return run


@pytest.fixture
def folder(tmp_path):
    """A folder with all that the files of the corpus name."""
    for name, content in BESIDE.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


@pytest.fixture(params=CORPUS)
def whole(request, folder):
    """Each file of the corpus, undamaged."""
    (folder / request.param).write_bytes(CORPUS[request.param])
    return folder / request.param


@pytest.fixture(params=[(name, kind) for name in CORPUS for kind in of_kind(name)], ids="-".join)
def corpus_and_kind(request, folder):
    """Each file of the corpus with each way to damage it."""
    name, kind = request.param
    (folder / name).write_bytes(CORPUS[name])
    return folder / name, kind


@dataclass(frozen=True)
class Kit:
    """What hostile files are made with."""

    corpus: dict
    raw: str

    pack = staticmethod(pack)
    of_kind = staticmethod(of_kind)

    def parts(self, name):
        """The description of a .glb of the corpus, which may be changed, and its bytes."""
        return unpack(self.corpus[name])


@pytest.fixture(scope="session")
def kit():
    return Kit(CORPUS, RAW)
