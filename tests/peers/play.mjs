// play.mjs FILE N OUTBASE: play a .glb's first animation in three.js and write what every vertex does.
//
// The N times are evenly spaced from 0 to the end, both included. OUTBASE.bin holds little-endian float32: for each mesh
// (N, V, 3) world positions, then (N, V, 3) unit normals where the mesh has normals. OUTBASE.json holds the times, the
// names of animations and nodes and, for each mesh in scene order, its name, the node and primitive of the file that it
// shows, its count V, where (in floats) its two blocks start, its material and its morph targets.

import { readFile, writeFile } from "node:fs/promises";
import { AnimationMixer, LoopOnce, Matrix3, REVISION, Texture, Vector3, Vector4 } from "three";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

function imageName(json, texture) {
  return json.images[json.textures[texture].source].name ?? "";
}

async function load(file) {
  const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);
  // Decoding an image needs a browser, and nothing here looks at one: every material gets an empty texture.
  loader.register((parser) => {
    parser.assignTexture = async (material, slot, { index }) => {
      if (slot === "map") material.map = Object.assign(new Texture(), { name: imageName(parser.json, index) });
      return null;
    };
    return { name: "empty_textures" };
  });
  const bytes = await readFile(file);
  return loader.parseAsync(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength), "");
}

function worldPositions(mesh) {
  const count = mesh.geometry.attributes.position.count;
  const out = new Float32Array(3 * count);
  const point = new Vector3();
  for (let i = 0; i < count; i++) {
    mesh.getVertexPosition(i, point).applyMatrix4(mesh.matrixWorld).toArray(out, 3 * i);
  }
  return out;
}

// three deforms normals only in its shaders; this is what they compute: base + Σ weight · morph, skin, normal matrix.
function worldNormals(mesh) {
  const { attributes, morphAttributes } = mesh.geometry;
  const out = new Float32Array(3 * attributes.normal.count);
  const toWorld = new Matrix3().getNormalMatrix(mesh.matrixWorld);
  const normal = new Vector3();
  const delta = new Vector3();
  const direction = new Vector4();
  for (let i = 0; i < attributes.normal.count; i++) {
    normal.fromBufferAttribute(attributes.normal, i);
    (morphAttributes.normal ?? []).forEach((morph, target) =>
      normal.addScaledVector(delta.fromBufferAttribute(morph, i), mesh.morphTargetInfluences[target]),
    );
    if (mesh.isSkinnedMesh) normal.copy(mesh.applyBoneTransform(i, direction.set(...normal, 0)));
    normal.applyMatrix3(toWorld).normalize().toArray(out, 3 * i);
  }
  return out;
}

function pose(scene, mixer, time) {
  mixer.setTime(time);
  scene.updateMatrixWorld(true);
}

const [file, steps, outBase] = process.argv.slice(2);
const { scene, animations, parser } = await load(file);
if (animations.length === 0) throw new Error(`${file} holds no animation`);

const clip = animations[0];
const mixer = new AnimationMixer(scene);
const action = mixer.clipAction(clip);
action.setLoop(LoopOnce); // a looping action shows its first frame at exactly the end
action.clampWhenFinished = true;
action.play();

const n = Number(steps);
const times = Array.from({ length: n }, (_, i) => (n > 1 ? (clip.duration * i) / (n - 1) : 0));

const meshes = [];
scene.traverse((object) => object.isMesh && meshes.push(object));
const frames = meshes.map(() => ({ positions: [], normals: [] }));
for (const time of times) {
  pose(scene, mixer, time);
  meshes.forEach((mesh, m) => {
    frames[m].positions.push(worldPositions(mesh));
    if (mesh.geometry.attributes.normal) frames[m].normals.push(worldNormals(mesh));
  });
}

// a mesh of one primitive is its node's object, one of several is a child of it
function source(mesh) {
  const own = parser.associations.get(mesh);
  return { node: own.nodes ?? parser.associations.get(mesh.parent).nodes, primitive: own.primitives };
}

function materialOf({ material }) {
  return {
    name: material.name,
    base_color: [...material.color.toArray(), material.opacity],
    images: material.map ? [{ name: material.map.name }] : [],
  };
}

const objects = [];
scene.traverse((object) => objects.push(object.userData.name ?? object.name));

let floats = 0;
const blocks = [];
function append(arrays) {
  const start = floats;
  for (const array of arrays) {
    blocks.push(Buffer.from(array.buffer));
    floats += array.length;
  }
  return start;
}
const description = meshes.map((mesh, m) => ({
  name: mesh.name,
  ...source(mesh),
  count: mesh.geometry.attributes.position.count,
  positions: append(frames[m].positions),
  normals: frames[m].normals.length ? append(frames[m].normals) : null,
  materials: [materialOf(mesh)],
  targets: Object.keys(mesh.morphTargetDictionary ?? {}),
}));
await writeFile(`${outBase}.bin`, Buffer.concat(blocks));
const report = { times, meshes: description, version: REVISION, animations: animations.map(({ name }) => name), objects };
await writeFile(`${outBase}.json`, JSON.stringify(report));
