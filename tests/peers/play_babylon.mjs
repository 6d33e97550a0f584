// play_babylon.mjs FILE N OUTBASE: play a .glb's first animation in Babylon.js and write what every vertex does.
//
// The N times are evenly spaced from the animation's start to its end, both included. OUTBASE.bin holds little-endian
// float32: for each mesh (N, V, 3) world positions. OUTBASE.json is as that of play.mjs; no mesh has normals in it.

import { readFile, writeFile } from "node:fs/promises";
import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { NullEngine } from "@babylonjs/core/Engines/nullEngine.js";
import { ImportMeshAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { MeshoptCompression } from "@babylonjs/core/Meshes/Compression/meshoptCompression.js";
import { Logger } from "@babylonjs/core/Misc/logger.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/core/Animations/animatable.js";
import "@babylonjs/core/Helpers/sceneHelpers.js";
import "@babylonjs/loaders/glTF/2.0/index.js";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";

// a browser loads the same decoder from Babylon's servers
MeshoptCompression._Default = {
  async decodeGltfBufferAsync(source, count, stride, mode, filter) {
    return MeshoptDecoder.decodeGltfBufferAsync(count, stride, source, mode, filter);
  },
};

// the loader keeps with each node of the file what it has made of the node's primitives
function source(mesh) {
  const node = file.nodes.findIndex((own) => own._primitiveBabylonMeshes?.includes(mesh));
  return { node, primitive: file.nodes[node]._primitiveBabylonMeshes.indexOf(mesh) };
}

function worldPositions(mesh) {
  const toWorld = mesh.computeWorldMatrix(true);
  const local = mesh.getPositionData(true, true);
  const out = new Float32Array(local.length);
  const point = new Vector3();
  for (let i = 0; i < local.length; i += 3) {
    Vector3.TransformCoordinatesFromFloatsToRef(local[i], local[i + 1], local[i + 2], toWorld, point);
    point.toArray(out, i);
  }
  return out;
}

function materialOf({ material }) {
  const texture = material?.albedoTexture;
  return {
    name: material?.name ?? "",
    base_color: material ? [...material.albedoColor.asArray(), material.alpha] : [1, 1, 1, 1],
    images: texture ? [{ name: texture.name }] : [],
  };
}

function targetsOf({ morphTargetManager: targets }) {
  return Array.from({ length: targets?.numTargets ?? 0 }, (_, i) => targets.getTarget(i).name);
}

const [path, steps, outBase] = process.argv.slice(2);
Logger.LogLevels = Logger.ErrorLogLevel;
const scene = new Scene(new NullEngine());
scene.useRightHandedSystem = true; // or the loader would mirror the file
new FreeCamera("camera", new Vector3(), scene);
const data = `data:;base64,${(await readFile(path)).toString("base64")}`;
let file;
const pluginOptions = { gltf: { onParsed: ({ json }) => (file = json) } };
const made = await ImportMeshAsync(data, scene, { pluginExtension: ".glb", pluginOptions });
const { meshes, transformNodes, animationGroups } = made;
if (animationGroups.length === 0) throw new Error(`${path} holds no animation`);

const played = animationGroups.filter(({ isPlaying }) => isPlaying);
const [group] = played;
group.pause();
const n = Number(steps);
const shown = meshes.filter((mesh) => mesh.getTotalVertices() > 0);
for (const mesh of shown) mesh.alwaysSelectAsActiveMesh = true; // also those that the camera does not see
const frames = shown.map(() => []);
for (let i = 0; i < n; i++) {
  group.goToFrame(n > 1 ? group.from + ((group.to - group.from) * i) / (n - 1) : group.from);
  scene.render();
  shown.forEach((mesh, m) => frames[m].push(worldPositions(mesh)));
}

let floats = 0;
const description = shown.map((mesh, m) => {
  const positions = floats;
  floats += n * frames[m][0].length;
  const count = mesh.getTotalVertices();
  const looks = { materials: [materialOf(mesh)], targets: targetsOf(mesh) };
  return { name: mesh.name, ...source(mesh), count, positions, normals: null, ...looks };
});
const blocks = frames.flat().map((array) => Buffer.from(array.buffer));
await writeFile(`${outBase}.bin`, Buffer.concat(blocks));
const seconds = (group.to - group.from) / group.targetedAnimations[0].animation.framePerSecond;
const report = {
  times: Array.from({ length: n }, (_, i) => (n > 1 ? (seconds * i) / (n - 1) : 0)),
  meshes: description,
  version: Engine.Version,
  animations: animationGroups.map(({ name }) => name),
  playing: played.map(({ name }) => name),
  objects: [...meshes, ...transformNodes].map(({ name }) => name),
};
await writeFile(`${outBase}.json`, JSON.stringify(report));
process.exit(0); // the engine waits for a next picture
