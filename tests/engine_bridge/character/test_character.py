import json

import igl
import numpy as np
import pygltflib as gltf
import pytest

from engine_bridge.character import meshopt
from engine_bridge.character.character import load_character, make_character
from engine_bridge.character.document_reader import COMPRESSIONS, UNPACK_COMMAND
from engine_bridge.character.materials import preview_colors
from puppetline.errors import MeshError

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
SIDES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.uint16)


def test_every_variant_gives_the_same_world_positions(variant, blob):
    character = load_character(variant.path)
    assert len(character.parts) == len(variant.shown)
    for part, shown in zip(character.parts, variant.shown, strict=True):
        np.testing.assert_allclose(part.vertices, shown, atol=2e-6)
        if part.normals is not None:
            np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1, atol=1e-6)
    assert len(character.vertices) == sum(map(len, variant.shown))


def test_every_variant_of_the_whole_figure_welds_to_the_same_surface(variant, blob):
    if variant.name == "shared_mesh":
        return  # it shows half of the figure and its mirror image, and the figure is not symmetric
    mesh = load_character(variant.path).solver_mesh()
    assert (len(mesh.vertices), len(mesh.faces)) == (len(blob.vertices), len(blob.faces))
    area = igl.doublearea(blob.vertices.astype(np.float64), blob.faces).sum()
    assert igl.doublearea(mesh.vertices, mesh.faces).sum() == pytest.approx(area, rel=1e-5)


def test_world_normals_point_out_of_the_surface_in_every_variant(variant):
    character = load_character(variant.path)
    if character.parts[0].normals is None:
        assert variant.name == "without_normals"
        return
    mesh = character.solver_mesh()
    outward = igl.per_vertex_normals(mesh.vertices, mesh.faces)[mesh.of_render]
    normals = np.concatenate([part.normals for part in character.parts])
    away_from_the_seam = np.abs(character.vertices[:, 0]) > (0.3 if variant.name == "shared_mesh" else -1)
    assert (normals * outward).sum(axis=1)[away_from_the_seam].min() > 0.9


def test_points_and_lines_are_noted(variants):
    assert load_character(variants["with_lines"].path).document.notes == ["mesh 0: points and lines are not moved"]
    assert load_character(variants["textured"].path).document.notes == []


def test_strips_and_fans_turn_the_way_their_triangles_do(glb, tmp_path):
    square = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]])
    around = square[[0, 1, 3, 5, 4]]
    glb.node(
        glb.mesh(
            glb.primitive(square, mode=gltf.TRIANGLE_STRIP),
            glb.primitive(around, mode=gltf.TRIANGLE_FAN),
            glb.primitive(CORNERS, SIDES),
        )
    )
    strip, fan, _ = load_character(glb.save(tmp_path / "a.glb")).parts
    assert strip.triangles.tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]]
    assert fan.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    for part in (strip, fan):
        a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
        assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_a_picture_shows_vertex_colours_times_the_materials_colour(glb, tmp_path):
    glb.file.materials = [gltf.Material(pbrMetallicRoughness=gltf.PbrMetallicRoughness(baseColorFactor=[0.5, 1, 0, 1]))]
    rgba = np.uint8([[255, 51, 9, 255]] * 4)
    plain = glb.primitive(CORNERS, SIDES)
    painted = glb.primitive(CORNERS, SIDES, COLOR_0=rgba, material=0)
    glb.node(glb.mesh(plain, painted))
    character = load_character(glb.save(tmp_path / "a.glb"))
    np.testing.assert_allclose(preview_colors(character), [[0.6] * 3] * 4 + [[0.5, 0.2, 0]] * 4, atol=1e-7)


@pytest.mark.parametrize("ending", ["obj", "off", "ply", "stl"])
def test_a_surface_file_becomes_a_document_with_the_same_surface(blob, tmp_path, ending, assert_valid_gltf):
    path = tmp_path / f"figure.{ending}"
    igl.writeOBJ(str(path), blob.vertices, blob.faces) if ending == "obj" else igl.write_triangle_mesh(
        str(path), blob.vertices.astype(np.float64), blob.faces
    )
    character = load_character(path)
    mesh = character.solver_mesh()
    assert (len(mesh.vertices), len(mesh.faces)) == (len(blob.vertices), len(blob.faces))
    if ending != "stl":  # its vertices are its triangles' own
        np.testing.assert_allclose(character.vertices, blob.vertices, atol=1e-5)
        np.testing.assert_array_equal(character.triangles, blob.faces)
    character.document.save(tmp_path / "figure.glb")
    assert_valid_gltf(tmp_path / "figure.glb")
    again = load_character(tmp_path / "figure.glb")
    np.testing.assert_array_equal(again.triangles, character.triangles)
    np.testing.assert_allclose(again.vertices, character.vertices, atol=1e-6)


def test_a_character_of_arrays_keeps_its_colours_to_a_byte(blob, tmp_path, assert_valid_gltf):
    made = make_character("figure", blob.vertices.astype(np.float64), blob.faces, blob.colors)
    made.document.save(tmp_path / "figure.glb")
    assert_valid_gltf(tmp_path / "figure.glb")
    again = load_character(tmp_path / "figure.glb")
    np.testing.assert_allclose(preview_colors(again), blob.colors, atol=0.5 / 255 + 1e-6)
    np.testing.assert_allclose(
        again.parts[0].normals, igl.per_vertex_normals(blob.vertices.astype(np.float64), blob.faces), atol=1e-5
    )


def refused(path):
    with pytest.raises(MeshError) as error:
        load_character(path)
    return error.value


def test_a_skin_that_lacks_what_it_needs_is_refused(glb, tmp_path):
    node = glb.node(glb.mesh(glb.primitive(CORNERS, SIDES), name="wolf"))
    glb.node(name="bone")
    glb.file.nodes[node].skin = 0
    glb.file.skins = [gltf.Skin(joints=[1])]
    path = glb.save(tmp_path / "a.glb")
    error = refused(path)
    assert (error.where, error.found) == (f"{path}, skins[0]", "a primitive without joints and weights")


@pytest.mark.parametrize("extension", COMPRESSIONS[1:])
def test_packed_data_is_refused_with_the_command_that_unpacks_it(glb, tmp_path, extension, monkeypatch):
    monkeypatch.setattr(meshopt, "is_installed", lambda: False)
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES)))
    glb.file.extensionsRequired = glb.file.extensionsUsed = [extension]
    error = refused(glb.save(tmp_path / "a.glb"))
    assert error.found == f"data compressed with {extension}"
    assert error.fix == f"Decompress the file: {UNPACK_COMMAND}" + {
        "EXT_meshopt_compression": ", or install the package that reads it: pip install 'puppetline[meshopt]'"
    }.get(extension, "")


def test_a_scene_without_triangles_is_refused(glb, tmp_path):
    glb.node(glb.mesh(glb.primitive(CORNERS, mode=gltf.POINTS)))
    assert refused(glb.save(tmp_path / "a.glb")).found == "no triangles in the scene"


@pytest.mark.parametrize("children", [[0], [1], [1, 1], [99], [-1]])
def test_nodes_that_are_no_tree_are_refused(glb, tmp_path, children):
    mesh = glb.mesh(glb.primitive(CORNERS, SIDES))
    glb.node(mesh)
    glb.node(mesh, parent=0)
    glb.file.nodes[1].children = [0] if children == [0] else []
    glb.file.nodes[0].children = children if children != [0] else [1]
    path = glb.save(tmp_path / "a.glb")
    if children == [1]:
        assert len(load_character(path).parts) == 2
    else:
        assert refused(path).found in (
            "a node that is its own ancestor, or has two parents",
            "a description that is not glTF (nodes[0].children[0]: number 99 of 2 nodes)",
            "a description that is not glTF (nodes[0].children[0]: Input should be greater than or equal to 0)",
        )


def test_a_file_without_a_mesh_is_refused(tmp_path):
    assert refused(tmp_path / "none.glb").found == "no such file"
    (tmp_path / "song.mp3").write_bytes(b"ID3")
    assert refused(tmp_path / "song.mp3").found == "no mesh in a supported format"


def test_a_file_is_known_by_its_content_whatever_its_ending(variants, tmp_path):
    path = tmp_path / "renamed.obj"
    path.write_bytes(variants["textured"].path.read_bytes())
    assert len(load_character(path).parts) == 1


def test_an_index_beyond_its_own_primitive_is_refused_though_another_has_more_vertices(glb, tmp_path):
    wrong = SIDES.copy()
    wrong[0, 0] = 5
    glb.node(glb.mesh(glb.primitive(CORNERS, wrong), glb.primitive(CORNERS + 2, SIDES)))
    with pytest.raises(MeshError, match="vertex 5 of 4"):
        load_character(glb.save(tmp_path / "a.glb"))


@pytest.mark.parametrize("name", ["NORMAL", "COLOR_0"])
def test_an_attribute_with_another_count_than_the_positions_is_refused(glb, tmp_path, name):
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES, **{name: np.ones((3, 3), np.float32)})))
    with pytest.raises(MeshError, match="3 values for 4 vertices"):
        load_character(glb.save(tmp_path / "a.glb"))


MARK = np.float32(0.7)
"""A coordinate that is replaced in a file."""


def save_as_gltf(glb, path):
    """Save a file as JSON with its binary data beside it."""
    content = glb.save(path.with_suffix(".glb")).read_bytes()
    length = int.from_bytes(content[12:16], "little")
    description = json.loads(content[20 : 20 + length])
    description["buffers"][0]["uri"] = "a.bin"
    path.with_name("a.bin").write_bytes(content[28 + length :])
    path.write_text(json.dumps(description))
    return path.with_name("a.bin")


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
@pytest.mark.parametrize("ending", [".glb", ".gltf"])
def test_a_position_that_is_not_finite_is_refused_with_its_place(glb, tmp_path, ending, value):
    marked = CORNERS.copy()
    marked[2, 1] = MARK
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES), glb.primitive(marked, SIDES)))
    path = tmp_path / f"a{ending}"
    data = glb.save(path) if ending == ".glb" else save_as_gltf(glb, path)
    assert len(load_character(path).parts) == 2
    data.write_bytes(data.read_bytes().replace(MARK.tobytes(), np.float32(value).tobytes()))
    error = refused(path)
    assert error.where == f"{path}, meshes[0].primitives[1].attributes.POSITION"
    assert error.found == "a position of vertex 2 that is not finite or too large"


def test_a_morph_target_at_rest_that_is_not_finite_is_refused(glb, tmp_path):
    primitive = glb.primitive(CORNERS, SIDES)
    moved = np.zeros_like(CORNERS)
    moved[3, 0] = MARK
    primitive.targets = [gltf.Attributes(POSITION=glb.add(moved))]
    glb.node(glb.mesh(primitive, weights=[0.5]))
    path = glb.save(tmp_path / "a.glb")
    assert load_character(path).vertices[3, 0] == 0.5 * MARK
    path.write_bytes(path.read_bytes().replace(MARK.tobytes(), np.float32(np.inf).tobytes()))
    assert refused(path).found == "a position of vertex 3 that is not finite or too large"
