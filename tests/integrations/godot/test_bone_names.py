"""The addon knows the same joints of skeletons as `capture.bone_names` does."""

import json

import pytest

from ..bone_names import BoneNames


class TestBoneNames(BoneNames):
    @pytest.fixture
    def recognise(self, run_godot, tmp_path):
        def run(joints, skeletons):
            (tmp_path / "told.json").write_text(json.dumps({"joints": joints, "skeletons": skeletons}))
            (result,) = run_godot("find_bones.gd", tmp_path / "told.json")
            return [{joint: int(index) for joint, index in found.items()} for found in result["found"]]

        return run
