"""Controls evaluated in C#, and by the shader's arithmetic, against the vertices of the same recorded frames."""

import base64
import shutil
import subprocess

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Kind

from ...recorded import VECTORS, decoded
from .conftest import HERE, PACKAGE, array

UNITY = np.float32([-1, 1, 1])


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


def blended(scene, controls):
    """(n, 3, 4) matrices, as docs/protocol.md has them, in double precision."""
    facts, t = scene.facts, scene.arrays["ladder"].astype(float)
    T = controls.astype(float).reshape(facts["fields"], facts["isolines"], 3, 4)
    k = np.minimum(np.floor(t), facts["isolines"] - 2).astype(int)
    fields = np.arange(facts["fields"])
    steps = T[fields, k + 1] - T[fields, k]
    return np.einsum("i,vixy->vxy", facts["weights"], T[fields, k] + (t - k)[..., None, None] * steps)


def cofactor_normals(scene, controls):
    linear = blended(scene, controls)[:, :, :3]
    turned = np.einsum("vji,vj->vi", np.linalg.inv(linear), scene.arrays["normals"]) * np.linalg.det(linear)[:, None]
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def test_positions_and_the_surfaces_own_normals_are_those_of_the_service(evaluated, scene):
    number, made = evaluated
    positions, normals, *_ = made["Slopes", "File"]
    expected = decoded(f"{number}.vertices")
    assert np.abs(positions - expected.positions).max() <= 1e-6 * scene.facts["diagonal"]
    assert np.abs(normals - expected.normals).max() <= 1e-5


def test_quick_normals_are_those_of_the_cofactor_matrix(evaluated, scene):
    number, made = evaluated
    positions, normals, *_ = made["Cofactors", "File"]
    np.testing.assert_allclose(positions, made["Slopes", "File"][0], rtol=0, atol=1e-6 * scene.facts["diagonal"])
    np.testing.assert_allclose(normals, cofactor_normals(scene, decoded(f"{number}.controls")), rtol=0, atol=1e-5)


@pytest.mark.parametrize("normals", ["Slopes", "Cofactors"])
def test_in_unitys_axes_x_is_negated_and_nothing_else(evaluated, normals):
    for ours, unitys in zip(evaluated[1][normals, "File"][:2], evaluated[1][normals, "Unity"][:2], strict=True):
        np.testing.assert_array_equal(unitys, ours * UNITY)


def test_triangles_turned_over_face_outwards_in_unitys_axes(run_core, scene):
    *_, last = run_core("evaluate", VECTORS / "scene.bin", VECTORS / "0.controls.bin")
    turned = array(last["turned"], np.int32, 3)
    corners = (scene.arrays["positions"] * UNITY)[turned]
    # a left-handed engine looks at clockwise triangles: what the right-hand rule says of them points inwards
    inwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = (scene.arrays["normals"] * UNITY)[turned].sum(axis=1)
    assert (np.sum(-inwards * -outwards, axis=1) > 0).all()
    assert sorted(map(tuple, np.sort(turned))) == sorted(map(tuple, np.sort(scene.arrays["triangles"])))


@pytest.mark.parametrize("axes", ["File", "Unity"])
def test_boxes_are_around_all_vertices_and_the_cheap_one_is_not_much_larger(evaluated, scene, axes):
    positions, _, box, around = evaluated[1]["Slopes", axes]
    low, high = positions.min(axis=0), positions.max(axis=0)
    np.testing.assert_array_equal(np.float32(box), np.concatenate([low, high]))
    slack = 1e-6 * scene.facts["diagonal"]
    assert (np.float32(around[:3]) <= low + slack).all()
    assert (np.float32(around[3:]) >= high - slack).all()
    assert np.linalg.norm(np.subtract(around[3:], around[:3])) <= 1.5 * np.linalg.norm(high - low)


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


BLOCK = 3
"""The number of the character's block; others are before and after it."""


def streams(scene):
    """Return what the mesh gets once, as docs/unity.md has it: rest pose, block, isoline coordinates and slopes."""
    arrays, fields = scene.arrays, scene.facts["fields"]
    moving = np.hstack([arrays["positions"] * UNITY, arrays["normals"] * UNITY])
    constant = np.zeros((len(moving), 26), np.float32)
    constant[:, 0] = BLOCK
    constant[:, 2 : 2 + fields] = arrays["ladder"]
    constant[:, 10 : 10 + 2 * fields] = arrays["slopes"].reshape(len(moving), -1)
    return moving, constant


def rows_of(facts, controls):
    """Return the transforms as rows, multiplied by the weights of their fields."""
    weighted = np.float32(facts["weights"])[:, None, None] * controls.reshape(facts["fields"], -1, 4)
    return weighted.reshape(-1, 4)


def blocks_with(facts, shown, before):
    """Return the shader's rows: blocks of noise, and the character's with two poses."""
    rows = np.random.default_rng(0).normal(size=(5 * 512, 4)).astype(np.float32)
    start = BLOCK * 512
    rows[start] = facts["fields"], facts["isolines"], 241, 1
    for place, controls in ((241, shown), (1, before)):
        values = rows_of(facts, controls)
        rows[start + place : start + place + len(values)] = values
    return rows


@pytest.mark.parametrize("number", range(3))
def test_the_shaders_arithmetic_is_the_services(shader, scene, number):
    facts = scene.facts
    controls, controls_before = decoded(f"{number}.controls"), decoded(f"{(number + 1) % 3}.controls")
    by_slopes, by_cofactors, before = shader(blocks_with(facts, controls, controls_before), *streams(scene))
    expected = decoded(f"{number}.vertices")
    for points in (by_slopes, by_cofactors):
        assert np.abs(points[:, :3] * UNITY - expected.positions).max() <= 1e-6 * facts["diagonal"]
    assert np.abs(by_slopes[:, 3:] * UNITY - expected.normals).max() <= 1e-5
    normals = cofactor_normals(scene, controls.reshape(facts["fields"], facts["isolines"], 3, 4))
    np.testing.assert_allclose(by_cofactors[:, 3:] * UNITY, normals, rtol=0, atol=1e-5)
    moved_from = decoded(f"{(number + 1) % 3}.vertices").positions
    assert np.abs(before * UNITY - moved_from).max() <= 1e-6 * facts["diagonal"]


def test_without_transforms_the_shader_leaves_vertices_as_they_are(shader, scene):
    moving, constant = streams(scene)
    by_slopes, by_cofactors, before = shader(np.zeros((5 * 512, 4), np.float32), moving, constant)
    for points in (by_slopes, by_cofactors):
        np.testing.assert_array_equal(points, moving)
    np.testing.assert_array_equal(before, moving[:, :3])


@pytest.fixture(scope="module")
def webgl_shader(tmp_path_factory):
    """The vertex shader for OpenGL ES 3.0, by way of SPIR-V as Unity's compiler for it goes by way of bytecode."""
    for program in ("glslangValidator", "spirv-cross"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not here (Debian: glslang-tools, spirv-cross)")
    spirv = tmp_path_factory.mktemp("webgl") / "vertex.spv"
    include = f"-I{PACKAGE / 'Runtime' / 'Resources'}"
    mapped = ["--auto-map-bindings", "--auto-map-locations", "-DSHADER_API_GLES3=1", include]
    source = HERE / "programs" / "feedback.hlsl"
    compiled = subprocess.run(
        ["glslangValidator", "-D", "-V", "-S", "vert", "-e", "main", *mapped, "-o", spirv, source],
        capture_output=True,
        text=True,
        check=False,
    )
    assert compiled.returncode == 0, compiled.stdout
    translate = ["spirv-cross", spirv, "--es", "--version", "300", "--stage", "vert"]
    return subprocess.run(translate, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("number", range(3))
def test_a_browser_computes_the_services_vertices_with_the_shader(browser, webgl_shader, scene, number):
    """WebGL 2, which has the transforms in a texture; positions, normals and positions before come back."""
    facts, other = scene.facts, (number + 1) % 3
    rows = blocks_with(facts, decoded(f"{number}.controls"), decoded(f"{other}.controls"))
    moving, constant = streams(scene)
    place = {"positionOS": 0, "normalOS": 3, "block": 6, "isolines0": 8, "isolines1": 12}
    place |= {f"slopes{k}": 16 + 4 * k for k in range(4)}
    given = {
        "shader": webgl_shader,
        "rows": base64.b64encode(rows.tobytes()).decode(),
        "vertices": base64.b64encode(np.hstack([moving, constant]).astype(np.float32).tobytes()).decode(),
        "place": place,
        "stride": 32,
    }
    page = browser.new_page()
    told = page.evaluate((HERE / "programs" / "feedback.js").read_text(), given)
    page.close()
    assert told["error"] == ""
    position, normal, before = np.split(array(told["values"], columns=9), 3, axis=1)
    expected = decoded(f"{number}.vertices")
    assert np.abs(position * UNITY - expected.positions).max() <= 1e-6 * facts["diagonal"]
    assert np.abs(normal * UNITY - expected.normals).max() <= 1e-5
    assert np.abs(before * UNITY - decoded(f"{other}.vertices").positions).max() <= 1e-6 * facts["diagonal"]
