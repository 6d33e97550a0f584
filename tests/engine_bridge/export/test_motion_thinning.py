"""Skeletal animations with fewer keyframes, compared with the plain ones."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.character.document import ARRAY_BUFFER, Document
from engine_bridge.character.scene import world_transforms
from engine_bridge.character.schema import empty
from engine_bridge.export.animation import add_channel
from engine_bridge.export.motion_thinning import thin_motion

from .conftest import posed

FRAMES = 60
POINTS = np.array([[1, 0, 0], [2, 0.5, 0], [1.5, 0, 0.25]], np.float32)


@pytest.fixture
def arm():
    """Two joints, the second 1 above the first, and points that follow the second one; both turn, the first moves."""
    document = Document(empty())
    gltf = document.gltf
    attributes = {"POSITION": document.add(POINTS, ARRAY_BUFFER, bounds=True)}
    attributes["JOINTS_0"] = document.add(np.tile(np.uint8([1, 0, 0, 0]), (3, 1)), ARRAY_BUFFER)
    attributes["WEIGHTS_0"] = document.add(np.tile(np.float32([1, 0, 0, 0]), (3, 1)), ARRAY_BUFFER)
    gltf["meshes"].append({"primitives": [{"attributes": attributes, "mode": 0}]})
    gltf["nodes"] += [{"children": [1]}, {"translation": [0.0, 1.0, 0.0]}, {"mesh": 0, "skin": 0}]
    gltf["skins"].append({"joints": [0, 1]})
    gltf["scenes"].append({"nodes": [0, 2]})
    return document


def animated(arm, angles, places):
    clock = arm.add(np.arange(FRAMES, dtype=np.float32) / 30, bounds=True)
    animation = {"name": "clip", "channels": [], "samplers": []}
    for node, axis in ((0, "z"), (1, "x")):
        turns = Rotation.from_euler(axis, angles[:, None]).as_quat().astype(np.float32)
        add_channel(arm, animation, clock, turns, node, "rotation")
    add_channel(arm, animation, clock, places.astype(np.float32), 0, "translation")
    arm.gltf["animations"].append(animation)
    return arm


def shown(document, times):
    """Positions (F, 3, 3) of the points."""
    worlds = (world_transforms(posed(document, time))[1] for time in times)
    return np.array([POINTS @ world[:3, :3].T + world[:3, 3] for world in worlds])


@pytest.mark.parametrize("tolerance", [0.1, 0.01, 0.001, 0.0002])
def test_every_point_is_within_the_error_and_the_error_within_the_tolerance(arm, tolerance):
    phase = np.linspace(0, 2 * np.pi, FRAMES)
    document = animated(arm, np.sin(phase), np.stack([phase, np.cos(phase), 0 * phase], axis=1) / 9)
    times = np.linspace(0, (FRAMES - 1) / 30, 4 * FRAMES).astype(np.float32)
    keys = np.arange(FRAMES, dtype=np.float32) / 30
    before, exact = shown(document, keys), shown(document, times)
    keyframes, error = thin_motion(document, tolerance)
    assert error <= tolerance
    assert np.linalg.norm(shown(document, keys) - before, axis=2).max() <= error
    assert np.linalg.norm(shown(document, times) - exact, axis=2).max() <= 1.05 * error
    assert keyframes == len(document.array(document.gltf["animations"][0]["samplers"][0]["input"]))
    assert keyframes < FRAMES or tolerance < 0.1  # points on arcs are compared with straight lines


def test_a_still_animation_keeps_its_ends_and_one_without_tolerance_all(arm):
    still, turning = np.zeros(FRAMES), np.linspace(0, 1, FRAMES)
    assert thin_motion(animated(arm.copy(), still, np.zeros((FRAMES, 3))), 0.001) == (2, 0.0)
    assert thin_motion(animated(arm, turning, np.zeros((FRAMES, 3))), 0.0) == (FRAMES, 0.0)
