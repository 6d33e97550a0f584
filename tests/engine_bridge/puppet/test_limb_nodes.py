import re

import pytest

from engine_bridge.character.character import load_character
from engine_bridge.performance.prepared_character import prepared_of
from engine_bridge.puppet.limb_nodes import limb_nodes, node_labels
from engine_bridge.puppet.puppet import CharacterTable, LimbTable, Puppet
from puppetline.errors import PuppetError

from ..character.conftest import CORNERS, SIDES

NAMES = "root", "arm", None, "twin", "twin", "#1"


@pytest.fixture
def puppet(glb, tmp_path):
    """A puppet with an arm along nodes 1 unit apart, and its mesh."""
    parent = None
    for number, name in enumerate(NAMES):
        mesh = glb.mesh(glb.primitive(CORNERS / 10, SIDES))
        parent = glb.node(mesh, parent=parent, name=name, translation=[float(number > 0), 0.0, 0.0])
    glb.save(tmp_path / "arm.glb")
    points = [(float(x), 0.0, 0.0) for x in (1, 2, 3, 4)]
    limb = LimbTable(name="arm", points=points, joints=["hip_center"] * 4, nodes=["arm", "#2", "#4"])
    return Puppet(character=CharacterTable(mesh="arm.glb"), limb=[limb])


def with_limb(puppet, **values):
    return puppet.model_copy(update={"limb": (puppet.limb[0].model_copy(update=values),)})


def test_nodes_have_their_names_or_the_numbers_of_those_without_one_of_their_own(puppet, tmp_path):
    character = load_character(tmp_path / "arm.glb")
    assert node_labels(character.document) == ["root", "arm", "#2", "#3", "#4", "#5"]
    assert limb_nodes(puppet, character) == {"arm": [1, 2, 4]}
    assert limb_nodes(with_limb(puppet, nodes=None), character) == {}


def test_nodes_of_another_mesh_are_refused(puppet, tmp_path):
    for values, found in (
        ({"nodes": ("arm", "twin")}, "'twin', which is not a joint of arm.glb"),
        ({"points": ((1.0, 0.0, 0.0), (2.0, 0.0, 0.0))}, "'#4', which is 2 away from the limb"),
    ):
        with pytest.raises(PuppetError, match=re.escape(found)) as refused:
            prepared_of(with_limb(puppet, **values), tmp_path / "arm.toml")
        assert "arm.toml, [[limb]] 1 'arm', nodes" in str(refused.value)
