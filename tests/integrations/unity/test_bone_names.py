"""The package knows the same joints of skeletons as `capture.bone_names` does."""

import json
import subprocess

import pytest

from ..bone_names import BoneNames


class TestBoneNames(BoneNames):
    @pytest.fixture
    def recognise(self, mono, built):
        def run(joints, skeletons):
            told = json.dumps({"joints": joints, "skeletons": skeletons})
            command = [mono[1], built / "Naming.exe"]
            said = subprocess.run(command, input=told, capture_output=True, text=True, check=True).stdout
            return [dict(json.loads(line)["found"]) for line in said.splitlines()]

        return run
