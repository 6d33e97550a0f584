"""Foreign skeletons in three.js point their limbs as the service's joints do, whatever their rest pose and axes."""

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.payloads import encode
from engine_bridge.service.protocol.scene import describe

from ..foreign_skeleton import CHARACTER_CREATOR, FOREIGN, MIXAMO, VROID, foreign, hips_place, worst_angle

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
    """Drive a skeleton by payloads of frames."""

    def driven(payloads, bones=None, **names):
        told = {"bones": bones or foreign(), "description": describe(human), "map": names}
        result = open_page().run(DRIVE, told | {"frames": [list(map(float, payload)) for payload in payloads]})
        return dict(zip(FOREIGN, np.array(result["places"]), strict=True)), dict(result["driven"])

    return driven


def payload(frame):
    return np.frombuffer(encode(Kind.BONES, frame, 0)[128:], dtype="<f4")


@pytest.mark.parametrize("names", [MIXAMO, VROID, CHARACTER_CREATOR])
def test_limbs_of_an_a_posed_skeleton_with_other_axes_point_as_those_of_the_service(drive, posed_human, names):
    places, driven = drive([payload(posed_human)], foreign(names))
    assert driven["leftUpperArm"] == names[3]
    assert worst_angle(places, posed_human) < 0.1
    np.testing.assert_allclose(places["Hips"], hips_place(posed_human), atol=1e-4)


def test_a_map_names_bones_and_frames_of_the_wrong_size_or_without_numbers_are_ignored(drive, posed_human):
    bones = [bone | {"name": f"b{number}"} for number, bone in enumerate(foreign())]
    frame = payload(posed_human)
    hostile = [frame[:-1], np.where(np.arange(len(frame)) == 3, np.inf, frame)]
    places, driven = drive(hostile[:1], bones, leftUpperArm="b3", nose="b1")
    assert driven == {"leftUpperArm": "b3"}
    for name, (_, place) in FOREIGN.items():
        np.testing.assert_allclose(places[name], place, atol=1e-6)


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
