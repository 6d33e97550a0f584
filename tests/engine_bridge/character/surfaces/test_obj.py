import numpy as np
import pytest
import trimesh

from engine_bridge.character.surfaces import obj
from engine_bridge.character.surfaces.surface import DEFAULT_MATERIAL, linear
from puppetline.errors import MeshError

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


@pytest.fixture
def read(written):
    return lambda content, name="a.obj": obj.read(path := written(name, content), path.read_bytes())


def only(surface):
    (piece,) = surface.pieces
    return piece


def test_without_texture_coordinates_and_normals_vertices_stay_as_they_are(read):
    piece = only(read(f"v 9 9 9\n{SQUARE}v 8 8 8\nf 5 4 3 2\n"))
    np.testing.assert_array_equal(piece.positions, [[9, 9, 9], [0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [8, 8, 8]])
    assert piece.triangles.tolist() == [[4, 3, 2], [4, 2, 1]]
    assert (piece.name, piece.material, piece.normals, piece.uvs, piece.colors) == (
        "",
        DEFAULT_MATERIAL,
        None,
        None,
        None,
    )


def test_every_distinct_corner_becomes_a_vertex_in_order_of_first_appearance(read):
    faces = "f 3/1/1 2/2/1 1/1/1\nf 3/1/1 1/1/1 4/1/2\nf 3/2/1 1/1/1 4/1/2\n"
    piece = only(read(f"{SQUARE}vt 0 0\nvt 1 0.25\nvn 0 0 1\nvn 0 0 2\n{faces}"))
    np.testing.assert_array_equal(piece.positions, [[1, 1, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 1, 0]])
    np.testing.assert_array_equal(piece.uvs, [[0, 1], [1, 0.75], [0, 1], [0, 1], [1, 0.75]])
    np.testing.assert_array_equal(piece.normals, [[0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 0, 2], [0, 0, 1]])
    assert piece.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [4, 2, 3]]


@pytest.mark.parametrize(
    ("corners", "has_uvs", "has_normals"),
    [("1 2 3 4", 0, 0), ("1/1 2/1 3/1 4/1", 1, 0), ("1//1 2//1 3//1 4//1", 0, 1), ("1/1/1 2/1/1 3/1/1 4/1/1", 1, 1),
     ("1/ 2/ 3/ 4/", 0, 0), ("1/1/ 2/1/ 3/1/ 4/1/", 1, 0), ("1/0/0 2/0/0 3/0/0 4/0/0", 0, 0),
     ("1/1/1 2//1 3/1 4", 0, 0), ("1/1/1 2//1 3/1/1 4//1", 0, 1)],
)  # fmt: skip
def test_a_corner_may_name_any_of_the_three(read, corners, has_uvs, has_normals):
    piece = only(read(f"{SQUARE}vt 0.5 0.5\nvn 0 0 1\nf {corners}\n"))
    np.testing.assert_array_equal(piece.positions, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert piece.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert (piece.uvs is not None, piece.normals is not None) == (has_uvs, has_normals)


def test_corners_leave_out_what_they_do_not_name_and_may_carry_signs(read):
    piece = only(read(f"{SQUARE}vn 0 0 1\nf 1// +2/ -2\t0004/0/-0\n"))
    assert piece.triangles.tolist() == [[0, 1, 2], [0, 2, 3]]
    first, second = read(f"{SQUARE}vn 0 0 1\nf 1 2 3\nf 4//1 3//-1 1//+1\n").pieces
    assert (first.normals, second.normals.tolist()) == (None, [[0, 0, 1]] * 3)


@pytest.mark.parametrize(
    "corner", ["x", "1/2/3/", "1/2/3/4", "-", "1/-", "-/1", "1/-/1", "1.5", "1/x", "--1", "9" * 30, "1-2"]
)
def test_a_corner_that_is_none_is_refused(read, corner):
    with pytest.raises(MeshError) as error:
        read(f"{SQUARE}f 1 2 3\nf 1 2/2 {corner} 3\n")
    assert (error.value.where[-6:], error.value.found) == ("line 6", repr(f"1 2/2 {corner} 3"))


def test_faces_with_and_without_texture_coordinates_become_two_pieces(read):
    surface = read(f"{SQUARE}vt 0 0\no square\nf 1/1 2/1 3/1\nf 1 3 4\n")
    bare, textured = surface.pieces
    assert (bare.name, bare.uvs, len(bare.positions), textured.name, len(textured.uvs)) == (
        "square",
        None,
        3,
        "square",
        3,
    )
    assert surface.notes == []


def test_negative_indices_count_back_from_what_stands_before_them(read):
    piece = only(read(f"{SQUARE}vt 0 0\nvt 1 1\nf -4/-2 -3/-1 -2/-2\nv 5 5 5\nvt 0.5 0\nf -4/-1 -3/-1 -1/-1\n"))
    np.testing.assert_array_equal(piece.positions[piece.triangles[1]], [[1, 0, 0], [1, 1, 0], [5, 5, 5]])
    np.testing.assert_array_equal(piece.uvs[piece.triangles[0]], [[0, 1], [1, 0], [0, 1]])
    np.testing.assert_array_equal(piece.uvs[piece.triangles[1]], [[0.5, 1]] * 3)


def test_concave_polygons_are_covered_and_no_more_than_they(read):
    piece = only(read("v 0 0 0\nv 2 2 0\nv 0 1 0\nv -2 2 0\nf 2 3 4 1\n"))
    a, b, c = piece.positions[piece.triangles].swapaxes(0, 1)
    np.testing.assert_allclose(np.cross(b - a, c - a)[:, 2], [2, 2])


def test_line_ends_continuations_comments_and_odd_spaces(read):
    plain = only(read(f"{SQUARE}f 1 2 3 4\n"))
    odd = only(
        read(
            b"\xef\xbb\xbf# c\r\nv 0\t0 0 # here\r\n  v  1 0 0\x0b\r\nv 1 \\\r\n1 0\rv\t0 1 0 1.0\n\n\n"
            b"f 1 \\\n 2 \\\n3 4#x"
        )
    )
    np.testing.assert_array_equal(odd.positions, plain.positions)
    np.testing.assert_array_equal(odd.triangles, plain.triangles)


def test_colours_behind_the_coordinates_are_linear_afterwards(read):
    piece = only(read("v 0 0 0 1 0.5 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1 1\nf 1 2 3\n"))
    np.testing.assert_array_equal(piece.colors, linear(np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]])))
    assert piece.material.base_color == (1, 1, 1, 1)
    surface = read("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 0 0 1\nf 1 2 3\n")
    assert (only(surface).colors, surface.notes) == (
        None,
        ["Vertex colours are omitted, because some vertices have none."],
    )
    assert read("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0\nf 1 2 3\n").notes == []


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
    np.testing.assert_array_equal(blue.positions[blue.triangles[1]], [[0, 1, 0], [1, 0, 0], [0, 0, 0]])


def test_isolated_vertices_are_kept_once_where_there_are_several_groups(read):
    surface = read(f"v 7 7 7\n{SQUARE}g a\nf 2 3 4\ng b\nf 2 4 5\n")
    assert [piece.positions[:, 0].tolist() for piece in surface.pieces] == [[7, 0, 1, 1], [0, 1, 0]]
    with_normals = read(f"v 7 7 7\n{SQUARE}vn 0 0 1\nf 2//1 3//1 4//1 5//1\n")
    assert (len(only(with_normals).positions), with_normals.notes) == (4, ["1 vertex without a face omitted."])


def test_a_material_file_that_is_missing_or_elsewhere_is_noted(read, tmp_path):
    surface = read(f"mtllib none.mtl\nmtllib none.mtl\n{SQUARE}usemtl a\nf 1 2 3\n")
    assert surface.notes == ["'none.mtl' is missing.", "1 material missing in the material files: 'a'."]
    elsewhere = read(f"{SQUARE}mtllib /etc/hosts.mtl\nf 1 2 3\n")
    assert elsewhere.notes == [
        f"{tmp_path / 'a.obj'}, line 5: '/etc/hosts.mtl' is outside the mesh's folder and is not read."
        " Copy 'hosts.mtl' into that folder."
    ]
    np.testing.assert_array_equal(only(elsewhere).positions, only(read(f"{SQUARE}f 1 2 3\n")).positions)


def test_a_piece_without_texture_coordinates_has_no_picture(read, written, real_data):
    written("skin.jpg", (real_data / "mesh/fuze/fuze uv.jpg").read_bytes())
    written("a.mtl", "newmtl a\nmap_Kd skin.jpg\n")
    surface = read(f"mtllib a.mtl\nvt 0 0\n{SQUARE}usemtl a\no bare\nf 1 2 3\no other\nf 1/1 3/1 4/1\n")
    assert [piece.material.texture and piece.material.texture.name for piece in surface.pieces] == [None, "skin"]
    assert surface.notes == ["'bare' has no texture coordinates for the image of material 'a'."]


@pytest.mark.parametrize(
    ("first", "second", "normals", "noted"),
    [
        ("s 1", "s off", "", 1), ("s 1", "s 2", "", 1), ("", "s 1", "", 1), ("s 1", "s 1", "", 0),
        ("s 0", "s off", "", 0), ("s 1", "s off", "vn 0 0 1", 0),
    ],
)  # fmt: skip
def test_smoothing_groups_are_noted_where_no_normals_say_the_same(read, first, second, normals, noted):
    surface = read(f"{SQUARE}{normals}\n{first}\nf 1 2 3\n{second}\nf 1 3 4\ns 9\n")
    lost = "Smoothing groups are ignored. Export the mesh with normals to keep its hard edges."
    assert surface.notes == [lost] * noted


def test_a_backslash_at_the_very_end_says_nothing(read):
    assert only(read(f"{SQUARE}f 1 2 3 \\\n4\\")).triangles.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_an_element_that_is_no_polygon_is_noted(read):
    surface = read(f"{SQUARE}l 1 2 3\np 1\ns off\nvp 1\nfoo 1\nf 1 2\nf 1 2 3\nbar\nf 4/1/2 1/1/2 2/1/2\n")
    assert [len(piece.triangles) for piece in surface.pieces] == [2]
    assert sorted(surface.notes) == [
        "1 face with fewer than 3 corners omitted.",
        "2 lines not understood and omitted; the first is line 9.",
        "2 statements of lines or points omitted.",
        "Some faces name texture coordinates or normals that are not in the file.",
    ]


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("v 1 x 0", "'1 x 0'"), ("v 1 2", "'1 2'"), ("v", "''"), ("v 1 2 inf", "'1 2 inf'"),
        ("v 1 1 1e99", "'1 1 1e99'"),
        ("f 1 2 zwei", "'1 2 zwei'"), ("f 0 1 2", "'0 1 2'"), ("f 1 2 5", "vertex 5 of 4"),
        ("f 1 2 -5", "'1 2 -5'"),
        ("f 1/1/1/1 2 3", "'1/1/1/1 2 3'"), ("f 1 2 /1", "'1 2 /1'"),
        ("f 1 2 99999999999999999999", "'1 2 99999999999999999999'"), ("vt x", "'x'"), ("vn 1 2", "'1 2'"),
    ],
)  # fmt: skip
def test_a_line_that_cannot_be_read_is_named(read, line, found):
    with pytest.raises(MeshError) as error:
        read(f"{SQUARE}vt 0 \\\n0\nvn 0 0 1\nf 1 2 3\n{line}\n")
    assert error.value.where.endswith("a.obj, line 9")
    assert error.value.found == found


@pytest.mark.parametrize("face", ["f 1/1/1 3/2/1 4/1/1", "f 1/1/1 3/-2/1 4/1/1", f"f 1/1/1 3/{10**17}/1 4/1/1"])
def test_a_face_that_names_a_texture_coordinate_that_is_not_there_has_none(read, face):
    surface = read(f"{SQUARE}vt 0.5 0.5\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\n{face}\n")
    whole = read(f"{SQUARE}vt 0.5 0.5\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1//1 3//1 4//1\n")
    for piece, expected in zip(surface.pieces, whole.pieces, strict=True):
        for name in ("positions", "triangles", "normals", "uvs"):
            np.testing.assert_array_equal(getattr(piece, name), getattr(expected, name))
    assert surface.notes == ["Some faces name texture coordinates or normals that are not in the file."]
    assert whole.notes == []


def test_a_face_that_names_a_normal_that_is_not_there_has_none(read):
    (piece,) = read(f"{SQUARE}vn 0 0 1\nf 1//1 2//1 3//2\n").pieces
    assert (piece.triangles.tolist(), piece.normals) == ([[0, 1, 2]], None)


@pytest.mark.parametrize(
    ("text", "found"),
    [("", "no vertices"), (SQUARE, "vertices without faces"), (f"{SQUARE}l 1 2\nf 1 2\n", "vertices without faces")],
)
def test_a_file_without_a_surface_is_refused(read, text, found):
    with pytest.raises(MeshError) as error:
        read(text)
    assert error.value.found == found


REAL = {
    "armadillo.obj": (43243, 86482), "beast_32k_quads.obj": (None, 64618), "cat_7k.obj": (7207, 14410),
    "chair_model.obj": (None, 12756), "dinosaur_14k.obj": (14000, 27996), "feline_winged_genus2.obj": (4176, 8356),
    "homer_6k.obj": (6002, 12000), "human_crane_10k.obj": (10002, 20000), "makehuman_base.obj": (None, 36972),
    "rabbit_9parts.obj": (None, 1252), "spot_cow_uv.obj": (None, 5856), "stanford_bunny_holes.obj": (35947, 69451),
    "suzanne.obj": (507, 968), "nasty/joined_tetrahedra.obj": (None, 8), "nasty/negative_indices.obj": (None, 12),
    "nasty/not_convex.obj": (288, 96), "nasty/wallhole.obj": (92, 66), "fuze/fuze.obj": (None, 1000),
}  # fmt: skip
"""Numbers of vertices, unless texture coordinates or normals split them, and of triangles."""

WITH_POLYGONS = {
    *("beast_32k_quads.obj", "makehuman_base.obj", "rabbit_9parts.obj", "suzanne.obj"),
    *("nasty/negative_indices.obj", "nasty/wallhole.obj"),
}


@pytest.mark.parametrize("name", REAL)
def test_real_files_have_the_surface_that_trimesh_finds_in_them(real_data, name):
    path = real_data / "mesh" / name
    pieces = obj.read(path, path.read_bytes()).pieces
    vertices, triangles = REAL[name]
    assert sum(len(piece.triangles) for piece in pieces) == triangles
    assert vertices in (None, sum(len(piece.positions) for piece in pieces))
    soup = np.concatenate([piece.positions[piece.triangles] for piece in pieces])
    peer = trimesh.load(path, process=False, skip_materials=True, force="mesh").triangles
    np.testing.assert_allclose(np.unique(soup.reshape(-1, 3), axis=0), np.unique(peer.reshape(-1, 3), axis=0))
    normals = [np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]).sum(axis=0) for t in (soup, peer)]
    np.testing.assert_allclose(*normals, atol=1e-9 * np.ptp(soup) ** 2)  # whichever way polygons were cut
    if name not in WITH_POLYGONS:
        in_order = [t[np.lexsort(t.reshape(-1, 9).T)] for t in (soup, peer)]
        np.testing.assert_allclose(*in_order)


def test_a_real_file_keeps_its_picture_byte_for_byte(real_data):
    path = real_data / "mesh/fuze/fuze.obj"
    surface = obj.read(path, path.read_bytes())
    material = only(surface).material
    assert material.texture.content == (path.parent / "fuze uv.jpg").read_bytes()
    assert (material.name, material.roughness, material.base_color) == ("a-super-duper-material", 1, (1, 1, 1, 1))
    assert surface.notes == ["Material 'a-super-duper-material' would be invisible and was made opaque."]


def test_texture_coordinates_of_a_real_file_are_those_of_its_corners(real_data):
    path = real_data / "mesh/spot_cow_uv.obj"
    piece = only(obj.read(path, path.read_bytes()))
    lines = [line.split() for line in path.read_text().split("\n") if line]
    v, vt = (np.array([line[1:] for line in lines if line[0] == kind], dtype=float) for kind in ("v", "vt"))
    f = np.array([[corner.split("/")[:2] for corner in line[1:]] for line in lines if line[0] == "f"], dtype=int) - 1
    np.testing.assert_array_equal(piece.positions[piece.triangles], v[f[:, :, 0]])
    np.testing.assert_allclose(piece.uvs[piece.triangles], vt[f[:, :, 1]] * [1, -1] + [0, 1], atol=1e-15)
    assert len(piece.positions) == 3225
