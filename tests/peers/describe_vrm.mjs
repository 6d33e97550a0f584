// describe_vrm.mjs VRM: load an avatar in three-vrm and print what it finds.
//
// Prints JSON: all that the loaders warned about; `meta`; the viewpoint's offset from the head; the expressions, with the
// number of meshes that each of them moves; the world positions of the humanoid's bones, {bone: [x, y, z]}; and the
// lowest and highest corner of all vertices.

import { readFile } from "node:fs/promises";
import { VRMLoaderPlugin } from "@pixiv/three-vrm";
import { Box3, Texture, Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const warnings = [];
console.warn = console.error = (...words) => warnings.push(words.join(" "));

const loader = new GLTFLoader();
// decoding an image needs a browser, and nothing here looks at one
loader.register((parser) => {
  parser.loadTexture = async () => new Texture();
  return { name: "empty_textures" };
});
loader.register((parser) => new VRMLoaderPlugin(parser));
const bytes = await readFile(process.argv[2]);
const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
const { vrm } = (await loader.parseAsync(buffer, "")).userData;
vrm.scene.updateMatrixWorld(true);

const box = new Box3();
const point = new Vector3();
vrm.scene.traverse((mesh) => {
  for (let i = 0; mesh.isMesh && i < mesh.geometry.attributes.position.count; i++) {
    box.expandByPoint(mesh.getVertexPosition(i, point).applyMatrix4(mesh.matrixWorld));
  }
});

const bones = Object.entries(vrm.humanoid.rawHumanBones);
const { expressions } = vrm.expressionManager;
const report = {
  warnings,
  meta: vrm.meta,
  viewpoint: vrm.lookAt.offsetFromHeadBone.toArray(),
  expressions: Object.fromEntries(expressions.map(({ expressionName, binds }) => [expressionName, binds.length])),
  bones: Object.fromEntries(bones.map(([name, { node }]) => [name, node.getWorldPosition(new Vector3()).toArray()])),
  box: [box.min.toArray(), box.max.toArray()],
};
console.log(JSON.stringify(report));
