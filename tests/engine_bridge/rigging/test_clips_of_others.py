"""A clip of another program plays on characters that were rigged: joints are matched by their Mixamo names."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from capture.formats.bvh import motion_of
from capture.formats.bvh_parser import parse
from engine_bridge.character.character import from_document, load_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.scene import world_transforms
from engine_bridge.export.rig_file import RigSettings, write_rig

PREFIX = "mixamorig:"
CHAINS = "Arm ForeArm Hand", "UpLeg Leg Foot ToeBase"
BONES = {
    f"{side}{name}": f"{side}{child}"
    for side in ("Left", "Right")
    for chain in CHAINS
    for name, child in itertools.pairwise(chain.split())
}
"""Joints with the same meaning in the clip and in Mixamo's skeleton, and the joint at the end of each bone."""
FRAMES = range(0, 2752, 250)


def directions(places):
    """Unit vectors of the bones; places by the name of the joint."""
    along = {name: places[end] - places[name] for name, end in BONES.items() if {name, end} <= places.keys()}
    return {name: each / np.linalg.norm(each) for name, each in along.items()}


def places_of(document):
    """Places of a rig's joints by name, without Mixamo's prefix."""
    names = [node.get("name", "").removeprefix(PREFIX) for node in document.gltf["nodes"]]
    return dict(zip(names, world_transforms(document)[:, :3, 3], strict=True))


@pytest.fixture(scope="module")
def clip(real_data):
    """World rotations of the clip's joints by name, (F, 3, 3), and bone directions at rest and in each frame."""
    nodes, motion, _, _ = parse(real_data / "bvh" / "cmu_01_01_hops.bvh", None)
    posed = motion_of(nodes, np.vstack([0 * motion[0], motion[FRAMES]]))
    names = [node.name for node in nodes]
    frames = (dict(zip(names, places, strict=True)) for places in zip(*posed.positions, strict=True))
    rest, *pointing = map(directions, frames)
    return {name: turns[1:] for name, turns in zip(names, posed.rotations, strict=True)}, rest, pointing


def played(document, clip_turns, clip_rest, frame):
    """The rig, whose joints turn as the clip's joints of the same names turn from where the rig's bones point."""
    shown, nodes, world = document.copy(), document.gltf["nodes"], world_transforms(document)
    rest = directions(places_of(document))

    def turn(number, parent):
        name = nodes[number].get("name", "").removeprefix(PREFIX)
        own = Rotation.from_matrix(world[number][:3, :3])
        local = Rotation.from_quat(nodes[number].get("rotation", [0.0, 0.0, 0.0, 1.0]))
        now = parent * local
        if name in rest:
            onto, _ = Rotation.align_vectors(clip_rest[name][None], rest[name][None])
            now = Rotation.from_matrix(clip_turns[name][frame]) * onto * own
        elif name in clip_turns:
            now = Rotation.from_matrix(clip_turns[name][frame]) * own
        shown.gltf["nodes"][number]["rotation"] = (parent.inv() * now).as_quat().tolist()
        for child in nodes[number].get("children", []):
            turn(child, now)

    for root in document.gltf["scenes"][0]["nodes"]:
        turn(root, Rotation.identity())
    return shown


def lengths(vertices, edges):
    return np.linalg.norm(np.diff(vertices[edges], axis=1)[:, 0], axis=1)


@pytest.mark.exhaustive
@pytest.mark.parametrize("mesh", ["homer_6k.obj", "gltf/quaternius_Witch.glb"])
def test_a_clip_with_mixamos_names_plays_without_tearing(mesh, clip, real_data, tmp_path):
    source, rig = real_data / "mesh" / mesh, tmp_path / "rig.glb"
    summary = write_rig(source, rig, RigSettings(names="mixamo", pose="t", keep_skin=False))
    assert {f"{PREFIX}{name}" for name in BONES} <= set(summary.joints)
    document, made = load_document(rig, rig.read_bytes()), load_character(source)
    edges = np.unique(np.sort(made.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), axis=0)
    before = lengths(made.vertices, edges)
    edges, before = edges[before > 0], before[before > 0]
    turns, at_rest, pointing = clip
    for frame, expected in enumerate(pointing):
        shown = played(document, turns, at_rest, frame)
        found = directions(places_of(shown))
        for name, direction in expected.items():
            np.testing.assert_allclose(found[name], direction, atol=1e-4, err_msg=name)
        low, high, highest = np.percentile(lengths(from_document(shown).vertices, edges) / before, [1, 99, 99.9])
        assert low > 0.45
        assert high < 1.7
        assert highest < 2.5
