"""Foreign skeletons in three.js point their limbs as the service's joints do, whatever their rest pose and axes."""

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.scene import describe

from ..foreign_skeleton import FOREIGN, foreign
from ..limbs import Limbs, values_of

pytestmark = pytest.mark.slow

DRIVE = """({ bones, description, frames, map }) => {
  const root = new THREE.Group();
  const made = [];
  for (const { name, parent, rotation, position } of bones) {
    const bone = new THREE.Bone();
    bone.name = name;
    bone.quaternion.fromArray(rotation);
    bone.position.fromArray(position);
    (parent < 0 ? root : made[parent]).add(bone);
    made.push(bone);
  }
  const pose = new driving.SkeletonPose(description, root, map);
  for (const values of frames) pose.apply(new Float32Array(values));
  root.updateMatrixWorld(true);
  const driven = [...pose.bones].map(([joint, bone]) => [pose.joints.names[joint], bone.name]);
  return { places: made.map((bone) => bone.getWorldPosition(new THREE.Vector3()).toArray()), driven };
}"""


@pytest.fixture
def drive(open_page, human):
    """Drive a skeleton by the numbers of a frame."""

    def driven(values, bones, **names):
        told = {"bones": bones, "description": describe(human), "map": names, "frames": [list(map(float, values))]}
        result = open_page().run(DRIVE, told)
        return np.array(result["places"]), dict(result["driven"])

    return driven


class TestLimbs(Limbs):
    pass


def test_frames_of_the_wrong_size_or_without_numbers_are_ignored(drive, posed_human):
    frame = values_of(posed_human)
    for hostile in (frame[:-1], np.where(np.arange(len(frame)) == 3, np.inf, frame)):
        np.testing.assert_allclose(drive(hostile, foreign())[0], [place for _, place in FOREIGN.values()], atol=1e-6)


SPEAK = """async (addresses) => {
  const [scene, ...frames] = await Promise.all(addresses.map(load));
  const face = new THREE.Mesh();
  face.morphTargetDictionary = { brow: 0, jaw: 1 };
  face.morphTargetInfluences = [0.3, 0.25];
  const heard = {};
  const client = { subscribe: (topic, take) => (heard[topic.split("/")[1]] = take), ask: () => {} };
  const driver = new driving.PuppetSkeleton(client, "talker", new THREE.Group().add(face), { delay: 0 });
  heard.scene(scene);
  return frames.map((frame) => {
    heard.bones({ ...frame, header: { ...frame.header, time: 0 } }); // each begins a motion
    driver.update();
    return [...face.morphTargetInfluences];
  });
}"""


def test_a_voice_moves_the_targets_of_the_models_own_face(open_page, site, spoken_files):
    shown = open_page().run(SPEAK, [site.add(each) for each in spoken_files(Kind.BONES)])
    np.testing.assert_allclose(shown, [[0.3, 0.25], [0.3, 0.55], [0.3, 1.0]], atol=1e-6)
