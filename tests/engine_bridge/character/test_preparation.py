import dataclasses

import igl
import numpy as np
import pytest

from engine_bridge.character import preparation
from engine_bridge.character.preparation import prepare
from puppetline.errors import MeshError
from solver.model.bones import NO_BONES, Bones
from solver.model.reduced_model import ModelParameters, build
from solver.surface.mesh import weld

from ...oracles import assert_same_fields
from ..refusals import refused_place

PARAMETERS = ModelParameters(fields=2, isolines=3)


@pytest.fixture(scope="module")
def render_mesh():
    """A ball whose triangles share no corners, with one flipped triangle and one vertex without a triangle."""
    vertices, faces = igl.upsample(*igl.icosahedron(), 2)
    faces[7] = faces[7][::-1]
    return np.concatenate([vertices[faces].reshape(-1, 3), [[0, 0, 2]]]), np.arange(faces.size).reshape(-1, 3)


BONES = Bones(
    np.array([[0, 0, 0], [0, 0.2, 0]]), np.array([[0, 0.2, 0], [0, 0.9, 0]]), np.array([-1, 0]), np.zeros(2, int)
)


def test_a_preparation_equals_welding_and_building_whether_computed_or_cached_with_bones_and_a_skin_as_well(
    render_mesh, tmp_path, monkeypatch
):
    positions, _ = render_mesh
    expected = weld(*render_mesh, "ball")
    assert expected.repairs.welded
    assert expected.repairs.turned == expected.repairs.isolated == 1
    upper = np.clip(positions[:, 1] + 0.5, 0, 1)
    shares = np.stack([1 - upper, upper], axis=1)
    first = np.unique(expected.of_render, return_index=True)[1]
    for bones, given, of_mesh in ((NO_BONES, None, None), (BONES, None, None), (BONES, shares, shares[first])):
        with monkeypatch.context() as patch:
            for _ in range(2):
                mesh, model = prepare(*render_mesh, PARAMETERS, tmp_path, "ball", bones=bones, shares=given)
                assert_same_fields(mesh, expected)
                assert_same_fields(model, build(expected, PARAMETERS, bones, of_mesh))
                patch.setattr(preparation, "weld", None)  # the second time neither is called
                patch.setattr(preparation, "build", None)


def test_vertices_that_refine_a_coarse_skin_follow_the_bone_of_the_nearest_vertex_of_their_part(tmp_path, monkeypatch):
    """Each of two boxes follows a bone of its own."""
    box, faces = igl.bounding_box(np.array([[-1.0, -1, -1], [1, 1, 1]]))
    positions, triangles = np.concatenate([box, np.add(box, (3, 0, 0))]), np.concatenate([faces, faces + len(box)])
    shares, followed = np.repeat(np.eye(2), len(box), axis=0), []

    def build(mesh, _parameters, _bones, of_mesh):
        followed.append((mesh, of_mesh))
        raise KeyboardInterrupt

    monkeypatch.setattr(preparation, "build", build)
    with pytest.raises(KeyboardInterrupt):
        prepare(positions, triangles, PARAMETERS, tmp_path, bones=BONES, shares=shares)
    [(mesh, of_mesh)] = followed
    assert len(mesh.vertices) > len(positions)
    assert mesh.parts == 2
    np.testing.assert_array_equal(of_mesh, np.eye(2)[mesh.components])


def test_a_changed_mesh_parameter_bone_or_skin_is_prepared_again_and_another_name_is_not(render_mesh, tmp_path):
    positions, triangles = render_mesh
    turned = triangles.copy()
    turned[3] = turned[3][[1, 2, 0]]
    for arrays in ((positions, triangles), (positions + 1e-9, triangles), (positions, turned)):
        for parameters in (PARAMETERS, ModelParameters(fields=3, isolines=3), ModelParameters(fields=2, isolines=4)):
            prepare(*arrays, parameters, tmp_path)
    shares = np.tile([0.5, 0.5], (len(positions), 1))
    longer = dataclasses.replace(BONES, tails=1.01 * BONES.tails)
    for bones, given in ((BONES, None), (longer, None), (BONES, shares), (BONES, shares[:, ::-1] ** 2)):
        prepare(*render_mesh, PARAMETERS, tmp_path, bones=bones, shares=given)
    assert len(list(tmp_path.iterdir())) == 9 + 4
    assert [prepare(*render_mesh, PARAMETERS, tmp_path, name)[0].name for name in ("one", "other")] == ["one", "other"]
    assert len(list(tmp_path.iterdir())) == 9 + 4


def test_a_mesh_that_cannot_be_prepared_is_refused_each_time(tmp_path):
    point = np.zeros((3, 3)), np.array([[0, 1, 2]]), PARAMETERS, tmp_path, "point.obj"
    for _ in range(2):
        assert refused_place(MeshError, "point.obj", prepare, *point) == ""
    assert list(tmp_path.iterdir()) == []
