"""Small character files that together contain everything that the readers support, and functions that build them."""

import base64
import io
import json
import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image

RAW_JSON = "\ue000"
"""Prefix of a string that `text_of` writes without quotes."""


@dataclass
class Parts:
    """A glTF file under construction: its description and its bytes."""

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
    """Return the .glb of a description and its bytes."""
    text = text_of(gltf)
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def unpack(content):
    """Return the description and the bytes of a .glb."""
    size = int.from_bytes(content[12:16], "little")
    return json.loads(content[20 : 20 + size]), content[28 + size :]


def text_of(gltf):
    """Return JSON, in which strings that begin with `RAW_JSON` have no quotes."""
    quoted = rf'"\\u{ord(RAW_JSON):x}((?:[^"\\]|\\.)*)"'
    return re.sub(quoted, lambda match: json.loads(f'"{match[1]}"'), json.dumps(gltf)).encode()


def ball(rings=4, around=6):
    """Return a sphere: (n, 3) float32 unit positions and (t, 3) uint16 triangles."""
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
    """Return the file of a small picture."""
    file = io.BytesIO()
    Image.fromarray((np.indices((8, 8)).sum(0) % 2 * 255).astype(np.uint8)).save(file, kind)
    return file.getvalue()


def textured():
    """Return a .glb with all attributes that affect a picture, and a texture."""
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
    """Return a .glb with a ball that two bones bend, a hat on one of them, and an animation of the bones."""
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
    """Return a .glb with quantised and sparse arrays, a strip, a fan, points, and animated morph targets."""
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
    """Return a .gltf without indices whose bytes are in data URIs and in `SIDE_FILES`."""
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
        {"byteLength": len(SIDE_FILES["uv.bin"]), "uri": "uv.bin"},
    ]
    gltf["bufferViews"] = [
        {"buffer": index, "byteLength": buffer["byteLength"]} for index, buffer in enumerate(gltf["buffers"])
    ]
    gltf["images"] = [{"uri": "data:image/png;base64," + b64(picture())}, {"uri": "my%20skin.jpg", "name": "skin"}]
    gltf["textures"] = [{"source": 0}, {"source": 1}]
    return text_of(gltf)


def b64(content):
    return base64.b64encode(content).decode()


SIDE_FILES = {
    "uv.bin": np.ascontiguousarray(ball()[0][ball()[1].ravel()][:, :2]).tobytes(),
    "my skin.jpg": picture("JPEG"),
    "skin.mtl": b"newmtl skin\nKd 1 0.5 0\nd 0.5\nNs 20\nmap_Kd -s 1 1 1 my skin.jpg\nmap_Bump none.png\n",
}
"""Files that files of the corpus refer to."""


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
"""The files by name."""
