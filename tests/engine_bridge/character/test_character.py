import igl
import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose

from engine_bridge.character import meshopt
from engine_bridge.character.character import load_character, make_character
from engine_bridge.character.document_reader import COMPRESSIONS, UNPACK_COMMAND
from engine_bridge.character.materials import preview_colors
from puppetline.errors import MeshError

from ..refusals import refused, refused_place
from .conftest import CORNERS, SIDES


def test_every_variant_gives_the_same_world_positions_normals_and_welded_surface(variant, blob):
    character = load_character(variant.path)
    for part, shown in zip(character.parts, variant.shown, strict=True):
        assert_allclose(part.vertices, shown, atol=2e-6)
    assert len(character.document.notes) == (variant.name == "mixed_primitives")  # they are not moved
    mesh = character.solver_mesh()
    halves = variant.name == "shared_mesh"  # of a figure that is not symmetric
    if not halves:
        assert (len(mesh.vertices), len(mesh.faces)) == (len(blob.vertices), len(blob.faces))
    if any(part.normals is None for part in character.parts):
        assert variant.name in ("mixed_primitives", "bare_scene")
        return
    normals = np.concatenate([part.normals for part in character.parts])
    assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    outward = igl.per_vertex_normals(mesh.vertices, mesh.faces)[mesh.of_render]
    away_from_the_seam = np.abs(character.vertices[:, 0]) > (0.3 if halves else -1)
    assert (normals * outward).sum(axis=1)[away_from_the_seam].min() > 0.9


def test_a_character_of_arrays_keeps_its_colours_to_a_byte(blob, tmp_path, assert_valid_gltf):
    made = make_character("figure", blob.vertices.astype(np.float64), blob.faces, blob.colors)
    made.document.save(tmp_path / "figure.glb")
    assert_valid_gltf(tmp_path / "figure.glb")
    again = load_character(tmp_path / "figure.glb")
    assert_allclose(preview_colors(again), blob.colors, atol=0.5 / 255 + 1e-6)
    assert_allclose(
        again.parts[0].normals, igl.per_vertex_normals(blob.vertices.astype(np.float64), blob.faces), atol=1e-5
    )


def without_weights(glb):
    glb.node(glb.mesh(glb.primitive(CORNERS, SIDES)), skin=0)
    glb.node(name="bone")
    glb.file.skins = [gltf.Skin(joints=[1])]


def points(glb):
    glb.show(CORNERS, mode=gltf.POINTS)


def foreign_index(glb):
    wrong = SIDES.copy()
    wrong[0, 0] = 5  # of another primitive
    glb.node(glb.mesh(glb.primitive(CORNERS, wrong), glb.primitive(CORNERS + 2, SIDES)))


def few(attribute):
    """Return a function that shows a primitive whose attribute has a row too few."""
    return lambda glb: glb.show(CORNERS, SIDES, **{attribute: np.ones((3, 3), np.float32)})


@pytest.mark.parametrize(
    ("damage", "place"),
    [
        (without_weights, "skins[0]"),
        (points, ""),
        (foreign_index, "meshes[0].primitives[0].indices"),
        (few("NORMAL"), "accessors[1]"),
        (few("COLOR_0"), "accessors[1]"),
    ],
)
def test_primitives_that_do_not_fit_are_refused_with_their_place(glb, tmp_path, damage, place):
    damage(glb)
    path = glb.save(tmp_path / "a.glb")
    assert refused_place(MeshError, path, load_character, path) == place


@pytest.mark.parametrize("extension", COMPRESSIONS[1:])
def test_packed_data_is_refused_with_the_command_that_unpacks_it(glb, tmp_path, extension, monkeypatch):
    monkeypatch.setattr(meshopt, "is_installed", lambda: False)
    glb.show(CORNERS, SIDES)
    glb.file.extensionsRequired = glb.file.extensionsUsed = [extension]
    fix = refused(MeshError, load_character, glb.save(tmp_path / "a.glb")).fix
    assert UNPACK_COMMAND in fix
    assert ("pip install" in fix) == (extension == "EXT_meshopt_compression")


@pytest.mark.parametrize("children", [[0], [1, 1], [99], [-1]])
def test_nodes_that_are_no_tree_are_refused(glb, tmp_path, children):
    mesh = glb.mesh(glb.primitive(CORNERS, SIDES))
    glb.node(mesh, children=children)
    glb.node(mesh, parent=0)
    glb.file.nodes[0].children = children
    refused(MeshError, load_character, glb.save(tmp_path / "a.glb"))
