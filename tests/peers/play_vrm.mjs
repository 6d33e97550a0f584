// play_vrm.mjs VRM [VRMA N]: load an avatar in @pixiv/three-vrm, and play an animation on it at N evenly spaced times.
//
// Prints {warnings, meta, look, expressions, lowest, positions: {bone: [[x, y, z] for each time]}, duration}: whatever the
// libraries print while they load, the names of the expressions and how many morph targets each of them moves, the height
// of the lowest vertex at rest, and the positions of the humanoid's bones in the world, without an animation at rest.

import { readFile } from "node:fs/promises";
import { AnimationMixer, LoopOnce, Texture, Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { VRMLoaderPlugin } from "@pixiv/three-vrm";
import { VRMAnimationLoaderPlugin, createVRMAnimationClip } from "@pixiv/three-vrm-animation";

const warnings = [];
console.warn = console.error = (...parts) => warnings.push(parts.join(" "));

async function load(file) {
  const loader = new GLTFLoader();
  loader.register((parser) => {
    parser.assignTexture = async () => null; // decoding an image needs a browser
    parser.loadTexture = async () => new Texture();
    return new VRMLoaderPlugin(parser);
  });
  loader.register((parser) => new VRMAnimationLoaderPlugin(parser));
  const bytes = await readFile(file);
  return loader.parseAsync(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength), "");
}

function lowest(scene) {
  const point = new Vector3();
  let height = Infinity;
  scene.traverse((mesh) => {
    for (let i = 0; mesh.isMesh && i < mesh.geometry.attributes.position.count; i++) {
      height = Math.min(height, mesh.getVertexPosition(i, point).applyMatrix4(mesh.matrixWorld).y);
    }
  });
  return height;
}

const [file, animation, steps] = process.argv.slice(2);
const { userData, scene } = await load(file);
const { vrm } = userData;
scene.updateMatrixWorld(true);
const bones = Object.keys(vrm.humanoid.humanBones);
const positions = Object.fromEntries(bones.map((bone) => [bone, []]));
const ground = lowest(scene);

function look() {
  scene.updateMatrixWorld(true);
  for (const bone of bones) {
    positions[bone].push(vrm.humanoid.getRawBoneNode(bone).getWorldPosition(new Vector3()).toArray());
  }
}

let duration = 0;
if (animation) {
  const clip = createVRMAnimationClip((await load(animation)).userData.vrmAnimations[0], vrm);
  duration = clip.duration;
  const mixer = new AnimationMixer(scene);
  const action = mixer.clipAction(clip);
  action.setLoop(LoopOnce); // a looping action shows its first frame at exactly the end
  action.clampWhenFinished = true;
  action.play();
  for (let i = 0; i < Number(steps); i++) {
    mixer.setTime((duration * i) / Math.max(Number(steps) - 1, 1));
    vrm.update(0);
    look();
  }
} else {
  look();
}

const moved = (expression) => expression.binds.reduce((count, bind) => count + bind.primitives.length, 0);
console.log(
  JSON.stringify({
    warnings,
    meta: vrm.meta,
    look: vrm.lookAt.offsetFromHeadBone.toArray(),
    expressions: Object.fromEntries(
      (vrm.expressionManager?.expressions ?? []).map((each) => [each.expressionName, moved(each)]),
    ),
    lowest: ground,
    positions,
    duration,
  }),
);
