"""Small character files that together contain everything that the readers support, and functions that build them."""

import base64
import json
import re
import struct

import numpy as np
import pygltflib as gltf
import trimesh
from PIL import Image

from ..engine_bridge.conftest import Glb, encoded

RAW_JSON = "\ue000"
"""Prefix of a string that `text_of` writes without quotes."""

BALL = trimesh.creation.icosphere(subdivisions=1)
COLOURED = trimesh.Trimesh(BALL.vertices, BALL.faces, vertex_colors=[255, 128, 0])
POINTS, FACES = BALL.vertices.astype(np.float32), BALL.faces.astype(np.uint16)


def glb_of(made):
    """Return the bytes of a .glb that was put together by hand."""
    made.file.buffers = [gltf.Buffer(byteLength=len(made.blob))]
    made.file.set_binary_blob(made.blob)
    return b"".join(made.file.save_to_bytes())


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


def picture(kind="PNG"):
    """Return the file of a small picture."""
    return encoded(Image.fromarray((np.indices((8, 8)).sum(0) % 2 * 255).astype(np.uint8)), kind)


def textured():
    """Return a .glb with all attributes that affect a picture, and a texture."""
    made = Glb()
    colors = np.full((len(POINTS), 4), 128, np.uint8)
    primitive = made.primitive(POINTS, FACES, material=0, NORMAL=POINTS, TEXCOORD_0=POINTS[:, :2], COLOR_0=colors)
    made.node(made.mesh(primitive), name="body", extras={"who": ["made", {"it": None}]})
    made.file.extensionsUsed = ["KHR_materials_unlit"]
    made.file.images = [gltf.Image(bufferView=made.view(picture()), mimeType="image/png")]
    made.file.samplers = [gltf.Sampler()]
    made.file.textures = [gltf.Texture(source=0, sampler=0)]
    surface = gltf.PbrMetallicRoughness(baseColorFactor=[1, 0.5, 0, 1], baseColorTexture=gltf.TextureInfo(index=0))
    unlit = {"KHR_materials_unlit": {}}
    made.file.materials = [gltf.Material(name="skin", pbrMetallicRoughness=surface, extensions=unlit)]
    return glb_of(made)


def animate(made, node, path, values):
    """Add an animation of two keys."""
    clock, output = (made.add(np.float32(each), target=None) for each in ([0, 1], values))
    channel = gltf.AnimationChannel(sampler=0, target=gltf.AnimationChannelTarget(node=node, path=path))
    sampler = gltf.AnimationSampler(input=clock, output=output)
    made.file.animations = [gltf.Animation(name="nod", channels=[channel], samplers=[sampler])]


def skinned():
    """Return a .glb with a ball that two bones bend, a hat on one of them, and an animation of the bones."""
    made, share = Glb(), np.clip(POINTS[:, 1], 0, 1)
    joints = np.tile(np.uint8([0, 1, 0, 0]), (len(POINTS), 1))
    weights = np.column_stack([1 - share, share, 0 * share, 0 * share])
    body = made.primitive(POINTS, FACES, NORMAL=POINTS, WEIGHTS_0=weights)
    body.attributes.JOINTS_0 = made.add(joints)
    hat = gltf.Primitive(attributes=gltf.Attributes(POSITION=body.attributes.POSITION), indices=body.indices)
    hip = made.node(name="hip", translation=[0, 1, 0], rotation=[0, 0, 0.6, 0.8])
    chest = made.node(parent=hip, name="chest", scale=[1, 2, 1.5])
    made.node(made.mesh(body), name="body", skin=0)
    made.node(made.mesh(hat, name="hat"), chest, matrix=[0.5, 0, 0, 0, 0, -0.5, 0, 0, 0, 0, 0.5, 0, 0, 1, 0, 1])
    made.node(1, chest, translation=[3, 0, 0])
    bind = made.add(np.tile(np.eye(4, dtype="f4"), (2, 1, 1)), target=None)
    made.file.skins = [gltf.Skin(joints=[hip, chest], skeleton=hip, inverseBindMatrices=bind)]
    animate(made, chest, "rotation", [[0, 0, 0, 1], [0.6, 0, 0, 0.8]])
    return glb_of(made)


def packed():
    """Return a .glb with quantised and sparse arrays, a strip, a fan, points, and animated morph targets."""
    made = Glb()
    made.file.extensionsUsed = made.file.extensionsRequired = ["KHR_mesh_quantization"]
    position = made.add(np.round(POINTS * 32767).astype(np.int16), normalized=True)
    normal = made.add(np.round(POINTS * 127).astype(np.int8), normalized=True)
    rows, moved = made.view(np.uint16([0, 5]).tobytes()), made.view(np.float32([[0, 1, 0], [1, 0, 0]]).tobytes())
    sparse = gltf.Sparse(
        count=2,
        indices=gltf.AccessorSparseIndices(bufferView=rows, componentType=5123),
        values=gltf.AccessorSparseValues(bufferView=moved),
    )
    made.file.accessors.append(gltf.Accessor(componentType=5126, count=len(POINTS), type="VEC3", sparse=sparse))
    target = gltf.Attributes(POSITION=len(made.file.accessors) - 1)
    arrays = {"attributes": gltf.Attributes(POSITION=position, NORMAL=normal), "targets": [target, target]}
    strip, fan = FACES[:, [0, 0, 0, 1, 2, 2]].ravel(), np.arange(6, dtype=np.uint16)
    indices = {5: made.add(strip, gltf.ELEMENT_ARRAY_BUFFER), 6: made.add(fan, gltf.ELEMENT_ARRAY_BUFFER), 0: None}
    pieces = [gltf.Primitive(**arrays, indices=which, mode=mode) for mode, which in indices.items()]
    mesh = made.mesh(*pieces, weights=[0.5, 0.25], extras={"targetNames": ["up", "down"]})
    animate(made, made.node(mesh, scale=[2, 2, 2]), "weights", [0, 0, 1, 0.5])
    file, binary = unpack(glb_of(made))
    file["nodes"][0]["weights"] = [0.25, 0]
    return pack(file, binary)


def apart():
    """Return a .gltf without indices whose bytes are in data URIs and in `SIDE_FILES`."""
    corners = POINTS[FACES.ravel()]
    file, _ = unpack(textured())
    file["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]
    file["accessors"] = [
        {"bufferView": 0, "componentType": 5126, "count": len(corners), "type": "VEC3"},
        {"bufferView": 1, "componentType": 5126, "count": len(corners), "type": "VEC2"},
    ]
    file["buffers"] = [
        {"byteLength": corners.nbytes, "uri": "data:application/octet-stream;base64," + b64(corners.tobytes())},
        {"byteLength": len(SIDE_FILES["uv.bin"]), "uri": "uv.bin"},
    ]
    file["bufferViews"] = [
        {"buffer": index, "byteLength": buffer["byteLength"]} for index, buffer in enumerate(file["buffers"])
    ]
    file["images"] = [{"uri": "data:image/png;base64," + b64(picture())}, {"uri": "my%20skin.jpg", "name": "skin"}]
    file["textures"] = [{"source": 0}, {"source": 1}]
    return text_of(file)


def b64(content):
    return base64.b64encode(content).decode()


SIDE_FILES = {
    "uv.bin": POINTS[FACES.ravel(), :2].tobytes(),
    "my skin.jpg": picture("JPEG"),
    "skin.mtl": b"newmtl skin\nKd 1 0.5 0\nd 0.5\nNs 20\nmap_Kd -s 1 1 1 my skin.jpg\nmap_Bump none.png\n",
}
"""Files that files of the corpus refer to."""


def obj():
    lines = ["mtllib skin.mtl", "o body", *("v {} {} {} 1 0.5 0".format(*point) for point in POINTS.tolist())]
    lines += [*("vt {} {}".format(*point[:2]) for point in POINTS.tolist()), "vn 0 1 0", "usemtl skin", "g \\", "front"]
    lines += ["f " + " ".join(f"{i + 1}/{i + 1}/1" for i in face) for face in FACES[::2].tolist()]
    lines += ["usemtl other", *("f " + " ".join(str(i - len(POINTS)) for i in face) for face in FACES[1::2].tolist())]
    return "\n".join([*lines, "f 1 2 3 4 5 # a polygon", "l 1 2", ""]).encode()


CORPUS = {
    "textured.glb": textured(),
    "skinned.glb": skinned(),
    "packed.glb": packed(),
    "apart.gltf": apart(),
    "a.obj": obj(),
    "a.off": BALL.export(file_type="off").encode(),
    "text.ply": COLOURED.export(file_type="ply", encoding="ascii"),
    "little.ply": COLOURED.export(file_type="ply"),
    "binary.stl": BALL.export(file_type="stl"),
    "text.stl": BALL.export(file_type="stl_ascii").encode(),
}
"""The files by name."""
