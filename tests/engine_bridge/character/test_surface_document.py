import shutil

import numpy as np
import pytest
from PIL import Image

from engine_bridge.character import surface_document
from engine_bridge.character.surface_document import SURFACE_FILES, read_document, read_surface
from puppetline.errors import MeshError

from ..refusals import refused_place
from .surfaces import test_off, test_ply, test_stl

OBJ = """mtllib a.mtl
v 0 0 0
v 1 0 0
v 0 1 0
v 0 0 1
vt 0 0
vt 1 1
usemtl skin
f 1/1 3/1 2/2
f 1/1 2/2 4/1
f 2/2 3/1 4/1
f 3/1 1/1 4/1
"""


@pytest.fixture
def mesh(tmp_path):
    """A tetrahedron with an image, in a separate folder."""
    folder = tmp_path / "mesh"
    folder.mkdir()
    (folder / "a.obj").write_text(OBJ)
    (folder / "a.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    Image.new("RGB", (2, 2), "red").save(folder / "skin.png")
    return folder / "a.obj"


@pytest.fixture
def read(tmp_path, mesh, monkeypatch):
    """Return the document of the mesh, and whether it was parsed."""
    parses = []
    parse = surface_document.read_surface
    monkeypatch.setattr(surface_document, "read_surface", lambda *files: parses.append(1) or parse(*files))

    def run(path=mesh):
        parses.clear()
        return read_document(path, path.read_bytes(), tmp_path / "cache"), bool(parses)

    return run


def same(one, other):
    return (one.gltf, one.blob, one.notes, one.name) == (other.gltf, other.blob, other.notes, other.name)


def test_a_document_is_parsed_once_and_is_the_same_as_without_a_cache(read, mesh):
    first, was_parsed = read()
    assert was_parsed
    (mesh.parent / "b.mtl").write_text("newmtl skin\n")  # which the mesh does not name
    again, was_parsed = read()
    assert not was_parsed
    assert same(first, again)
    assert same(first, read_document(mesh, mesh.read_bytes()))
    assert first.gltf["images"][0]["name"] == "skin"


def appended(name, text):
    def change(folder):
        (folder / name).write_text((folder / name).read_text() + text)

    return change


CHANGES = {
    "mesh": appended("a.obj", "v 2 2 2\n"),
    "materials": appended("a.mtl", "Ns 30\n"),
    "picture": lambda folder: Image.new("RGB", (2, 2), "blue").save(folder / "skin.png"),
    "picture gone": lambda folder: (folder / "skin.png").unlink(),
    "materials gone": lambda folder: (folder / "a.mtl").unlink(),
    "picture by another name": lambda folder: (folder / "skin.png").rename(folder / "SKIN.PNG"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_of_the_mesh_or_of_a_file_that_it_names_is_seen(read, mesh, change):
    first, _ = read()
    CHANGES[change](mesh.parent)
    second, was_parsed = read()
    assert was_parsed
    assert not same(first, second)
    assert same(second, read_document(mesh, mesh.read_bytes()))
    assert read()[1] is False


def test_a_picture_that_was_missing_is_seen_when_it_comes_and_so_is_what_new_materials_name(read, mesh):
    (mesh.parent / "skin.png").rename(mesh.parent / "fur.png")
    assert len(read()[0].notes) == 1
    shutil.copyfile(mesh.parent / "fur.png", mesh.parent / "skin.png")
    assert read()[0].notes == []
    (mesh.parent / "a.mtl").write_text("newmtl skin\nmap_Kd fur.png\n")
    red, _ = read()
    Image.new("RGB", (2, 2), "blue").save(mesh.parent / "fur.png")
    blue, was_parsed = read()
    assert was_parsed
    assert red.gltf["images"][0]["name"] == blue.gltf["images"][0]["name"] == "fur"
    assert red.blob != blue.blob


def test_the_same_mesh_elsewhere_is_another_since_its_notes_say_where(read, mesh, tmp_path):
    read()
    shutil.copytree(mesh.parent, tmp_path / "other")
    document, was_parsed = read(tmp_path / "other" / "a.obj")
    assert was_parsed
    assert document.name == str(tmp_path / "other" / "a.obj")


def as_obj(cube):
    vertices = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in cube.vertices)
    return vertices + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in cube.triangles)


ENCODINGS = {
    "obj": as_obj,
    "off": test_off.text,
    "ply": test_ply.cube_text,
    "stl": test_stl.binary,
    "text stl": test_stl.text,
}


NOISE = np.random.default_rng(3).integers(0, 256, 5000, dtype=np.uint8).tobytes()

KNOWN = [(encoding, ending) for encoding in ENCODINGS for ending in (*SURFACE_FILES, ".OBJ", ".mesh", "")]


# only its ending tells an OBJ from a damaged file of another kind
@pytest.mark.parametrize(
    ("encoding", "ending"), [case for case in KNOWN if case[0] != "obj" or case[1] not in SURFACE_FILES[1:]]
)
def test_a_file_is_known_by_its_content_whatever_its_ending(cube, written, encoding, ending):
    (piece,) = read_surface(written(f"a{ending}", ENCODINGS[encoding](cube))).pieces
    np.testing.assert_array_equal(piece.positions[piece.triangles], cube.vertices[cube.triangles])
    assert (piece.normals is None) == ("stl" not in encoding)  # facets have normals, and so many hard edges need none
    assert (piece.material.double_sided, len(piece.positions)) == (False, 36 if "stl" in encoding else 8)


@pytest.mark.parametrize("ending", [*SURFACE_FILES, ".mp3"])
@pytest.mark.parametrize(
    "content", [b"", b"\0" * 100, b"\n" * 100, b"ID3\4 song", b"v", b"\xff\xfe" * 200, b"0 0 0 0", NOISE]
)
def test_a_file_without_a_mesh_is_refused(written, ending, content):
    path = written(f"a{ending}", content)
    refused_place(MeshError, path, read_surface, path)


def test_a_file_that_cannot_be_opened_is_refused(tmp_path):
    for path in (tmp_path / "none.obj", tmp_path):
        refused_place(MeshError, path, read_surface, path)
