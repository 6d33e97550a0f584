"""Fingers of skeletons that are made by code bend towards their palms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from capture.bone_names import FINGER_BONES
from capture.channels import FINGER_CHANNELS, FINGERS, FULL_BEND_DEGREES
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.scene import world_transforms
from engine_bridge.export.finger_animation import bend_fingers, finger_joints, with_fingers
from engine_bridge.rigging.joints import Joint
from engine_bridge.rigging.skeleton import Skeleton

from ..bones import in_world
from .conftest import posed

SIDES = {"left": 0.7, "right": -0.7}
"""Where the wrists are."""
QUARTER = 90 / FULL_BEND_DEGREES
VRM_1 = {
    (finger, k): f"{{side}}{finger.title()}{part}"
    for finger in FINGERS
    for k, part in enumerate(
        ("Metacarpal", "Proximal", "Distal") if finger == "thumb" else ("Proximal", "Intermediate", "Distal"), 1
    )
}
MIXAMO = {
    (finger, k): f"mixamorig:{{Side}}Hand{'Pinky' if finger == 'little' else finger.title()}{k}"
    for finger in FINGERS
    for k in (1, 2, 3, 4)
}
BLENDER = {(finger, k): f"{finger.title()}{k + 1}.{{S}}" for finger in FINGERS for k in (1, 2, 3)}


def place_of(side, finger, k):
    """Return the place of a joint in a T-pose with palms down that faces +z."""
    out = 1 if side == "left" else -1
    ahead = 0.04 - 0.02 * FINGERS.index(finger)
    if finger == "thumb":
        return np.array([out * (0.75 + 0.02 * k), 0.0, 0.04 + 0.02 * k])
    return np.array([out * (0.8 + 0.03 * (k - 1)), 0.0, ahead])


@pytest.fixture(params=[VRM_1, MIXAMO, BLENDER], ids=("VRM", "Mixamo", "Blender"))
def hands(request, glb, tmp_path):
    """A document of two hands whose joints have axes of their own, with an animation of three keyframes."""
    random = np.random.default_rng(5)
    for side, out in SIDES.items():
        above = glb.node(name=f"{side} hand", translation=[out, 0.0, 0.0])
        for finger in FINGERS:
            parent, turn, start = above, Rotation.identity(), [out, 0, 0]
            for k in [k for name, k in request.param if name == finger]:
                own, place = Rotation.random(random_state=random), place_of(side, finger, k)
                name = request.param[finger, k].format(side=side, Side=side.title(), S=side[0].upper())
                step, local = turn.inv().apply(place - start).tolist(), (turn.inv() * own).as_quat().tolist()
                parent = glb.node(parent=parent, name=name, translation=step, rotation=local)
                turn, start = own, place
    document = load_document(glb.save(tmp_path / "hands.glb"))
    clock = document.add(np.arange(3, dtype=np.float32), bounds=True)
    document.gltf["animations"] = [{"channels": [], "samplers": [{"input": clock, "output": clock}]}]
    return document


def shown(document, frame):
    """Return the places of the joints of fingers in a keyframe."""
    world = world_transforms(posed(document, frame))
    return {joint: world[node][:3, 3] for joint, node in finger_joints(document).items()}


def test_a_hand_points_while_the_bent_fingers_follow_the_palm_and_rests_at_zero(hands):
    rest = {(side, finger, k): place_of(side, finger, k) for side in SIDES for finger in FINGERS for k in (1, 2, 3)}
    assert finger_joints(hands).keys() == rest.keys()
    bent = {name: np.array([0, 1, 0], np.float32) * QUARTER for name in FINGER_CHANNELS if name.endswith("1_left")}
    del bent["index_1_left"], bent["thumb_1_left"]
    assert bend_fingers(hands, bent | {"smile": np.ones(3, np.float32)}) == 3
    for frame in (0, 1, 2):
        for (side, finger, k), place in shown(hands, frame).items():
            wanted = rest[side, finger, k]
            if frame == 1 and side == "left" and finger in ("middle", "ring", "little"):
                wanted = rest[side, finger, 1] - [0, 0.03 * (k - 1), 0]  # straight down
            assert_allclose(place, wanted, atol=1e-5, err_msg=f"{side} {finger} {k}")


def test_fists_are_mirror_images_and_fingertips_return_to_the_palm(hands):
    bend_fingers(hands, {name: np.full(3, QUARTER, np.float32) for name in FINGER_CHANNELS})
    places = shown(hands, 0)
    for (side, finger, k), place in places.items():
        assert_allclose(place * [-1, 1, 1], places[{"left": "right"}.get(side, "left"), finger, k], atol=1e-5)
        if finger != "thumb" and k == 3:
            assert abs(place[0]) < abs(places[side, finger, 1][0])
            assert place[1] < -0.02
    assert places["left", "thumb", 3][1] < 0


@pytest.fixture
def live(hands):
    """A skeleton with two hands, in whose place the document's fingers are."""
    joints = [
        Joint(f"{side}Hand", -1, number, np.array([out, 0, 0]), np.array([out, 0, 0]), f"{side} arm")
        for number, (side, out) in enumerate(SIDES.items())
    ]
    return with_fingers(Skeleton(tuple(joints), np.tile(np.eye(3), (2, 1, 1)), np.eye(3), np.zeros(3)), hands)


def test_live_bones_have_the_fingers_of_the_file_which_channels_bend_as_in_an_animation(hands, live):
    skeleton, bends = live
    assert skeleton.names[2:] == tuple(FINGER_BONES[joint] for joint in sorted(finger_joints(hands)))
    assert not skeleton.travelling[2:].any()
    channels = {name: QUARTER for name in FINGER_CHANNELS if not name.startswith("thumb")} | {"thumb_2_left": 0.5}
    positions, rotations = skeleton.rest
    bends.bend(rotations, channels)
    bend_fingers(hands, {name: np.full(3, channels.get(name, 0.0), np.float32) for name in FINGER_CHANNELS})
    found = in_world(skeleton, positions, rotations)
    for joint, place in shown(hands, 1).items():
        assert_allclose(found[FINGER_BONES[joint]][0], place, atol=1e-6)
