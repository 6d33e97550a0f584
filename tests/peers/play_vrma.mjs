// play_vrma.mjs AVATAR.vrm ANIMATION.vrma N: play a VRM animation on a VRM with three-vrm, as an avatar program does.
//
// Prints JSON: the N times, evenly spaced from 0 to the end, the world positions of the avatar's humanoid bones at each
// of them, {bone: [[x, y, z], …]}, and all that the loaders warned about.

import { readFile } from "node:fs/promises";
import { VRMLoaderPlugin } from "@pixiv/three-vrm";
import { VRMAnimationLoaderPlugin, createVRMAnimationClip } from "@pixiv/three-vrm-animation";
import { AnimationMixer, LoopOnce, Texture, Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const warnings = [];
console.warn = console.error = (...words) => warnings.push(words.join(" "));

async function load(file, plugin) {
  const loader = new GLTFLoader();
  // decoding an image needs a browser, and nothing here looks at one
  loader.register((parser) => {
    parser.loadTexture = async () => new Texture();
    return { name: "empty_textures" };
  });
  loader.register(plugin);
  const bytes = await readFile(file);
  const gltf = await loader.parseAsync(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength), "");
  return gltf.userData;
}

const [avatar, animation, count] = process.argv.slice(2);
const { vrm } = await load(avatar, (parser) => new VRMLoaderPlugin(parser));
const { vrmAnimations } = await load(animation, (parser) => new VRMAnimationLoaderPlugin(parser));
const clip = createVRMAnimationClip(vrmAnimations[0], vrm);
const mixer = new AnimationMixer(vrm.scene);
const action = mixer.clipAction(clip);
action.setLoop(LoopOnce);
action.clampWhenFinished = true;
action.play();

const times = Array.from({ length: Number(count) }, (_, k) => (clip.duration * k) / (Number(count) - 1));
const bones = {};
for (const time of times) {
  mixer.setTime(time);
  vrm.update(0);
  vrm.scene.updateMatrixWorld(true);
  for (const [name, { node }] of Object.entries(vrm.humanoid.rawHumanBones)) {
    (bones[name] ??= []).push(node.getWorldPosition(new Vector3()).toArray());
  }
}
console.log(JSON.stringify({ times, bones, warnings }));
