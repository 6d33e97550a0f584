import numpy as np
import pytest

from engine_bridge.character import schema
from engine_bridge.export.vrm import add_vrm, humanoid_rows
from engine_bridge.puppet.humanoid_bones import HUMANOID_BONES, REQUIRED
from engine_bridge.puppet.puppet import VrmTable
from engine_bridge.rigging.joints import joints_of
from puppetline.errors import PuppetError

from ..bones import limb
from ..refusals import refused

LICENCE = "https://creativecommons.org/licenses/by/4.0/"
STATED = VrmTable(name="Ada", authors=["Ben", "Cleo"], licence=LICENCE)


def body(**changed):
    """The limbs of a humanoid, some of them replaced, added or, by None, omitted; their names have underscores."""
    limbs = {
        "trunk": limb("trunk", "0 1 0, 0 1.1 0, 0 1.2 0, 0 1.35 0, 0 1.5 0"),
        "head": limb("head", "0 1.5 0, 0 1.9 0"),
    }
    for side, x in (("left", 1), ("right", -1)):
        limbs[f"{side}_arm"] = limb(f"{side} arm", f"{0.2 * x} 1.5 0, {0.5 * x} 1.5 0, {0.8 * x} 1.5 0")
        limbs[f"{side}_leg"] = limb(f"{side} leg", f"{0.1 * x} 1 0, {0.1 * x} 0.5 0, {0.1 * x} 0.1 0")
    return [each for each in (limbs | changed).values() if each is not None]


def bones(limbs, handles=()):
    joints = joints_of(limbs, handles)
    return {bone: joints[row] for bone, row in humanoid_rows(joints, "hero.toml").items()}


def test_a_humanoid_has_all_bones_of_its_limbs_but_those_that_are_out_of_line():
    handles = [("hips", np.zeros(3)), ("jaw", np.array([0, 1.7, 0.1]))]  # which are no limbs
    found = bones(body(), handles)
    assert list(found) == [bone for bone in HUMANOID_BONES if bone != "jaw" and not bone.endswith("Toes")]
    assert all(bone == joint.name for bone, joint in found.items() if bone != "hips")
    assert found["hips"].limb == "trunk"
    neck = limb("neck", "0 1.5 0, 0 1.6 0")
    trunk, head, *others = body()
    assert "neck" not in bones([trunk, neck, head, *others])  # beside the head
    assert "neck" in bones([trunk, neck, limb("head", "0 1.6 0, 0 1.9 0", parent="neck"), *others])
    low = bones(body(left_arm=limb("left arm", "0.2 1.25 0, 0.5 1.5 0, 0.8 1.5 0")))
    assert [name in low for name in ("chest", "upperChest")] == [True, False]


@pytest.mark.parametrize(
    ("changed", "missing"),
    [
        ({"head": None}, ["head"]),
        ({"left_arm": None}, ["leftUpperArm", "leftLowerArm", "leftHand"]),
        ({"right_leg": limb("right hind leg", "0 1 0, 0 0 0")}, ["rightUpperLeg", "rightLowerLeg", "rightFoot"]),
        ({"head": limb("head", "0.1 0.1 0, 0.1 0.3 0.2", parent="left leg")}, []),
    ],
)
def test_a_character_without_a_required_bone_is_refused_by_their_names(changed, missing):
    error = refused(PuppetError, bones, body(**changed))
    assert error.where == "hero.toml"
    if missing:
        assert {name for name in REQUIRED if name in error.found} == set(missing)


@pytest.fixture
def made():
    """Return a description with some properties after `add_vrm`."""

    def make(stated=STATED, targets=(), **properties):
        mesh = {"primitives": [{"attributes": {}, "targets": [{}] * len(targets)}], "extras": {"targetNames": targets}}
        gltf = schema.empty() | {"nodes": [{"name": "hips"}, {"mesh": 0}], "meshes": [mesh]} | properties
        add_vrm(gltf, {"hips": 0}, np.array([0, 0.25, 0.1]), stated)
        return gltf

    return make


def test_eyes_are_halfway_up_and_a_licence_of_vrms_is_stated_as_such(made):
    vrm = made()["extensions"]["VRMC_vrm"]
    assert vrm["firstPerson"] == {"meshAnnotations": [{"node": 1, "type": "auto"}]}
    look = vrm["lookAt"]
    found = look["offsetFromHeadBone"], look["type"], look["rangeMapVerticalUp"]["outputScale"]
    assert found == ([0, 0.125, 0.05], "bone", 10)
    own = VrmTable(name="Ada", authors=["Ben"], licence="https://vrm.dev/licenses/1.0/", version="2")
    vrm = made(own, ["lookUp", "lookDown", "lookLeft", "lookRight"])["extensions"]["VRMC_vrm"]
    assert vrm["meta"] == {"name": "Ada", "authors": ["Ben"], "licenseUrl": own.licence, "version": "2"}
    assert (vrm["lookAt"]["type"], vrm["lookAt"]["rangeMapHorizontalInner"]["outputScale"]) == ("expression", 1)
    assert vrm["expressions"]["preset"].keys() == {"lookUp", "lookDown", "lookLeft", "lookRight"}


def test_an_earlier_vrm_and_animations_are_replaced(made):
    older = {"VRM": {}, "VRMC_springBone": {}, "KHR_lights_punctual": {"lights": []}}
    node = {"extensions": {"VRMC_node_constraint": {}}}
    used = [*older, "VRMC_node_constraint", "VRMC_vrm"]
    gltf = made(extensions=older, nodes=[node, {}], extensionsUsed=used, extensionsRequired=["VRM"], animations=[{}])
    assert gltf["extensions"].keys() == {"KHR_lights_punctual", "VRMC_vrm"}
    assert gltf["extensionsUsed"] == ["KHR_lights_punctual", "VRMC_vrm"]
    assert (gltf["extensionsRequired"], gltf["animations"], gltf["nodes"][0]) == ([], [], {})
