"""Small files that announce or expand to much data need no more memory and steps than valid files."""

import contextlib
import json
import math
import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import igl
import pytest

from engine_bridge.character.surface_document import read_surface
from puppetline.errors import MeshError

from ..engine_bridge.conftest import Glb
from .conftest import read_and_write
from .corpus import CORPUS, RAW_JSON, glb_of, pack, unpack

MEASURE = Path(__file__).with_name("measure.py")

MEGABYTE = 2**20
HUNDRED_MILLION = 10**8

needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="limits and peaks of memory are asked of Linux")


def png(width, height):
    """Return a black picture in as few bytes as possible."""
    rows = zlib.compress(bytes((width + 7) // 8 + 1) * height, 9)
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)), (b"IDAT", rows), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


def with_bytes(gltf, binary, more):
    """Append a buffer view and return its index and the bytes."""
    binary += bytes(-len(binary) % 4)
    gltf["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(more)})
    gltf["buffers"][0]["byteLength"] = len(binary) + len(more)
    return len(gltf["bufferViews"]) - 1, binary + more


def announcing(changes):
    """Return a function that sets values of a description at their paths, or removes what is None."""

    def change(gltf, binary):
        for path, value in changes.items():
            kind, index, key = path.split()
            gltf[kind][int(index)][key] = value
            if value is None:
                del gltf[kind][int(index)][key]
        return binary

    return change


def same_mesh_again_and_again(gltf, binary):
    gltf["meshes"][0]["primitives"] *= 3000
    gltf["nodes"] = [{"mesh": 0}] * 3000
    gltf["scenes"] = [{"nodes": list(range(3000))}]
    return binary


def same_array_again_and_again(gltf, binary):
    gltf["accessors"].append({"componentType": 5126, "count": 20_000, "type": "VEC3"})
    shared = {"attributes": {"POSITION": len(gltf["accessors"]) - 1}}
    gltf["meshes"][0]["primitives"] += [shared] * 8000
    return with_bytes(gltf, binary, bytes(20_000))[1]


def more_joints_than_any(gltf, binary):
    attributes = gltf["meshes"][0]["primitives"][0]["attributes"]
    for number in range(5000):
        attributes |= {f"JOINTS_{number}": attributes["JOINTS_0"], f"WEIGHTS_{number}": attributes["WEIGHTS_0"]}
    return binary


def faults_without_end(gltf, binary):
    gltf["nodes"] = [1] * 300_000
    return binary


def painted_with(width, height, copies):
    def change(gltf, binary):
        view, binary = with_bytes(gltf, binary, png(width, height))
        primitive, material = gltf["meshes"][0]["primitives"][0], gltf["materials"][0]
        gltf["images"] = [{"bufferView": view}] * copies
        gltf["textures"] = [{"source": number} for number in range(copies)]
        surface = material["pbrMetallicRoughness"]
        gltf["materials"] = [
            {"pbrMetallicRoughness": {**surface, "baseColorTexture": {"index": number}}} for number in range(copies)
        ]
        gltf["meshes"][0]["primitives"] = [{**primitive, "material": number} for number in range(copies)]
        return binary

    return change


def names_itself(kind):
    def change(gltf, binary):
        gltf[kind] += [{"byteLength": 1, "uri": "itself.glb"}] * 3000
        gltf["extras"] = "x" * 10**6
        return binary

    return change


SPARSE = {"count": HUNDRED_MILLION, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}}

ANNOUNCED = {
    "positions": {"accessors 0 count": HUNDRED_MILLION},
    "indices": {"accessors 4 count": HUNDRED_MILLION},
    "positions beyond 64 bits": {"accessors 0 count": 2**64},
    "zeros": {"accessors 0 count": HUNDRED_MILLION, "accessors 0 bufferView": None},
    "buffer": {"buffers 0 byteLength": HUNDRED_MILLION},
    "no stride": {"accessors 0 count": HUNDRED_MILLION, "bufferViews 0 byteStride": 0},
    "sparse": {"accessors 0 sparse": SPARSE},
}
"""What a description says about its arrays: where, and what."""

OVERSIZED = {
    **{name: announcing(changes) for name, changes in ANNOUNCED.items()},
    "same mesh": same_mesh_again_and_again,
    "same array": same_array_again_and_again,
    "faults": faults_without_end,
}
"""Files that announce too much data; all are refused."""

EXPANDING = {
    "one large picture": painted_with(30_000, 30_000, 1),
    "one long picture": painted_with(2**27, 1, 1),
    "many pictures": painted_with(1024, 1024, 1000),
    "bytes that are the file": names_itself("buffers"),
    "pictures that are the file": names_itself("images"),
}
"""Files that expand to much data; all are read up to a limit."""


def announced(content, old, new):
    assert old in content
    return content.replace(old, new)


def surfaces():
    """Return mesh files of about 1 kB that announce about 1 GB."""
    stl, obj, off = CORPUS["binary.stl"], CORPUS["a.obj"], CORPUS["a.off"]
    files = {"count.stl": stl[:80] + b"\xff" * 4 + stl[84:], "index.obj": obj + b"f 1 2 1000000000\n"}
    files["vertices.off"] = announced(off, b"42 80 0", b"1000000000 80 0")
    files["faces.off"] = announced(off, b"42 80 0", b"42 1000000000 0")
    files["corners.off"] = off.replace(b"\n3 ", b"\n1000000000 ", 1)
    for kind in ("text", "little"):
        ply = CORPUS[f"{kind}.ply"]
        for element, count in (("vertex", 42), ("face", 80)):
            large = f"element {element} 1000000000".encode()
            files[f"{kind}_{element}.ply"] = announced(ply, f"element {element} {count}".encode(), large)
        listed = b"property list uint int vertex_indices"
        if kind != "text":
            files[f"{kind}_list.ply"] = announced(ply, b"property list uchar int vertex_indices", listed)
    return files


def chunks(whole):
    """Yield a .glb that announces the maximum length, and one whose description does."""
    for place in (8, 12):
        yield whole[:place] + b"\xff" * 4 + whole[place + 4 :]


def measured(good, paths):
    """Return the kind of error, the peak memory in bytes and the steps of reading each file (`measure.py`)."""
    command = [sys.executable, MEASURE, good, *paths]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    lines = subprocess.run(command, capture_output=True, text=True, env=environment, check=True).stdout.splitlines()
    assert len(lines) == len(paths)
    return [json.loads(line) for line in lines]


def valid(size):
    """Return a valid .glb of a minimum size in bytes."""
    vertices, triangles = igl.icosahedron()
    made = b""
    while len(made) < size:
        vertices, triangles = igl.upsample(vertices, triangles)
        glb = Glb()
        glb.show(vertices, triangles)
        made = glb_of(glb)
    return made


def changed(origin, change):
    gltf, binary = unpack(CORPUS[origin])
    binary = change(gltf, binary)
    return pack(gltf, binary)


@needs_linux
def test_files_that_announce_too_much_are_refused_as_cheaply_as_valid_files_are_read(folder):
    contents = {f"{name}.glb": changed("textured.glb", change) for name, change in OVERSIZED.items()}
    contents["joints.glb"] = changed("skinned.glb", more_joints_than_any)
    contents |= {f"chunk {number}.glb": content for number, content in enumerate(chunks(CORPUS["textured.glb"]))}
    contents |= surfaces()
    sizes = {name: 4 ** math.ceil(math.log(max(len(content), 10_000), 4)) for name, content in contents.items()}
    goods = [f"good_{size}.glb" for size in sorted(set(sizes.values()))]
    for name, content in contents.items() | {(f"good_{size}.glb", valid(size)) for size in set(sizes.values())}:
        (folder / name).write_bytes(content)
    names = [*goods, *contents]
    results = dict(zip(names, measured(folder / goods[0], [folder / name for name in names]), strict=True))
    for name, size in sizes.items():
        (_, peak, steps), (found, more, taken) = results[f"good_{size}.glb"], results[name]
        assert found == "MeshError", name
        assert more < 5 * (peak + MEGABYTE), f"{name}: {more / MEGABYTE:.0f} MB"
        assert taken < 5 * (steps + len(contents[name])), f"{name}: {taken} steps"


@needs_linux
def test_files_that_expand_are_read_within_a_memory_limit(tmp_path):
    good = tmp_path / "textured.glb"
    good.write_bytes(CORPUS["textured.glb"])
    paths = [tmp_path / str(number) / "itself.glb" for number in range(len(EXPANDING))]
    for path, change in zip(paths, EXPANDING.values(), strict=True):
        path.parent.mkdir()
        path.write_bytes(changed("textured.glb", change))
    for name, (found, more, _) in zip(EXPANDING, measured(good, paths), strict=True):
        assert found is None, name
        assert more < 400 * MEGABYTE, name


def test_deeply_nested_extras_are_written_again_or_refused(folder):
    gltf, binary = unpack(CORPUS["textured.glb"])
    written = []
    for depth in (1, 100, 400, *range(500, 1100, 7), 100_000):
        gltf["extras"] = RAW_JSON + "[" * depth + "]" * depth
        (folder / "deep.glb").write_bytes(pack(gltf, binary))
        with contextlib.suppress(MeshError):
            read_and_write(folder / "deep.glb")
            written.append(depth)
    assert written[:3] == [1, 100, 400]
    assert written[-1] < 1100


def test_missing_pictures_are_found_without_listing_the_folder_for_each(folder):
    materials = b"".join(b"newmtl m%d\nmap_Kd no%d.png\n" % (number, number) for number in range(3000))
    (folder / "skin.mtl").write_bytes(materials)
    (folder / "a.obj").write_bytes(CORPUS["a.obj"])
    assert len(read_surface(folder / "a.obj").notes) >= 3000


def test_a_long_line_of_missing_libraries_is_read_once(folder):
    (folder / "a.obj").write_bytes(b"mtllib " + b"a " * 100_000 + b"\n" + CORPUS["a.obj"])
    assert len(read_surface(folder / "a.obj").pieces) == 2
