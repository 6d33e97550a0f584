"""Foreign skeletons in Godot point their limbs as the service's joints do, whatever their rest pose and axes."""

import json
import time
from types import SimpleNamespace

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Header, Kind, join, topic
from engine_bridge.service.protocol.payloads import encode

from ..foreign_skeleton import CHARACTER_CREATOR, FOREIGN, MIXAMO, VROID, foreign, hips_place, worst_angle


@pytest.fixture
def drive(run_godot, human, tmp_path):
    """Drive a skeleton by a frame."""

    def driven(payloads, bones=None, bone_map=(), **more):
        told = {"bones": foreign() if bones is None else bones, "map": dict(bone_map)}
        (tmp_path / "told.json").write_text(json.dumps(told))
        scene = Header(kind=Kind.SCENE, length=len(human.scene), revision=human.revision, published=time.monotonic_ns())
        (tmp_path / "scene").write_bytes(join(topic("figure", Kind.SCENE), scene, human.scene))
        for number, payload in enumerate(payloads):
            (tmp_path / f"frame_{number}").write_bytes(payload)
        paths = [tmp_path / f"frame_{number}" for number in range(len(payloads))]
        (result,) = run_godot("drive_skeleton.gd", tmp_path / "told.json", tmp_path / "scene", *paths, **more)
        return SimpleNamespace(**result)

    return driven


@pytest.mark.parametrize("names", [MIXAMO, VROID, CHARACTER_CREATOR])
def test_limbs_of_an_a_posed_skeleton_with_other_axes_point_as_those_of_the_service(drive, posed_human, names):
    result = drive([encode(Kind.BONES, posed_human, 0)], foreign(names))
    assert result.driven["leftUpperArm"] == names[3].replace(":", "_")
    places = dict(zip(FOREIGN, np.array(result.poses)[:, :3], strict=True))
    assert worst_angle(places, posed_human) < 0.1
    np.testing.assert_allclose(places["Hips"], hips_place(posed_human), atol=1e-4)


def test_a_map_names_bones_that_are_not_recognised_and_says_what_is_wrong(drive, posed_human):
    bones = [bone | {"name": f"b{number}"} for number, bone in enumerate(foreign())]
    result = drive([encode(Kind.BONES, posed_human, 0)], bones)
    assert result.driven == {}
    assert any("No bone of the skeleton has a known name" in warning for warning in result.warnings)
    result = drive([], bones, {"leftUpperArm": "b3", "nose": "b1", "leftHand": "missing"})
    assert result.driven == {"leftUpperArm": "b3"}
    assert any("no joint 'nose'" in warning for warning in result.warnings)
    assert any("no bone 'missing'" in warning for warning in result.warnings)


def test_a_frame_of_the_wrong_size_or_without_numbers_is_no_pose(drive, posed_human):
    message = encode(Kind.BONES, posed_human, 0)
    short = bytearray(message[:-4])
    short[64 + 12 : 64 + 16] = (len(message) - 128 - 4).to_bytes(4, "little")
    result = drive([bytes(short)])
    assert result.damaged == 1
    hostile = message[:128] + np.full((len(message) - 128) // 4, np.nan, dtype="<f4").tobytes()
    assert drive([hostile]).damaged == 1


@pytest.mark.parametrize(("influence", "jaw"), [(1, [0.25, 0.55, 1.0, 0.25]), (0.5, [0.25, 0.4, 0.625, 0.25])])
def test_a_voice_moves_the_targets_of_the_models_own_face(run_godot, spoken_files, influence, jaw):
    told = run_godot("own_target.gd", influence, *spoken_files(Kind.BONES))
    np.testing.assert_allclose([each["values"] for each in told], [[0.3, each] for each in jaw], atol=1e-6)
