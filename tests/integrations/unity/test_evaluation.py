"""Controls evaluated in C#, and by the shader's arithmetic, against the vertices of the same recorded frames."""

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Kind

from ...recorded import VECTORS, decoded
from .conftest import UNITY, array, cofactor_normals


@pytest.fixture(scope="module")
def scene():
    return decoded("scene")


@pytest.fixture(scope="module", params=range(3))
def evaluated(request, run_core):
    """Frame number, and what was made of it: (positions, normals, box, box around) by kind of normals and axes."""
    *kinds, _ = run_core("evaluate", VECTORS / "scene.bin", VECTORS / f"{request.param}.controls.bin")
    made = {}
    for each in kinds:
        positions, normals = np.split(array(each["vertices"], columns=6), 2, axis=1)
        made[each["normals"], each["axes"]] = positions, normals, each["box"], each["around"]
    return request.param, made


def test_positions_and_both_kinds_of_normals_are_those_of_the_service(evaluated, scene):
    """In Unity's axes, x is negated. Boxes are around all vertices, and the cheap one is not much larger."""
    number, made = evaluated
    expected, diagonal = decoded(f"{number}.vertices"), scene.facts["diagonal"]
    quick = cofactor_normals(scene, decoded(f"{number}.controls"))
    for by, normals in (("Slopes", expected.normals), ("Cofactors", quick)):
        assert np.abs(made[by, "File"][0] - expected.positions).max() <= 1e-6 * diagonal
        np.testing.assert_allclose(made[by, "File"][1], normals, rtol=0, atol=1e-5)
        for ours, unitys in zip(made[by, "File"][:2], made[by, "Unity"][:2], strict=True):
            np.testing.assert_array_equal(unitys, ours * UNITY)
    for positions, _, box, around in (made["Slopes", "File"], made["Slopes", "Unity"]):
        low, high = positions.min(axis=0), positions.max(axis=0)
        np.testing.assert_array_equal(np.float32(box), np.concatenate([low, high]))
        assert (np.float32(around[:3]) <= low + 1e-6 * diagonal).all()
        assert (np.float32(around[3:]) >= high - 1e-6 * diagonal).all()
        assert np.linalg.norm(np.subtract(around[3:], around[:3])) <= 1.5 * np.linalg.norm(high - low)


def test_triangles_turned_over_face_outwards_in_unitys_axes(run_core, scene):
    *_, last = run_core("evaluate", VECTORS / "scene.bin", VECTORS / "0.controls.bin")
    turned = array(last["turned"], np.int32, 3)
    corners = (scene.arrays["positions"] * UNITY)[turned]
    # a left-handed engine looks at clockwise triangles: what the right-hand rule says of them points inwards
    inwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = (scene.arrays["normals"] * UNITY)[turned].sum(axis=1)
    assert (np.sum(-inwards * -outwards, axis=1) > 0).all()
    assert sorted(map(tuple, np.sort(turned))) == sorted(map(tuple, np.sort(scene.arrays["triangles"])))


def test_a_voice_moves_the_rest_pose_of_the_mouth(run_core, spoken, spoken_files):
    scene, *files = spoken_files(Kind.CONTROLS)
    slack = 2e-6 * spoken[0].character.rig.mesh.diagonal
    for frame, file in zip(spoken, files, strict=True):
        evaluated, *_ = run_core("evaluate", scene, file)
        positions, normals = np.split(array(evaluated["vertices"], columns=6), 2, axis=1)
        where, turned = frame.vertices_and_normals
        assert np.abs(positions - where).max() <= slack
        assert np.abs(normals - turned).max() <= 1e-4
        assert (np.float32(evaluated["around"][:3]) <= where.min(axis=0) + slack).all()
        assert (np.float32(evaluated["around"][3:]) >= where.max(axis=0) - slack).all()
