import json
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose

from engine_bridge.export.rig_file import RigSettings
from engine_bridge.export.vrm_file import statement, write_vrm
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet import CharacterTable, VrmTable
from engine_bridge.rigging.naming_schemes import NAMES
from puppetline.errors import OutputError, PuppetError

from ..bones import turned
from ..refusals import refused
from .conftest import unit

LICENCE = "https://creativecommons.org/licenses/by/4.0/"
GIVEN = {"name": "Figure", "authors": ["Ada", "Ben"], "licence": LICENCE}
ARM, LEG = ("UpperArm", "LowerArm", "Hand"), ("UpperLeg", "LowerLeg", "Foot")
STRAIGHT = {
    ("hips", "spine", "chest", "neck", "head"): (0, 1, 0),
    tuple(f"left{bone}" for bone in ARM): (1, 0, 0),
    tuple(f"right{bone}" for bone in ARM): (-1, 0, 0),
    **{tuple(f"{side}{bone}" for bone in LEG): (0, -1, 0) for side in ("left", "right")},
}
"""Directions of chains of bones in VRM's T-pose."""


@pytest.fixture(scope="module")
def avatar(limbed_puppet, blob, new_glb, tmp_path_factory):
    """The figure as an avatar: path and summary.

    It stands with its arms raised and its legs apart. The file is in centimetres, with z up and x in front, and its
    joints get Mixamo's names.
    """
    folder, glb = tmp_path_factory.mktemp("avatars"), new_glb()
    turn = 100 * np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])  # rows: left, up, front
    glb.show((blob.vertices @ turn).astype(np.float32), blob.faces)
    glb.save(folder / "turned.glb")
    table = CharacterTable(mesh="turned.glb", up="z", front="x", scale=0.01)
    puppet = turned(puppet_file.load(limbed_puppet), turn).model_copy(update={"character": table})
    puppet_file.dump(puppet, folder / "turned.toml")
    path = folder / "figure.vrm"
    return path, write_vrm(folder / "turned.toml", path, RigSettings(names="mixamo"), GIVEN)


@pytest.fixture(scope="module")
def shown(avatar, node):
    """The avatar as three-vrm shows it."""
    return json.loads(node("describe_vrm.mjs", avatar[0]))


def test_three_vrm_shows_an_avatar_that_stands_on_the_floor_in_a_t_pose_from_a_valid_file(
    avatar, shown, assert_valid_gltf
):
    path, summary = avatar
    assert_valid_gltf(path)
    assert summary.bytes == path.stat().st_size
    assert {*(NAMES["mixamo"][name] for name in ("hips", "leftHand")), "hump"} <= set(summary.joints)
    assert shown["warnings"] == []
    stated = {"name": "Figure", "authors": ["Ada", "Ben"], "otherLicenseUrl": LICENCE}
    assert shown["meta"] == stated | {"metaVersion": "1", "licenseUrl": "https://vrm.dev/licenses/1.0/"}
    bones = {name: np.array(place) for name, place in shown["bones"].items()}
    for chain, direction in STRAIGHT.items():
        for start, end in pairwise(chain):
            assert_allclose(unit(bones[end] - bones[start]), direction, atol=1e-6, err_msg=f"{start} {end}")
    upper_arm = bones["leftLowerArm"] - bones["leftUpperArm"]
    assert_allclose(np.linalg.norm(upper_arm), np.linalg.norm([0.6, 0.09, 0.045]), atol=1e-6)  # as in the puppet file
    assert_allclose(bones["hips"][[0, 2]], 0, atol=1e-9)
    low, high = np.array(shown["box"])
    assert_allclose(low[1], 0, atol=1e-6)
    assert low[0] < bones["rightHand"][0] < bones["leftHand"][0] < high[0]
    assert bones["head"][1] < bones["head"][1] + shown["viewpoint"][1] < high[1]


def test_what_is_no_humanoid_or_states_nothing_or_replaces_a_mesh_is_refused(
    avatar, blob_puppet, limbed_puppet, tmp_path
):
    output = tmp_path / "none.vrm"
    refused(PuppetError, write_vrm, blob_puppet, output, RigSettings(), GIVEN)
    assert "--licence" in refused(PuppetError, write_vrm, limbed_puppet, output, RigSettings(), {}).fix
    refused(OutputError, write_vrm, avatar[0], avatar[0], RigSettings(), GIVEN)
    assert list(tmp_path.iterdir()) == []


def test_options_replace_what_the_puppet_file_states(tmp_path):
    table = VrmTable(name="Old", authors=["Ada"], licence=LICENCE, version="3")
    assert statement(table, {}, tmp_path) == table
    assert statement(table, {"name": "New"}, tmp_path) == table.model_copy(update={"name": "New"})
    assert statement(None, GIVEN, tmp_path).authors == ("Ada", "Ben")
    assert refused(PuppetError, statement, None, GIVEN | {"licence": "MIT"}, tmp_path).where.endswith("[vrm], licence")
