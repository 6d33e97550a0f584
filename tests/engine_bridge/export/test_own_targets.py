"""Morph targets of the file that channels move, in all forms of an export and in films."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from engine_bridge.character import own_targets
from engine_bridge.character.character import load_character
from engine_bridge.export.convert import write
from engine_bridge.performance.clip import load_timeline, perform
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings

from ..character.conftest import CORNERS, SIDES
from .conftest import Raw

HALF = np.sqrt(0.5)


@pytest.mark.parametrize(("form", "limbs"), [("morph", False), ("frames", False), ("rig", True)])
def test_a_target_follows_its_channel(talking, take, tmp_path, assert_valid_gltf, form, limbs):
    settings = Settings(form=form)
    timeline, _ = load_timeline(take, settings)
    voice = np.clip(np.sin(np.arange(len(timeline.positions)) / 3), 0, 1).astype(np.float32)
    timeline = replace(timeline, channels={"voice": voice})
    clip = perform(load_prepared(talking(limbs)), timeline, settings, (), lambda *_: None)
    write(clip, tmp_path / "out.glb", "clip", settings, lambda *_: None)
    assert_valid_gltf(tmp_path / "out.glb")
    made = Raw(tmp_path / "out.glb")
    animation = made.file.animations[0]
    (channel,) = [each for each in animation.channels if each.target.path == "weights"]
    times = made.array(animation.samplers[channel.sampler].input)[:, 0]
    assert_allclose(np.interp(timeline.times, times, made.weights(channel.target.node)[:, 0]), voice, atol=1e-6)


def test_displacements_are_those_of_the_world(glb, tmp_path):
    moved = np.outer([0, 1, 0, 0], [0, 0, 1]).astype(np.float32)
    jaw = glb.primitive(CORNERS, SIDES, targets=[{"POSITION": moved}])
    mesh = glb.mesh(jaw, extras={"targetNames": ["jaw"]}, weights=[0.25])
    glb.node(mesh, scale=[1, 1, 2], rotation=[0, HALF, 0, HALF])
    character = load_character(glb.save(tmp_path / "a.glb"))
    assert own_targets.names_of(character) == ["jaw"]
    found = own_targets.displacements(character, "jaw")
    np.testing.assert_allclose(found, np.outer([0, 1.5, 0, 0], [1, 0, 0]), atol=1e-6)
    assert not own_targets.displacements(character, "brow").any()
