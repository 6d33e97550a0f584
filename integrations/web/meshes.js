// Meshes of a character in three.js, with the attributes that the vertex shader reads.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DoubleSide,
  FrontSide,
  InterleavedBuffer,
  InterleavedBufferAttribute,
  Matrix3,
  Mesh,
  MeshStandardMaterial,
  Vector3,
} from "three";
import { MAX_FIELDS } from "./shader.js";

/** @import {Scene, Part} from "./message.js" */
/** @import {Object3D} from "three" */
/** @import {RestPose} from "./targets.js" */

/** Attribute of a mesh from `puppetline shader-mesh` whose first number is the vertex's number in the scene. */
const NUMBER = "texcoord_6";

/** Other attributes of such a mesh that nothing reads, because the scene has them exactly. */
const ROUNDED = ["uv2", "uv3", "texcoord_4", "texcoord_5", NUMBER];

/**
 * Return a mesh for each part of a scene that has triangles.
 *
 * @param {Scene} scene
 * @param {RestPose} rest
 */
export function partsOf(scene, rest) {
  const attributes = attributesOf(scene, rest, null);
  return scene.description.parts
    .filter((part) => part.triangles[1] > 0)
    .map((part) => {
      const geometry = new BufferGeometry();
      for (const [name, attribute] of Object.entries(attributes)) geometry.setAttribute(name, attribute);
      const [first, count] = part.triangles;
      geometry.setIndex(new BufferAttribute(scene.triangles.slice(3 * first, 3 * (first + count)), 1));
      const mesh = new Mesh(geometry, materialOf(part.material, scene.colors !== null));
      mesh.name = part.name;
      return mesh;
    });
}

/**
 * @param {Part["material"]} material
 * @param {boolean} isColored whether vertex colours have the base colour already
 */
function materialOf(material, isColored) {
  const [r, g, b, a] = material.base_color;
  return new MeshStandardMaterial({
    name: material.name,
    color: isColored ? new Color(1, 1, 1) : new Color(r, g, b),
    opacity: a,
    metalness: material.metallic,
    roughness: material.roughness,
    emissive: new Color(...material.emissive),
    side: material.double_sided ? DoubleSide : FrontSide,
    transparent: material.alpha_mode === "BLEND",
    vertexColors: isColored,
  });
}

/**
 * Take the meshes below an object that have vertex numbers, and give them the exact attributes of the scene.
 *
 * @param {Object3D} source
 * @param {Scene} scene
 * @param {RestPose} rest
 */
export function meshesOf(source, scene, rest) {
  source.updateMatrixWorld(true);
  /** @type {Mesh[]} */
  const found = [];
  source.traverse((each) => {
    if (each instanceof Mesh && each.geometry.hasAttribute(NUMBER)) found.push(each);
  });
  if (!found.length) throw new RangeError("No mesh has vertex numbers; make the file with puppetline shader-mesh.");
  return found.map((each) => {
    const geometry = each.geometry.clone();
    const numbers = geometry.getAttribute(NUMBER);
    const order = Uint32Array.from({ length: numbers.count }, (_, i) => Math.round(numbers.getX(i)));
    if (order.some((number) => number >= scene.count)) {
      throw new RangeError("The file is of another mesh than the service's; run puppetline shader-mesh again.");
    }
    for (const name of ROUNDED) geometry.deleteAttribute(name);
    for (const [name, attribute] of Object.entries(attributesOf(scene, rest, order))) {
      if (name !== "uv" && name !== "color") geometry.setAttribute(name, attribute);
    }
    if (geometry.hasAttribute("tangent")) turnTangents(geometry, new Matrix3().setFromMatrix4(each.matrixWorld));
    const material = Array.isArray(each.material) ? each.material.map((own) => own.clone()) : each.material.clone();
    const mesh = new Mesh(geometry, material);
    mesh.name = each.name;
    return mesh;
  });
}

/**
 * Rotate tangents from the coordinates of a node to those of the file.
 *
 * @param {BufferGeometry} geometry
 * @param {Matrix3} toFile
 */
function turnTangents(geometry, toFile) {
  const tangents = geometry.getAttribute("tangent").clone();
  const tangent = new Vector3();
  for (let i = 0; i < tangents.count; i++) {
    tangent.fromBufferAttribute(tangents, i).applyMatrix3(toFile).normalize();
    tangents.setXYZ(i, tangent.x, tangent.y, tangent.z);
  }
  geometry.setAttribute("tangent", tangents);
}

/**
 * Return the attributes of a scene's vertices.
 *
 * @param {Scene} scene
 * @param {RestPose} rest
 * @param {Uint32Array | null} order number of each vertex; null for all in their order
 * @returns {{[name: string]: BufferAttribute | InterleavedBufferAttribute}}
 */
function attributesOf(scene, rest, order) {
  const { fields } = scene;
  const coordinates = new InterleavedBuffer(picked(scene.coordinates, fields, MAX_FIELDS, order), MAX_FIELDS);
  const slopes = new InterleavedBuffer(picked(scene.slopes, 2 * fields, 2 * MAX_FIELDS, order), 2 * MAX_FIELDS);
  return {
    position: rest.follow(new BufferAttribute(picked(rest.positions, 3, 3, order), 3), order),
    normal: new BufferAttribute(picked(scene.normals, 3, 3, order), 3),
    ...(scene.uv && { uv: new BufferAttribute(picked(scene.uv, 2, 2, order), 2) }),
    ...(scene.colors && { color: new BufferAttribute(picked(scene.colors, 3, 3, order), 3) }),
    puppetCoordinates0: new InterleavedBufferAttribute(coordinates, 4, 0),
    puppetCoordinates1: new InterleavedBufferAttribute(coordinates, 4, 4),
    puppetSlopes0: new InterleavedBufferAttribute(slopes, 4, 0),
    puppetSlopes1: new InterleavedBufferAttribute(slopes, 4, 4),
    puppetSlopes2: new InterleavedBufferAttribute(slopes, 4, 8),
    puppetSlopes3: new InterleavedBufferAttribute(slopes, 4, 12),
  };
}

/**
 * Return rows of values in an order, each padded with zeros.
 *
 * @param {Float32Array} values
 * @param {number} size of a row
 * @param {number} padded size of a row in the result
 * @param {Uint32Array | null} order
 */
function picked(values, size, padded, order) {
  if (!order && size === padded) return values;
  const count = order ? order.length : values.length / size;
  const rows = new Float32Array(padded * count);
  for (let i = 0; i < count; i++) {
    const row = order ? order[i] : i;
    rows.set(values.subarray(size * row, size * (row + 1)), padded * i);
  }
  return rows;
}
