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


def blocks_with(facts, shown, before):
    """Return the shader's rows: blocks of noise, and the character's with two poses."""
    rows = np.random.default_rng(0).normal(size=(5 * 512, 4)).astype(np.float32)
    start = BLOCK * 512
    rows[start] = facts["fields"], facts["isolines"], 241, 1
    for place, controls in ((241, shown), (1, before)):
        weighted = np.float32(facts["weights"])[:, None, None] * controls.reshape(facts["fields"], -1, 4)
        rows[start + place :][: weighted.size // 4] = weighted.reshape(-1, 4)
    return rows


@pytest.fixture(params=range(3))
def posed(request, scene):
    """The shader's rows for a frame, with another one before it, and a comparison of what it makes of them."""
    number, other, facts = request.param, (request.param + 1) % 3, scene.facts
    expected, earlier = decoded(f"{number}.vertices"), decoded(f"{other}.vertices").positions

    def check(positions, normals, before):
        assert np.abs(positions * UNITY - expected.positions).max() <= 1e-6 * facts["diagonal"]
        assert np.abs(normals * UNITY - expected.normals).max() <= 1e-5
        assert np.abs(before * UNITY - earlier).max() <= 1e-6 * facts["diagonal"]

    controls = decoded(f"{number}.controls")
    return blocks_with(facts, controls, decoded(f"{other}.controls")), check, cofactor_normals(scene, controls)


def test_the_shaders_arithmetic_is_the_services(shader, scene, posed):
    rows, check, quick = posed
    by_slopes, by_cofactors, before = shader(rows, *streams(scene))
    check(by_slopes[:, :3], by_slopes[:, 3:], before)
    np.testing.assert_allclose(by_cofactors[:, :3], by_slopes[:, :3], rtol=0, atol=1e-6 * scene.facts["diagonal"])
    np.testing.assert_allclose(by_cofactors[:, 3:] * UNITY, quick, rtol=0, atol=1e-5)


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


def test_a_browser_computes_the_services_vertices_with_the_shader(browser, webgl_shader, scene, posed):
    """WebGL 2, which has the transforms in a texture; positions, normals and positions before come back."""
    rows, check, _ = posed
    place = {"positionOS": 0, "normalOS": 3, "block": 6, "isolines0": 8, "isolines1": 12}
    place |= {f"slopes{k}": 16 + 4 * k for k in range(4)}
    vertices = np.hstack(streams(scene)).astype(np.float32)
    given = {"shader": webgl_shader, "place": place, "stride": 32}
    given |= {
        name: base64.b64encode(each.tobytes()).decode() for name, each in (("rows", rows), ("vertices", vertices))
    }
    page = browser.new_page()
    told = page.evaluate((HERE / "programs" / "feedback.js").read_text(), given)
    page.close()
    assert told["error"] == ""
    check(*np.split(array(told["values"], columns=9), 3, axis=1))
