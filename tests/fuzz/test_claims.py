"""Small files that announce or expand to much data need no more memory and time than valid files."""

import contextlib
import json
import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import igl
import numpy as np
import pytest

from engine_bridge.character.surface_document import read_surface
from puppetline.errors import MeshError

from .corpus import CORPUS, RAW_JSON, Parts, pack, unpack

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


def counted(which, count):
    def change(gltf, binary):
        primitive = gltf["meshes"][0]["primitives"][0]
        index = primitive["indices"] if which == "indices" else primitive["attributes"][which]
        gltf["accessors"][index]["count"] = count
        return binary

    return change


def zeros(gltf, binary):
    del gltf["accessors"][0]["bufferView"]
    gltf["accessors"][0]["count"] = HUNDRED_MILLION
    return binary


def buffer(gltf, binary):
    gltf["buffers"][0]["byteLength"] = HUNDRED_MILLION
    return binary


def no_stride(gltf, binary):
    gltf["bufferViews"][0]["byteStride"] = 0
    gltf["accessors"][0]["count"] = HUNDRED_MILLION
    return binary


def sparse(gltf, binary):
    gltf["accessors"][0]["sparse"] = {
        "count": HUNDRED_MILLION,
        "indices": {"bufferView": 0, "componentType": 5125},
        "values": {"bufferView": 0},
    }
    return binary


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


OVERSIZED = {
    "positions": ("textured.glb", counted("POSITION", HUNDRED_MILLION)),
    "indices": ("textured.glb", counted("indices", HUNDRED_MILLION)),
    "positions beyond 64 bits": ("textured.glb", counted("POSITION", 2**64)),
    "zeros": ("textured.glb", zeros),
    "buffer": ("textured.glb", buffer),
    "no stride": ("textured.glb", no_stride),
    "sparse": ("textured.glb", sparse),
    "same mesh": ("textured.glb", same_mesh_again_and_again),
    "same array": ("textured.glb", same_array_again_and_again),
    "joints": ("skinned.glb", more_joints_than_any),
    "faults": ("textured.glb", faults_without_end),
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
    files["vertices.off"] = announced(off, b"26 48 0", b"1000000000 48 0")
    files["faces.off"] = announced(off, b"26 48 0", b"26 1000000000 0")
    files["corners.off"] = off.replace(b"\n3 ", b"\n1000000000 ", 1)
    for kind in ("text", "little", "big"):
        ply = CORPUS[f"{kind}.ply"]
        for element, count in (("vertex", 26), ("face", 48)):
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
    """Return the kind of error, the peak memory in bytes and the seconds of reading each file (`measure.py`)."""
    command = [sys.executable, MEASURE, good, *paths]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    lines = subprocess.run(command, capture_output=True, text=True, env=environment, check=True).stdout.splitlines()
    assert len(lines) == len(paths)
    return [json.loads(line) for line in lines]


@pytest.fixture
def good(folder):
    """Write a valid .glb of a minimum size in bytes."""
    points, faces = igl.icosahedron()
    faces = faces.astype(np.uint32)

    def write(size):
        vertices, triangles, content = points, faces, b""
        while len(content) < size:
            vertices, triangles = igl.upsample(vertices, triangles)
            parts = Parts({"nodes": [{"mesh": 0}]})
            position = parts.add(vertices.astype(np.float32))
            index = parts.add(triangles.astype(np.uint32).ravel())
            parts.gltf["meshes"] = [{"primitives": [{"attributes": {"POSITION": position}, "indices": index}]}]
            content = parts.glb()
        path = folder / f"good_{size}.glb"
        path.write_bytes(content)
        return path

    return write


def changed(origin, change):
    gltf, binary = unpack(CORPUS[origin])
    binary = change(gltf, binary)
    return pack(gltf, binary)


@pytest.fixture
def check(folder, good):
    """Check the outcome of reading files, in at most 5 times the memory and time of a valid file of the same size."""

    def run(contents, kind):
        for name, content in contents.items():
            (folder / name).write_bytes(content)
        sizes = {name: 4 ** int(np.ceil(np.log2(max(len(content), 10_000)) / 2)) for name, content in contents.items()}
        goods = {size: good(size) for size in sorted(set(sizes.values()))}
        smallest = next(iter(goods.values()))
        results = measured(smallest, [*goods.values(), *(folder / name for name in contents)])
        _, peaks, seconds = zip(*results[: len(goods)], strict=True)
        peak, second = dict(zip(goods, peaks, strict=True)), dict(zip(goods, seconds, strict=True))
        for (name, size), (found, more, took) in zip(sizes.items(), results[len(goods) :], strict=True):
            assert found == kind, name
            assert more < 5 * (peak[size] + MEGABYTE), f"{name}: {more / MEGABYTE:.0f} MB"
            assert took < 5 * second[size], f"{name}: {took:.2f} s"

    return run


@needs_linux
def test_files_that_announce_too_much_are_refused_as_cheaply_as_valid_files_are_read(check):
    contents = {f"{name}.glb": changed(origin, change) for name, (origin, change) in OVERSIZED.items()}
    contents |= {f"chunk {number}.glb": content for number, content in enumerate(chunks(CORPUS["textured.glb"]))}
    check(contents | surfaces(), "MeshError")


@pytest.fixture(scope="module")
def unfolded(tmp_path_factory):
    """Return the measurements of reading each file of `EXPANDING`."""
    good = tmp_path_factory.mktemp("good") / "textured.glb"
    good.write_bytes(CORPUS["textured.glb"])
    paths = [tmp_path_factory.mktemp("unfolded") / "itself.glb" for _ in EXPANDING]
    for path, change in zip(paths, EXPANDING.values(), strict=True):
        path.write_bytes(changed("textured.glb", change))
    return dict(zip(EXPANDING, measured(good, paths), strict=True))


@needs_linux
@pytest.mark.parametrize("name", EXPANDING)
def test_files_that_expand_are_read_within_a_memory_limit(unfolded, name):
    found, more, _ = unfolded[name]
    assert found is None
    assert more < 400 * MEGABYTE


def test_deeply_nested_extras_are_written_again_or_refused(folder, read_again):
    gltf, binary = unpack(CORPUS["textured.glb"])
    written = []
    for depth in (1, 100, 400, *range(500, 1100, 7), 100_000):
        gltf["extras"] = RAW_JSON + "[" * depth + "]" * depth
        (folder / "deep.glb").write_bytes(pack(gltf, binary))
        with contextlib.suppress(MeshError):
            read_again(folder / "deep.glb")
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
