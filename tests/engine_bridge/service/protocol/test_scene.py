import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from engine_bridge.character.character import load_character
from engine_bridge.service.protocol.header import WireError
from engine_bridge.service.protocol.scene import DecodedScene, StreamedCharacter, parts, uv


def test_parts_have_their_ranges_names_and_materials(glb, tmp_path, blob):
    red = {"baseColorFactor": [1, 0, 0, 0.5], "metallicFactor": 0.25, "roughnessFactor": 0.75}
    glb.file.materials.append({"name": "red", "pbrMetallicRoughness": red, "doubleSided": True, "alphaMode": "BLEND"})
    one, other = np.array_split(blob.faces.astype(np.uint32), 2)
    mesh = glb.mesh(
        glb.primitive(blob.vertices, one, material=0, TEXCOORD_0=blob.uv), glb.primitive(blob.vertices, other)
    )
    glb.node(mesh, name="figure")
    character = load_character(glb.save(tmp_path / "figure.glb"))
    n = len(blob.vertices)
    first, second = parts(character)
    material = {"name": "red", "base_color": [1, 0, 0, 0.5], "metallic": 0.25, "roughness": 0.75}
    material |= {"emissive": [0, 0, 0], "alpha_mode": "BLEND", "double_sided": True}
    shown = {"name": "figure", "vertices": [0, n], "triangles": [0, len(one)], "material": material}
    assert first == first | shown
    assert second == second | {"vertices": [n, n], "triangles": [len(one), len(other)]}
    assert second["material"] == second["material"] | {"base_color": [1, 1, 1, 1], "double_sided": False}
    assert_array_equal(uv(character), np.concatenate([blob.uv, np.zeros_like(blob.uv)]))


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
def test_a_scene_that_contradicts_itself_is_refused(prepared_blob, line):
    array, key, value = line.split(maxsplit=2)
    scene = StreamedCharacter("dog", prepared_blob, 3).scene
    end = 4 + struct.unpack_from("<I", scene)[0]
    facts, arrays = json.loads(scene[4:end]), scene[end:]
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
