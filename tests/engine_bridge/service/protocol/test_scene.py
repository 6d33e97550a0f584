import json
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_bridge.character.character import load_character
from engine_bridge.service.protocol.header import WireError
from engine_bridge.service.protocol.scene import Scene, StreamedCharacter, parts, uv


@pytest.fixture(scope="module")
def character(blob_rig):
    return StreamedCharacter("dog", blob_rig, 3)


def with_facts(payload, change):
    """The payload with another description."""
    (length,) = struct.unpack_from("<I", payload)
    facts = json.loads(payload[4 : 4 + length])
    change(facts)
    text = json.dumps(facts).encode()
    text += b" " * (-len(text) % 8)
    return struct.pack("<I", len(text)) + text + payload[4 + length :]


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
    assert (first["name"], first["vertices"], first["triangles"]) == ("figure", [0, n], [0, half])
    assert (second["vertices"], second["triangles"]) == ([n, n], [half, len(faces) - half])
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


WRONG = {
    "no description": lambda facts: facts.clear(),
    "arrays that are no table": lambda facts: facts.update(arrays=[]),
    "an array that is not there": lambda facts: facts["arrays"].pop("ladder"),
    "an array beyond the end": lambda facts: facts["arrays"]["slopes"].update(offset=2**31 * 4),
    "an array before the beginning": lambda facts: facts["arrays"]["slopes"].update(offset=-4),
    "an odd place": lambda facts: facts["arrays"]["positions"].update(offset=2),
    "a huge shape": lambda facts: facts["arrays"]["positions"].update(shape=[2**62, 3]),
    "too many dimensions": lambda facts: facts["arrays"]["positions"].update(shape=[1] * 40),
    "a shape of no numbers": lambda facts: facts["arrays"]["positions"].update(shape=["a", True]),
    "an unknown type": lambda facts: facts["arrays"]["positions"].update(type="f64"),
    "positions as integers": lambda facts: facts["arrays"]["positions"].update(type="u32"),
    "another number of vertices": lambda facts: facts.update(vertices=facts["vertices"] - 1),
    "no vertices": lambda facts: facts.update(vertices=0),
    "one isoline": lambda facts: facts.update(isolines=1),
    "isoline coordinates beyond the isolines": lambda facts: facts.update(isolines=3),
    "weights of fewer fields": lambda facts: facts["weights"].pop(),
    "triangles of other vertices": lambda facts: facts["arrays"]["triangles"].update(
        offset=facts["arrays"]["positions"]["offset"]
    ),
}


@pytest.mark.parametrize("change", WRONG.values(), ids=WRONG)
def test_a_scene_that_contradicts_itself_is_refused(character, change):
    with pytest.raises(WireError):
        Scene.decode(with_facts(character.scene, change))


@pytest.mark.parametrize("payload", [b"", b"\xff\xff\xff\xff{}", b"\2\0\0\0[]", b"\2\0\0\0{}", b"\4\0\0\0null"])
def test_a_scene_cut_short_is_refused(payload):
    with pytest.raises(WireError):
        Scene.decode(payload)


@given(
    facts=st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from(["arrays", "type", "shape", "offset"]), inner),
    )
)
def test_any_description_is_refused(facts):
    text = json.dumps({"arrays": facts, "vertices": 1}).encode()
    with pytest.raises(WireError):
        Scene.decode(struct.pack("<I", len(text)) + text + bytes(64))
