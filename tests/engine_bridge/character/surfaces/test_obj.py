import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from engine_bridge.character.surfaces import obj
from engine_bridge.character.surfaces.surface import DEFAULT_MATERIAL, Piece, linear
from puppetline.errors import MeshError

from ...conftest import encoded
from ...refusals import refused, refused_place

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.fixture
def read(written):
    """Read the content of a file a.obj."""
    return lambda content: obj.read(path := written("a.obj", content), path.read_bytes())


def only(surface):
    (piece,) = surface.pieces
    return piece


def same(piece, other):
    """Assert that two pieces have the same arrays."""
    for name in ("positions", "triangles", "normals", "uvs"):
        assert_array_equal(getattr(piece, name), getattr(other, name))
    return True


def test_without_texture_coordinates_and_normals_vertices_stay_as_they_are(read):
    piece = only(read(f"v 9 9 9\n{SQUARE}v 8 8 8\nf 5 4 3 2\n"))
    assert_array_equal(piece.positions, [[9, 9, 9], [0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [8, 8, 8]])
    assert piece.triangles.tolist() == [[4, 3, 2], [4, 2, 1]]
    assert piece == Piece("", piece.positions, piece.triangles)


def test_every_distinct_corner_becomes_a_vertex_in_order_of_first_appearance(read):
    faces = "f 3/1/1 2/2/1 1/1/1\nf 3/1/1 1/1/1 4/1/2\nf 3/2/1 1/1/1 4/1/2\n"
    piece = only(read(f"{SQUARE}vt 0 0\nvt 1 0.25\nvn 0 0 1\nvn 0 0 2\n{faces}"))
    assert_array_equal(piece.positions, [[1, 1, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 1, 0]])
    assert_array_equal(piece.uvs, [[0, 1], [1, 0.75], [0, 1], [0, 1], [1, 0.75]])
    assert_array_equal(piece.normals, [[0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, 2], [0, 0, 1]])
    assert piece.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 2, 3]]


CORNERS = """
1 2 3 4                   |
1/1 2/1 3/1 4/1           | uvs
1//1 2//1 3//1 4//1       | normals
1/1/1 2/1/1 3/1/1 4/1/1   | uvs normals
1/ 2/ 3/ 4/               |
1/1/ 2/1/ 3/1/ 4/1/       | uvs
1/0/0 2/0/0 3/0/0 4/0/0   |
1/1/1 2//1 3/1 4          |
1/1/1 2//1 3/1/1 4//1     | normals
1// +2/ -2 0004/0/-0      |
1/1 2/1 3/2 4/-2          |
1//1 2//1 3//2 4//1       |
1/1/1 2/1/1 3/2/1 4/1/1   | normals
1/1/1 2/-2/1 3/1/1 4/99999999999999999/1 | normals
"""
"""Corners of a square, and what all of them name."""


@pytest.mark.parametrize("case", CORNERS.strip().splitlines())
def test_a_corner_may_name_any_of_the_three_and_keeps_what_all_of_its_face_name(read, case):
    corners, _, named = case.partition("|")
    piece = only(read(f"{SQUARE}vt 0.5 0.5\nvn 0 0 1\nf {corners}\n"))
    assert_array_equal(piece.positions, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert piece.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert [name for name in ("uvs", "normals") if getattr(piece, name) is not None] == named.split()


def test_faces_that_name_different_things_become_pieces(read):
    surface = read(f"{SQUARE}vt 0 0\nvn 0 0 1\no square\nf 1/1 2/1 3/1\nf 1 3 4\nf 4//1 3//-1 1//+1\n")
    assert [(piece.name, piece.uvs is None, piece.normals is None) for piece in surface.pieces] == [
        ("square", True, True), ("square", False, True), ("square", True, False)
    ]  # fmt: skip
    assert surface.notes == []


def test_negative_indices_count_back_from_what_stands_before_them(read):
    piece = only(read(f"{SQUARE}vt 0 0\nvt 1 1\nf -4/-2 -3/-1 -2/-2\nv 5 5 5\nvt 0.5 0\nf -4/-1 -3/-1 -1/-1\n"))
    assert_array_equal(piece.positions[piece.triangles[1]], [[1, 0, 0], [1, 1, 0], [5, 5, 5]])
    assert_array_equal(piece.uvs[piece.triangles[0]], [[0, 1], [1, 0], [0, 1]])
    assert_array_equal(piece.uvs[piece.triangles[1]], [[0.5, 1]] * 3)


def test_line_ends_continuations_comments_and_odd_spaces(read):
    plain = only(read(f"{SQUARE}f 1 2 3 4\n"))
    odd = only(
        read(
            b"\xef\xbb\xbf# c\r\nv 0\t0 0 # here\r\n  v  1 0 0\x0b\r\nv 1 \\\r\n1 0\rv\t0 1 0 1.0\n\n\n"
            b"o K\xf6rper\nf 1 \\\n 2 \\\n3 4\\"
        )
    )
    assert same(odd, plain)
    assert odd.name == "Körper"


def test_colours_behind_the_coordinates_are_linear_afterwards(read):
    piece = only(read("v 0 0 0 1 0.5 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1 1\nf 1 2 3\n"))
    assert_array_equal(piece.colors, linear(np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]])))
    assert piece.material.base_color == (1, 1, 1, 1)
    for text, notes in (("1 0 0", 1), ("1", 0)):  # the other vertices have none
        surface = read(f"v 0 0 0 {text}\nv 1 0 0\nv 0 1 0 {text}\nf 1 2 3\n")
        assert (only(surface).colors, len(surface.notes)) == (None, notes)


def test_groups_and_materials_become_pieces_in_order_of_their_first_faces(read, written):
    written("some paint.mtl", "newmtl red\nKd 1 0 0\nnewmtl blue one\nKd 0 0 1\n")
    written("more.mtl", "newmtl green\nKd 0 1 0\n")
    content = (
        f"mtllib some paint.mtl more.mtl\n{SQUARE}o empty\n"
        "g  left  arm\nusemtl blue one\nf 1 2 3\nusemtl red\nf 1 3 4\n"
        "g head\nf 2 3 4\ng left arm\nusemtl blue one\nf 4 2 1\nusemtl none\nf 1 2 4\no part#2\nusemtl green\nf 1 2 3\n"
    )
    surface = read(content)
    assert [(piece.name, piece.material.name, len(piece.triangles)) for piece in surface.pieces] == [
        ("left arm", "blue one", 2), ("left arm", "red", 1), ("head", "red", 1), ("left arm", "none", 1),
        ("part#2", "green", 1),
    ]  # fmt: skip
    assert [piece.material.base_color for piece in surface.pieces] == [
        (0, 0, 1, 1), (1, 0, 0, 1), (1, 0, 0, 1), DEFAULT_MATERIAL.base_color, (0, 1, 0, 1)
    ]  # fmt: skip
    assert surface.notes == ["1 material missing in the material files: 'none'."]
    blue = surface.pieces[0]
    assert_array_equal(blue.positions[blue.triangles[1]], [[0, 1, 0], [1, 0, 0], [0, 0, 0]])


def test_isolated_vertices_are_kept_once_where_there_are_several_groups(read):
    surface = read(f"v 7 7 7\n{SQUARE}g a\nf 2 3 4\ng b\nf 2 4 5\n")
    assert [piece.positions[:, 0].tolist() for piece in surface.pieces] == [[7, 0, 1, 1], [0, 1, 0]]
    with_normals = read(f"v 7 7 7\n{SQUARE}vn 0 0 1\nf 2//1 3//1 4//1 5//1\n")
    assert (len(only(with_normals).positions), len(with_normals.notes)) == (4, 1)


def test_a_piece_without_texture_coordinates_has_no_picture(read, written):
    written("skin.png", encoded(Image.new("RGB", (2, 2))))
    written("a.mtl", "newmtl a\nmap_Kd skin.png\n")
    surface = read(f"mtllib a.mtl\nvt 0 0\n{SQUARE}usemtl a\no bare\nf 1 2 3\no other\nf 1/1 3/1 4/1\n")
    assert [piece.material.texture and piece.material.texture.name for piece in surface.pieces] == [None, "skin"]
    assert len(surface.notes) == 1


@pytest.mark.parametrize(
    ("first", "second", "more", "notes"),
    [("s 1", "s off", "", 1), ("s 1", "s 2", "", 1), ("", "s 1", "", 1), ("s 1", "s 1", "", 0), ("s 0", "s off", "", 0),
     ("s 1", "s off", "vn 0 0 1", 0)],
)  # fmt: skip
def test_smoothing_groups_are_noted_where_no_normals_say_the_same(read, first, second, more, notes):
    surface = read(f"{SQUARE}{more}\n{first}\nf 1 2 3\n{second}\nf 1 3 4\ns 9\n")
    assert len(surface.notes) == notes


def test_what_is_no_polygon_or_not_there_is_noted_in_one_note_for_each_kind(read, tmp_path):
    surface = read(
        f"mtllib none.mtl\nmtllib none.mtl\nmtllib /etc/hosts.mtl\n{SQUARE}l 1 2 3\np 1\ns off\nvp 1\nfoo 1\nf 1 2\n"
        "f 1 2 3\nbar\nusemtl a\nf 4/1/2 1/1/2 2/1/2\n"
    )
    assert [len(piece.triangles) for piece in surface.pieces] == [1, 1]
    assert len(surface.notes) == 7
    for part in ("none.mtl", f"{tmp_path / 'a.obj'}, line 3: ", "'a'", "1 face", "2 statements", "2 lines", "line 12"):
        assert part in " ".join(surface.notes)


WRONG_LINES = """
v 1 x 0
v 1 2
v
v 1 2 inf
v 1 1 1e99
vt x
vn 1 2
f 1 2 zwei
f 0 1 2
f 1 2 5
f 1 2 -5
f 1 2 99999999999999999999
f 1 2 x
f 1/2/3/4 2 3
f 1/2/3/ 2 3
f 1 2 /1
f 1/- 2 3
f -/1 2 3
f 1/-/1 2 3
f 1 2 1.5
f 1/x 2 3
f 1 --1 2
f 1-2 2 3
"""


@pytest.mark.parametrize("line", WRONG_LINES.strip().splitlines())
def test_a_line_that_cannot_be_read_is_named(read, tmp_path, line):
    content = f"{SQUARE}vt 0 \\\n0\nvn 0 0 1\nf 1 2 3\n{line}\n"
    assert refused_place(MeshError, tmp_path / "a.obj", read, content) == "line 9"


@pytest.mark.parametrize("text", ["", SQUARE, f"{SQUARE}l 1 2\nf 1 2\n"])
def test_a_file_without_a_surface_is_refused(read, text):
    refused(MeshError, read, text)


WITH_POLYGONS = [
    *("beast_32k_quads.obj", "makehuman_base.obj", "rabbit_9parts.obj", "suzanne.obj"),
    *("nasty/negative_indices.obj", "nasty/wallhole.obj"),
]
REAL = [*WITH_POLYGONS, "chair_model.obj", "spot_cow_uv.obj", "stanford_bunny_holes.obj", "nasty/not_convex.obj"]


@pytest.mark.parametrize("name", REAL)
def test_real_files_have_the_surface_that_trimesh_finds_in_them(real_data, name):
    path = real_data / "mesh" / name
    soup = np.concatenate([p.positions[p.triangles] for p in obj.read(path, path.read_bytes()).pieces])
    peer = trimesh.load(path, process=False, skip_materials=True, force="mesh").triangles
    assert len(soup) == len(peer)
    assert_allclose(np.unique(soup.reshape(-1, 3), axis=0), np.unique(peer.reshape(-1, 3), axis=0))
    normals = [np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]).sum(axis=0) for t in (soup, peer)]
    assert_allclose(*normals, atol=1e-9 * np.ptp(soup) ** 2)  # whichever way polygons were cut
    if name not in WITH_POLYGONS:
        assert_allclose(*(t[np.lexsort(t.reshape(-1, 9).T)] for t in (soup, peer)))
