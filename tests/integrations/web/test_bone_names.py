"""Pages know the same joints of skeletons as `capture.bone_names` does."""

import pytest

from ..bone_names import BoneNames

RECOGNISE = """async ({ joints, skeletons }) => {
  const { recognised } = await import("/bone-names.js");
  return skeletons.map((names) => Object.fromEntries(recognised(joints, names)));
}"""


class TestBoneNames(BoneNames):
    @pytest.fixture
    def recognise(self, open_page):
        return lambda joints, skeletons: open_page().run(RECOGNISE, {"joints": joints, "skeletons": skeletons})
