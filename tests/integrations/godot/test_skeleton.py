"""Foreign skeletons in Godot point their limbs as the service's joints do, whatever their rest pose and axes."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Header, Kind, join, topic

from ..foreign_skeleton import foreign
from ..limbs import NUMBERED, Limbs, values_of


@pytest.fixture
def drive_by(run_godot, human, tmp_path):
    """Drive a skeleton by the bytes of a frame."""

    def driven(payload, bones, **bone_map):
        scene = Header(kind=Kind.SCENE, length=len(human.scene), revision=human.revision)
        frame = Header(kind=Kind.BONES, length=len(payload), revision=human.revision, sequence=1)
        for name, content in (
            ("told", json.dumps({"bones": bones, "map": bone_map}).encode()),
            ("scene", join(topic("figure", Kind.SCENE), scene, human.scene)),
            ("frame", join(topic("figure", Kind.BONES), frame, payload)),
        ):
            (tmp_path / name).write_bytes(content)
        (result,) = run_godot("drive_skeleton.gd", *(tmp_path / name for name in ("told", "scene", "frame")))
        return SimpleNamespace(**result)

    return driven


class TestLimbs(Limbs):
    @pytest.fixture
    def drive(self, drive_by):
        def driven(values, bones, **names):
            result = drive_by(values.tobytes(), bones, **names)
            places = np.array(result.poses)[:, :3]
            return places, {joint: bone.replace("mixamorig_", "mixamorig:") for joint, bone in result.driven.items()}

        return driven


def test_what_is_wrong_with_a_map_is_a_warning(drive_by, posed_human):
    assert len(drive_by(values_of(posed_human).tobytes(), NUMBERED).warnings) == 1
    warnings = drive_by(b"", NUMBERED, leftUpperArm="b3", nose="b1", leftHand="missing").warnings
    for wrong in ("nose", "missing"):
        assert any(wrong in warning for warning in warnings)


def test_a_frame_of_the_wrong_size_or_without_numbers_is_no_pose(drive_by, posed_human):
    values = values_of(posed_human)
    for hostile in (values[:-1], np.full_like(values, np.nan)):
        assert drive_by(hostile.tobytes(), foreign()).damaged == 1


@pytest.mark.parametrize(("influence", "jaw"), [(1, [0.25, 0.55, 1.0, 0.25]), (0.5, [0.25, 0.4, 0.625, 0.25])])
def test_a_voice_moves_the_targets_of_the_models_own_face(run_godot, spoken_files, influence, jaw):
    told = run_godot("own_target.gd", influence, *spoken_files(Kind.BONES))
    np.testing.assert_allclose([each["values"] for each in told], [[0.3, each] for each in jaw], atol=1e-6)
