"""Characters that three.js draws in a real browser, read back from the graphics card."""

import numpy as np
import pytest

from engine_bridge.export.shader_mesh import write_shader_mesh
from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.payloads import decode

from ...recorded import VECTORS, decoded, recorded
from ...waiting import wait_until

pytestmark = pytest.mark.slow

ALIKE = 2e-6
"""Of the diagonal, and for normals: what numbers of f32 may differ."""


LOAD = """async ([addresses, file]) => {
  const [scene, ...frames] = await Promise.all(addresses.map(load));
  window.frames_ = frames;
  const source = file ? (await new GLTFLoader().loadAsync(file)).scene : undefined;
  window.mesh = new drawing.PuppetMesh(scene.body, { source });
}"""


@pytest.fixture
def worm(open_page, site):
    """A page with the test vectors' character as `mesh` and its frames as `frames`."""
    page = open_page()
    names = ("scene", "0.controls", "1.controls", "2.controls")
    page.run(LOAD, [[site.add(VECTORS / f"{name}.bin") for name in names], None])
    return page


SHOWN = """([first, second, share]) => {
  mesh.show(frames_[first], frames_[second], share);
  const [part] = mesh.meshes;
  const { center, radius } = part.geometry.boundingSphere;
  return {
    positions: readVertices(part, mesh.uniforms, "transformed"),
    normals: readVertices(part, mesh.uniforms, "objectNormal"),
    evaluated: mesh.evaluate(),
    sphere: [...center.toArray(), radius],
  };
}"""


def test_positions_and_normals_are_those_of_the_service_and_the_sphere_holds_them(worm):
    diagonal, served = decoded("scene").facts["diagonal"], [decoded(f"{number}.vertices") for number in range(3)]
    for moment in (0, 0, 0.0), (1, 1, 0.0), (1, 2, 0.0), (1, 2, 1.0), (1, 2, 0.25), (2, 0, 0.75):
        shown = worm.run(SHOWN, moment)
        first, second, share = moment
        positions, normals = (shown[name].reshape(-1, 3) for name in ("positions", "normals"))
        # positions are linear in the transforms
        expected = (1 - share) * served[first].positions + share * served[second].positions
        assert np.abs(positions - expected).max() <= ALIKE * diagonal
        assert np.abs(shown["evaluated"]["positions"] - expected.ravel()).max() <= ALIKE * diagonal
        assert np.abs(shown["normals"] - shown["evaluated"]["normals"]).max() <= ALIKE
        if share in (0.0, 1.0):
            assert np.abs(normals - served[moment[int(share)]].normals).max() <= 1e-5
        *center, radius = shown["sphere"]
        assert np.linalg.norm(positions - center, axis=1).max() <= radius + ALIKE * diagonal
        assert radius < 2 * diagonal


@pytest.mark.parametrize("has_own_mesh", [False, True])
def test_a_voice_opens_the_mouth_of_the_mesh(open_page, site, spoken, spoken_files, tmp_path, has_own_mesh):
    page, file = open_page(), None
    if has_own_mesh:
        write_shader_mesh(tmp_path / "talking.toml", tmp_path / "own.glb")
        file = site.add(tmp_path / "own.glb")
    page.run(LOAD, [[site.add(each) for each in spoken_files(Kind.CONTROLS)], file])
    limit = ALIKE * spoken[0].character.prepared.mesh.diagonal
    for moment in (1, 1, 0.0), (1, 2, 0.0), (1, 2, 1.0), (0, 0, 0.0):
        shown = page.run(SHOWN, moment)
        where, normals = spoken[moment[int(moment[2])]].vertices_and_normals
        assert np.abs(shown["positions"] - where.ravel()).max() <= limit
        assert np.abs(shown["evaluated"]["positions"] - where.ravel()).max() <= limit
        assert np.abs(shown["normals"] - normals.ravel()).max() <= 1e-4
        *center, radius = shown["sphere"]
        assert np.linalg.norm(where - center, axis=1).max() <= radius + limit


def test_a_character_that_does_not_follow_the_root_stays_in_place(worm):
    worm.run("() => { window.mesh = new drawing.PuppetMesh(mesh.scene, { followRoot: false }); }")
    positions = worm.run(SHOWN, (1, 2, 0.5))["positions"].reshape(-1, 3)
    at_ends = [
        decoded(f"{number}.vertices").positions - decode(recorded(f"{number}.controls")).header.root
        for number in (1, 2)
    ]
    assert np.abs(positions - np.mean(at_ends, axis=0)).max() <= ALIKE * decoded("scene").facts["diagonal"]


def test_frames_of_another_size_are_not_shown(worm):
    before = worm.run(SHOWN, (1, 1, 0.0))["positions"]
    worm.run("() => { frames_[2] = { ...frames_[2], body: frames_[2].body.subarray(12) }; }")
    assert (worm.run(SHOWN, (2, 2, 0.0))["positions"] == before).all()


def test_tangents_turn_with_the_surface(worm):
    scene = decoded("scene")
    normals = scene.arrays["normals"].astype(float)
    along = np.cross([0.3, -0.5, 0.8], normals)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    tangents = np.column_stack([along, np.ones(len(along))]).astype(np.float32)
    rest = worm.run(TANGENTS, [tangents.ravel().tolist(), 0])
    assert np.abs(rest.reshape(-1, 3) - along).max() <= 1e-5
    moved = worm.run(TANGENTS, [tangents.ravel().tolist(), 1]).reshape(-1, 3)
    new_normals = decoded("1.vertices").normals
    assert np.abs(np.linalg.norm(moved, axis=1) - 1).max() <= 1e-5
    assert np.abs((moved * new_normals).sum(axis=1)).max() <= 1e-5
    assert np.abs(moved - along).max() > 0.1


TANGENTS = """([tangents, number]) => {
  mesh.show(frames_[number], frames_[number], 0);
  const [part] = mesh.meshes;
  const geometry = part.geometry.clone();
  geometry.setAttribute("tangent", new THREE.BufferAttribute(new Float32Array(tangents), 4));
  return readVertices(new THREE.Mesh(geometry), mesh.uniforms, "objectTangent", { USE_TANGENT: "" });
}"""


FOLLOW = """async ([address, file]) => {
  const source = file && (await new GLTFLoader().loadAsync(file)).scene;
  source?.traverse((each) => { if (each.isMesh) each.material.color.set(1, 0, 0); });
  window.client = new puppetline.Client(address);
  window.puppet = new drawing.Puppet(client, "blob", source ? { source: () => source } : {});
  window.vertices = new Map();
  client.subscribe("blob/vertices", (message) => vertices.set(message.header.sequence, message.body));
  window.scene = new THREE.Scene().add(puppet, new THREE.HemisphereLight(0xffffff, 0x444444, 3));
  scene.background = new THREE.Color(0x204060);
  window.camera = new THREE.PerspectiveCamera(40, innerWidth / innerHeight, 0.1, 100);
  camera.position.set(0, 1, 6);
  camera.lookAt(0, 1, 0);
  renderer.setAnimationLoop(() => { puppet.update(); renderer.render(scene, camera); });
  await new Promise((resolve) => puppet.addEventListener("rebuilt", resolve));
}"""

CHECKED = """() => {
  const frame = puppet.character.frame;
  const expected = frame?.header.state === 2 ? vertices.get(frame.header.sequence) : null;
  if (!expected) return null;
  puppet.mesh.show(frame, frame, 0);
  const parts = puppet.mesh.meshes.map((part) => ({
    positions: readVertices(part, puppet.mesh.uniforms, "transformed"),
    normals: readVertices(part, puppet.mesh.uniforms, "objectNormal"),
  }));
  return { expected, parts, evaluated: puppet.mesh.evaluate(), diagonal: puppet.mesh.scene.description.diagonal };
}"""


def test_live_characters_are_drawn_where_the_solver_has_them_with_meshes_of_their_own_too(
    serve_page, open_page, site, blob_puppet, tmp_path
):
    write_shader_mesh(blob_puppet, tmp_path / "blob.shader.glb")
    performing = ("--source", "demo:kung_fu?loop", "--calibrate", "at_once")
    _, address = serve_page("--puppet", blob_puppet, *performing)
    for file in None, site.add(tmp_path / "blob.shader.glb"):
        page = open_page()
        page.run(FOLLOW, [address, file])
        for _ in range(3):
            shown = page.until(CHECKED)
            expected, limit = shown["expected"], 1e-5 * shown["diagonal"]
            for part in shown["parts"]:
                assert np.abs(part["positions"] - expected["positions"]).max() <= limit
                off = np.abs(part["normals"] - expected["normals"]).reshape(-1, 3).max(axis=1)
                assert np.median(off) <= 1e-6
                assert (off > 1e-4).mean() < 0.01  # f32 has no more where the surface is almost flattened
            assert np.abs(shown["evaluated"]["positions"] - expected["positions"]).max() <= limit
            number = page.run("() => puppet.character.frame.header.sequence")
            page.until(f"() => puppet.character.frame.header.sequence > {number} + 8")
        first = page.picture().astype(int)
        assert 0.02 < (np.abs(first - first[0, 0]).max(axis=2) > 12).mean() < 0.6  # the character, and not all of it
        wait_until(lambda page=page, first=first: (np.abs(page.picture() - first).max(axis=2) > 12).mean() > 0.005)
    assert page.run("() => puppet.mesh.meshes.map((mesh) => mesh.material.color.getHex())") == [0xFF0000]


def test_a_file_of_another_mesh_is_refused(worm):
    refused = """() => {
      const other = new THREE.Mesh(new THREE.BufferGeometry());
      const make = () => new drawing.PuppetMesh(mesh.scene, { source: other });
      const said = [];
      for (const numbers of [null, [0, 9999]]) {
        if (numbers) other.geometry.setAttribute("texcoord_6", new THREE.BufferAttribute(new Float32Array(numbers), 1));
        try { make(); } catch (error) { said.push(error.name); }
      }
      return said;
    }"""
    assert worm.run(refused) == ["RangeError"] * 2
