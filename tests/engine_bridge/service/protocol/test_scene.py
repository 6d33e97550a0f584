import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_bridge.character.character import load_character
from engine_bridge.service.protocol.header import WireError
from engine_bridge.service.protocol.scene import DecodedScene, StreamedCharacter, parts, uv


@pytest.fixture(scope="module")
def character(prepared_blob):
    return StreamedCharacter("dog", prepared_blob, 3)


def test_parts_have_their_ranges_names_and_materials(glb, tmp_path, blob):
    red = {"baseColorFactor": [1, 0, 0, 0.5], "metallicFactor": 0.25, "roughnessFactor": 0.75}
    glb.file.materials.append({"name": "red", "pbrMetallicRoughness": red, "doubleSided": True, "alphaMode": "BLEND"})
    faces = blob.faces.astype(np.uint32)
    half = len(faces) // 2
    mesh = glb.mesh(
        glb.primitive(blob.vertices, faces[:half], material=0, TEXCOORD_0=blob.uv),
        glb.primitive(blob.vertices, faces[half:]),
    )
    glb.node(mesh, name="figure")
    character = load_character(glb.save(tmp_path / "figure.glb"))
    n = len(blob.vertices)
    first, second = parts(character)
    assert first["name"] == "figure"
    assert first["vertices"] == [0, n]
    assert first["triangles"] == [0, half]
    assert second["vertices"] == [n, n]
    assert second["triangles"] == [half, len(faces) - half]
    assert first["material"] == {
        "name": "red",
        "base_color": [1, 0, 0, 0.5],
        "metallic": 0.25,
        "roughness": 0.75,
        "emissive": [0, 0, 0],
        "alpha_mode": "BLEND",
        "double_sided": True,
    }
    assert second["material"]["base_color"] == [1, 1, 1, 1]
    assert not second["material"]["double_sided"]
    np.testing.assert_array_equal(uv(character), np.concatenate([blob.uv, np.zeros_like(blob.uv)]))


WRONG = """
scene     arrays   []
scene     vertices 0
scene     vertices 7
scene     isolines 1
scene     isolines 3
scene     weights  [1.0]
ladder    type     null
slopes    offset   8589934592
slopes    offset   -4
positions offset   2
positions shape    [4611686018427387904, 3]
positions shape    [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]
positions shape    ["a", true]
positions type     "f64"
positions type     "u32"
triangles offset   40000
"""
"""An array, or the scene itself; what is said of it, and what contradicts the rest."""


def described(facts, arrays=bytes(64)):
    """Return the payload of a scene that is described so."""
    text = json.dumps(facts).encode()
    text += b" " * (-len(text) % 8)
    return struct.pack("<I", len(text)) + text + arrays


@pytest.mark.parametrize("line", WRONG.strip().splitlines())
def test_a_scene_that_contradicts_itself_is_refused(character, line):
    array, key, value = line.split(maxsplit=2)
    (length,) = struct.unpack_from("<I", character.scene)
    facts, arrays = json.loads(character.scene[4 : 4 + length]), character.scene[4 + length :]
    assert DecodedScene.decode(described(facts, arrays))
    facts["arrays"].get(array, facts)[key] = json.loads(value)
    with pytest.raises(WireError):
        DecodedScene.decode(described(facts, arrays))


@pytest.mark.parametrize("payload", [b"", b"\xff\xff\xff\xff{}", b"\2\0\0\0[]", b"\2\0\0\0{}", b"\4\0\0\0null"])
def test_a_scene_cut_short_is_refused(payload):
    with pytest.raises(WireError):
        DecodedScene.decode(payload)


@given(
    facts=st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from(["arrays", "type", "shape", "offset"]), inner),
    )
)
def test_any_description_is_refused(facts):
    with pytest.raises(WireError):
        DecodedScene.decode(described({"arrays": facts, "vertices": 1}))
