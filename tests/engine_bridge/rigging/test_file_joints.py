"""Joints of a humanoid in the skeleton of a file."""

import pytest

from engine_bridge.character.character import load_character
from engine_bridge.performance.prepared_character import make_prepared
from engine_bridge.puppet.proposal import new_puppet
from engine_bridge.puppet.rig_bones import own_bones
from engine_bridge.rigging.file_joints import humanoid_joints


def names(prepared):
    nodes, own = prepared.character.document.gltf["nodes"], own_bones(prepared.character, prepared.puppet)
    return {name: nodes[node]["name"] for name, node in humanoid_joints(prepared, own).items()}


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (
            "quaternius_Adventurer",
            {
                "hips": "Hips",
                "spine": "Abdomen",
                "chest": "Torso",
                "upperChest": "Chest",
                "leftShoulder": "Shoulder.L",
                "rightUpperLeg": "UpperLeg.R",
            },
        ),
        ("quaternius_Witch", {"hips": "Hips", "spine": "Abdomen", "rightFoot": "Foot.R"}),
    ],
)
def test_hips_are_where_the_legs_hang_and_the_trunk_leads_to_the_arms(name, expected, real_data):
    """The legs of the witch hang on a joint above the hips that moves no vertex."""
    path = real_data / "mesh" / "gltf" / f"{name}.glb"
    found = names(make_prepared(new_puppet(path, path).puppet, load_character(path)))
    assert found | expected == found
    assert len(set(found.values())) == len(found)
