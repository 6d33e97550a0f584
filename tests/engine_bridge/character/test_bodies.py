import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_array_equal

import puppetline as pl
from engine_bridge.character.bodies import bodies_of, with_body
from engine_bridge.character.character import from_document, load_character, make_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.evaluation import Evaluation
from engine_bridge.character.materials import preview_colors
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.proposal import new_puppet
from puppetline.errors import PuppetError

from ..refusals import refused


@pytest.fixture(scope="module")
def hall(blob, tmp_path_factory):
    """A file of one surface: two figures on a floor, with colours by height."""
    low, reach = blob.vertices.min(axis=0), 4 * np.ptp(blob.vertices, axis=0).max()
    count, aside = len(blob.vertices), np.array([0.7 * reach, 0.0, 0.0])
    floor = [[x * reach, low[1], z * reach] for x, z in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    vertices = np.concatenate([blob.vertices, floor, blob.vertices + aside])
    faces = np.concatenate([blob.faces, np.array([[0, 2, 1], [0, 3, 2]]) + count, blob.faces + count + 4])
    colors = np.repeat((vertices[:, 1:2] - low[1]) / np.ptp(vertices[:, 1]), 3, axis=1)
    path = tmp_path_factory.mktemp("hall") / "hall.glb"
    make_character("hall", vertices, faces, colors).document.save(path)
    return path


def triangles_of(character):
    """The corners of all triangles with their colours, sorted."""
    values = np.hstack([character.vertices, preview_colors(character)])[character.triangles].reshape(-1, 18)
    return values[np.lexsort(values.T)]


@pytest.mark.parametrize("number", [1, 2])
def test_a_file_with_one_body_chosen_shows_the_same_triangles(hall, number, blob, tmp_path, assert_valid_gltf):
    whole = load_character(hall)
    chosen = with_body(whole, bodies_of(whole), number, "here")
    assert len(chosen.vertices) == len(blob.vertices)
    assert_array_equal(chosen.vertices, whole.vertices[bodies_of(whole) == number])
    assert_array_equal(triangles_of(chosen.whole), triangles_of(whole))
    chosen.document.save(tmp_path / "chosen.glb")
    assert_valid_gltf(tmp_path / "chosen.glb")
    assert_array_equal(triangles_of(from_document(load_document(tmp_path / "chosen.glb"))), triangles_of(whole))


def test_a_file_of_one_body_stays_as_it_is(blob_file):
    character = load_character(blob_file)
    assert with_body(character, bodies_of(character), 1, "here") is character


@pytest.mark.parametrize("is_circle", [False, True])
def test_joints_that_no_scene_shows_hold_a_skin_together(glb, tmp_path, is_circle):
    joints = [glb.node(name="a"), glb.node(name="b")]
    glb.file.nodes[joints[0]].children = [joints[1]]
    if is_circle:
        glb.file.nodes[joints[1]].children = [joints[0]]
    glb.file.skins = [gltf.Skin(joints=joints[::-1])]
    places = np.array([[x + a, b, 0] for x in (0, 3) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))], np.float32)
    faces = np.array([[0, 2, 1], [0, 3, 2], [4, 6, 5], [4, 7, 6]], np.uint32)
    follows = {"JOINTS_0": np.zeros((8, 4), np.uint8), "WEIGHTS_0": np.eye(4, dtype=np.float32)[[0] * 8]}
    primitive = glb.primitive(places, faces, **follows)
    glb.file.scenes[0].nodes = [glb.node(glb.mesh(primitive), skin=0)]
    assert_array_equal(bodies_of(load_character(glb.save(tmp_path / "skinned.glb"))), np.ones(8))


def test_a_body_that_the_file_does_not_show_is_refused(hall):
    whole = load_character(hall)
    assert refused(PuppetError, with_body, whole, bodies_of(whole), 3, "here").where == "here"


@pytest.mark.parametrize("form", ["rig", "morph"])
def test_one_body_moves_and_everything_else_stays(hall, form, take, tmp_path):
    puppet = tmp_path / "hall.toml"
    puppet_file.dump(new_puppet(hall, puppet, body=2, up="y", front="z").puppet, puppet)
    pl.load(puppet).convert(take, tmp_path / "moved.glb", form=form)
    document, own = load_document(tmp_path / "moved.glb"), load_prepared(puppet).character
    times = np.linspace(0, 1, 5)
    for still in Evaluation(document, own.still).positions(times):
        assert_array_equal(still, np.concatenate([part.vertices for part in own.still]))
    first, *_, last = Evaluation(document, own.parts).positions(times)
    assert np.abs(last - first).max() > 0.01 * np.ptp(own.vertices[:, 1])
