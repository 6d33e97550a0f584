import numpy as np
import pytest

from engine_bridge.character import schema
from engine_bridge.export.vrm import add_vrm, humanoid_rows, upright
from engine_bridge.puppet.humanoid_bones import HUMANOID_BONES, REQUIRED
from engine_bridge.puppet.puppet import VrmTable
from engine_bridge.rigging.joints import joints_of
from puppetline.errors import PuppetError
from solver.motion.limbs import Limb

LICENCE = "https://creativecommons.org/licenses/by/4.0/"
STATED = VrmTable(name="Ada", authors=["Ben", "Cleo"], licence=LICENCE)


def limb(name, *points, parent="trunk"):
    own = None if name == "trunk" else parent
    return Limb(name, np.array(points, dtype=np.float64), ((0,),) * len(points), parent=own)


def body(**changed):
    """The limbs of a humanoid, some of them replaced, added or, by None, omitted; their names have underscores."""
    limbs = {
        "trunk": limb("trunk", (0, 1, 0), (0, 1.1, 0), (0, 1.2, 0), (0, 1.35, 0), (0, 1.5, 0)),
        "head": limb("head", (0, 1.5, 0), (0, 1.9, 0)),
    }
    for side, x in (("left", 1), ("right", -1)):
        limbs[f"{side}_arm"] = limb(f"{side} arm", (0.2 * x, 1.5, 0), (0.5 * x, 1.5, 0), (0.8 * x, 1.5, 0))
        limbs[f"{side}_leg"] = limb(f"{side} leg", (0.1 * x, 1, 0), (0.1 * x, 0.5, 0), (0.1 * x, 0.1, 0))
    return [each for each in (limbs | changed).values() if each is not None]


def bones(limbs, handles=()):
    joints = joints_of(limbs, handles)
    return {bone: joints[row] for bone, row in humanoid_rows(joints, "hero.toml").items()}


def test_a_humanoid_has_all_bones_of_its_limbs():
    found = bones(body())
    assert list(found) == [bone for bone in HUMANOID_BONES if bone != "jaw" and not bone.endswith("Toes")]
    assert all(bone == joint.name for bone, joint in found.items())


def test_only_joints_of_limbs_are_bones():
    handles = [("hips", np.zeros(3)), ("jaw", np.array([0, 1.7, 0.1]))]
    assert "jaw" not in bones(body(), handles)
    assert bones(body(), handles)["hips"].limb == "trunk"


def test_a_neck_beside_the_head_is_omitted():
    trunk, head, *others = body()
    neck = limb("neck", (0, 1.5, 0), (0, 1.6, 0))
    assert "neck" not in bones([trunk, neck, head, *others])
    assert "neck" in bones([trunk, neck, limb("head", (0, 1.6, 0), (0, 1.9, 0), parent="neck"), *others])


def test_an_upper_chest_below_which_an_arm_is_not_is_omitted():
    found = bones(body(left_arm=limb("left arm", (0.2, 1.25, 0), (0.5, 1.5, 0), (0.8, 1.5, 0))))
    assert "upperChest" not in found
    assert "chest" in found


@pytest.mark.parametrize(
    ("changed", "missing"),
    [
        ({"head": None}, ["head"]),
        ({"left_arm": None}, ["leftUpperArm", "leftLowerArm", "leftHand"]),
        ({"right_leg": limb("right hind leg", (0, 1, 0), (0, 0, 0))}, [f"right{b}Leg" for b in ("Upper", "Lower")]),
    ],
)
def test_a_character_without_a_required_bone_is_refused_by_their_names(changed, missing):
    with pytest.raises(PuppetError) as refused:
        bones(body(**changed))
    assert all(name in str(refused.value) for name in missing)
    assert not any(name in refused.value.found for name in set(REQUIRED) - {*missing, "rightFoot"})
    assert refused.value.where == "hero.toml"


def test_a_head_on_a_leg_is_refused():
    head = limb("head", (0.1, 0.1, 0), (0.1, 0.3, 0.2), parent="left leg")
    with pytest.raises(PuppetError, match="neck that is not attached to spine"):
        bones(body(head=head))


def test_upright_is_metres_from_the_floor_below_the_hips():
    basis = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])  # z up, front x
    placed = upright(basis, 0.01, np.array([20.0, 30, 90]), -10.0)
    np.testing.assert_allclose(placed @ [20, 30, -10, 1], [0, 0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(placed @ [120, 30, -10, 1], [0, 0, 1, 1], atol=1e-15)
    np.testing.assert_allclose(placed @ [20, 130, 90, 1], [1, 1, 0, 1], atol=1e-15)


@pytest.fixture
def made():
    """Return a description with some properties after `add_vrm`."""

    def make(stated=STATED, targets=(), **properties):
        mesh = {"primitives": [{"attributes": {}, "targets": [{}] * len(targets)}], "extras": {"targetNames": targets}}
        gltf = schema.empty() | {"nodes": [{"name": "hips"}, {"mesh": 0}], "meshes": [mesh]} | properties
        add_vrm(gltf, {"hips": 0}, np.array([0, 0.25, 0.1]), stated)
        return gltf

    return make


def test_the_statement_has_vrms_licence_and_the_authors_own(made):
    assert made()["extensions"]["VRMC_vrm"]["meta"] == {
        "name": "Ada",
        "authors": ["Ben", "Cleo"],
        "licenseUrl": "https://vrm.dev/licenses/1.0/",
        "otherLicenseUrl": LICENCE,
    }
    own = VrmTable(name="Ada", authors=["Ben"], licence="https://vrm.dev/licenses/1.0/", version="2")
    meta = made(own)["extensions"]["VRMC_vrm"]["meta"]
    assert meta["version"] == "2"
    assert "otherLicenseUrl" not in meta


def test_the_head_is_cut_automatically_and_the_eyes_are_halfway_up(made):
    vrm = made()["extensions"]["VRMC_vrm"]
    assert vrm["firstPerson"] == {"meshAnnotations": [{"node": 1, "type": "auto"}]}
    assert vrm["lookAt"]["offsetFromHeadBone"] == [0, 0.125, 0.05]
    assert (vrm["lookAt"]["type"], vrm["lookAt"]["rangeMapVerticalUp"]["outputScale"]) == ("bone", 10)


def test_eyes_that_targets_turn_are_turned_by_expressions(made):
    look = made(targets=["lookUp", "lookDown", "lookLeft", "lookRight"])["extensions"]["VRMC_vrm"]["lookAt"]
    assert (look["type"], look["rangeMapHorizontalInner"]["outputScale"]) == ("expression", 1)


def test_an_earlier_vrm_and_animations_are_replaced(made):
    older = {"VRM": {}, "VRMC_springBone": {}, "KHR_lights_punctual": {"lights": []}}
    node = {"extensions": {"VRMC_node_constraint": {}}}
    used = [*older, "VRMC_node_constraint", "VRMC_vrm"]
    gltf = made(extensions=older, nodes=[node, {}], extensionsUsed=used, extensionsRequired=["VRM"], animations=[{}])
    assert gltf["extensions"].keys() == {"KHR_lights_punctual", "VRMC_vrm"}
    assert gltf["extensionsUsed"] == ["KHR_lights_punctual", "VRMC_vrm"]
    assert (gltf["extensionsRequired"], gltf["animations"], gltf["nodes"][0]) == ([], [], {})
