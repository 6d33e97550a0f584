// Characters of a Puppetline service in three.js: deformed on the graphics card, interpolated between frames.
//
//     const puppet = new Puppet(new Client("ws://127.0.0.1:7402/stream"), "dog");
//     scene.add(puppet);
//     renderer.setAnimationLoop(() => { puppet.update(); renderer.render(scene, camera); });
//
// WebGLRenderer only. docs/web.md describes it.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DataTexture,
  DoubleSide,
  FloatType,
  FrontSide,
  Group,
  InterleavedBuffer,
  InterleavedBufferAttribute,
  Matrix3,
  Mesh,
  MeshDepthMaterial,
  MeshDistanceMaterial,
  MeshStandardMaterial,
  RGBADepthPacking,
  RGBAFormat,
  Sphere,
  Vector3,
} from "three";
import { Character } from "./character.js";
import { TRANSFORM, evaluate } from "./evaluation.js";
import { IsolineBounds } from "./isoline-bounds.js";
import { JitterBuffer } from "./jitter-buffer.js";

/** @import {Client} from "./client.js" */
/** @import {Scene, Message, Part} from "./message.js" */
/** @import {Material, Object3D, Object3DEventMap} from "three" */
/** @typedef {{[name: string]: {value: any}}} Uniforms */

/** Maximum number of fields, whose isoline coordinates fit into two vertex attributes. */
export const MAX_FIELDS = 8;

/** Attribute of a mesh from `puppetline shader-mesh` whose first number is the vertex's number in the scene. */
const NUMBER = "texcoord_6";

/** Other attributes of such a mesh that nothing reads, because the scene has them exactly. */
const ROUNDED = ["uv2", "uv3", "texcoord_4", "texcoord_5", NUMBER];

/** Shader code before main(). Rows of a transform are the columns of a mat4, so x * transform transforms x. */
const DECLARATIONS = `
attribute vec4 puppetCoordinates0;
attribute vec4 puppetCoordinates1;
attribute vec4 puppetSlopes0;
attribute vec4 puppetSlopes1;
attribute vec4 puppetSlopes2;
attribute vec4 puppetSlopes3;
uniform highp sampler2D puppetFrame0;
uniform highp sampler2D puppetFrame1;
uniform float puppetShare;
uniform vec3 puppetShift;
uniform float puppetWeights[${MAX_FIELDS}];
uniform int puppetFields;
uniform int puppetIsolines;

vec3 puppetPosition;
vec3 puppetNormal;
vec3 puppetRestA;
vec3 puppetRestB;
vec3 puppetAlongA;
vec3 puppetAlongB;

mat4 puppetTransform(int number) {
  mat4 transform = mat4(0.0);
  for (int row = 0; row < 3; row++) {
    transform[row] = mix(
      texelFetch(puppetFrame0, ivec2(row, number), 0), texelFetch(puppetFrame1, ivec2(row, number), 0), puppetShare);
  }
  return transform;
}

vec3 puppetNormalized(vec3 vector) {
  float size = length(vector);
  return size > 0.0 ? vector / size : vec3(0.0);
}

// The first tangent along which slopes are defined (docs/protocol.md). Slopes are valid for this tangent only.
vec3 puppetFirstTangent(vec3 direction) {
  vec3 size = abs(direction);
  vec3 axis = vec3(0.0, 0.0, 1.0);
  if (size.x <= size.y && size.x <= size.z) axis = vec3(1.0, 0.0, 0.0);
  else if (size.y <= size.z) axis = vec3(0.0, 1.0, 0.0);
  return puppetNormalized(cross(axis, direction));
}

void puppetMove() {
  vec4 x = vec4(position, 1.0);
  puppetRestA = puppetFirstTangent(normal);
  puppetRestB = cross(normal, puppetRestA);
  float coordinates[8] = float[8](
    puppetCoordinates0.x, puppetCoordinates0.y, puppetCoordinates0.z, puppetCoordinates0.w,
    puppetCoordinates1.x, puppetCoordinates1.y, puppetCoordinates1.z, puppetCoordinates1.w);
  vec2 slopes[8] = vec2[8](
    puppetSlopes0.xy, puppetSlopes0.zw, puppetSlopes1.xy, puppetSlopes1.zw,
    puppetSlopes2.xy, puppetSlopes2.zw, puppetSlopes3.xy, puppetSlopes3.zw);
  puppetPosition = puppetShift;
  puppetAlongA = vec3(0.0);
  puppetAlongB = vec3(0.0);
  for (int field = 0; field < puppetFields; field++) {
    int isoline = clamp(int(coordinates[field]), 0, puppetIsolines - 2);
    mat4 lower = puppetTransform(field * puppetIsolines + isoline);
    mat4 rise = puppetTransform(field * puppetIsolines + isoline + 1) - lower;
    mat4 blend = lower + rise * (coordinates[field] - float(isoline));
    vec3 step = (x * rise).xyz;
    puppetPosition += puppetWeights[field] * (x * blend).xyz;
    puppetAlongA += puppetWeights[field] * ((vec4(puppetRestA, 0.0) * blend).xyz + slopes[field].x * step);
    puppetAlongB += puppetWeights[field] * ((vec4(puppetRestB, 0.0) * blend).xyz + slopes[field].y * step);
  }
  puppetNormal = puppetNormalized(cross(puppetAlongA, puppetAlongB));
}
`;

const NORMAL = `
vec3 objectNormal = puppetNormal;
#ifdef USE_TANGENT
  vec3 objectTangent = puppetNormalized(
    dot(tangent.xyz, puppetRestA) * puppetAlongA + dot(tangent.xyz, puppetRestB) * puppetAlongB);
#endif
`;

const POSITION = `
vec3 transformed = puppetPosition;
#ifdef USE_ALPHAHASH
  vPosition = vec3(position);
#endif
`;

/**
 * Make a material deform its mesh. Its vertex shader must include three's chunks `common` and `begin_vertex`.
 *
 * @template {Material} M
 * @param {M} material is changed
 * @param {Uniforms} uniforms those of a `PuppetMesh`
 * @returns {M}
 */
export function deform(material, uniforms) {
  const before = material.onBeforeCompile.bind(material);
  material.onBeforeCompile = (shader, renderer) => {
    before(shader, renderer);
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>\n${DECLARATIONS}`)
      .replace("void main() {", "void main() {\npuppetMove();")
      .replace("#include <beginnormal_vertex>", NORMAL)
      .replace("#include <begin_vertex>", POSITION);
  };
  const key = material.customProgramCacheKey.bind(material);
  material.customProgramCacheKey = () => `${key()} puppetline`;
  return material;
}

/** A character that the graphics card deforms; `show` sets its pose. */
export class PuppetMesh extends Group {
  #bounds;
  #followRoot;
  /** Transforms of two frames. @type {Float32Array[]} */
  #controls;
  /** The same, on the graphics card. @type {DataTexture[]} */
  #textures;
  /** @type {(Message | null)[]} */
  #frames = [null, null];
  #sphere = new Sphere();

  /**
   * @param {Scene} scene of the service
   * @param {{source?: Object3D, followRoot?: boolean}} [options] `source` is what GLTFLoader has read of a file from
   * `puppetline shader-mesh`, with the character's materials and textures; `followRoot` whether the character walks with
   * its performer, or stays in place
   * @throws {RangeError} a character with more than 8 fields
   */
  constructor(scene, { source, followRoot = true } = {}) {
    super();
    if (scene.fields > MAX_FIELDS) throw new RangeError(`${scene.fields} fields, more than the maximum of ${MAX_FIELDS}.`);
    this.scene = scene;
    this.#followRoot = followRoot;
    this.#bounds = new IsolineBounds(scene);
    const count = scene.fields * scene.isolines;
    this.#controls = [0, 1].map(() => new Float32Array(TRANSFORM * count));
    this.#textures = this.#controls.map((controls) => {
      const texture = new DataTexture(controls, 3, count, RGBAFormat, FloatType);
      texture.needsUpdate = true;
      return texture;
    });
    const weights = Array.from({ length: MAX_FIELDS }, (_, field) => scene.weights[field] ?? 0);
    /** Uniforms of its materials; see `deform`. @type {Uniforms} */
    this.uniforms = {
      puppetFrame0: { value: this.#textures[0] },
      puppetFrame1: { value: this.#textures[1] },
      puppetShare: { value: 0 },
      puppetShift: { value: new Vector3() },
      puppetWeights: { value: weights },
      puppetFields: { value: scene.fields },
      puppetIsolines: { value: scene.isolines },
    };
    const meshes = source ? meshesOf(source, scene) : partsOf(scene);
    for (const mesh of meshes) this.#add(mesh);
    this.visible = false; // until there is a pose
  }

  /** The deforming meshes. @returns {Mesh[]} */
  get meshes() {
    return /** @type {Mesh[]} */ (this.children);
  }

  /**
   * Show the interpolation of two frames of `controls`.
   *
   * @param {Message} earlier
   * @param {Message} later
   * @param {number} share 0 for the earlier frame, 1 for the later one
   */
  show(earlier, later, share) {
    const first = this.#frames[1] === earlier || (this.#frames[0] === later && earlier !== later) ? 1 : 0;
    const isNew = [this.#upload(first, earlier), this.#upload(1 - first, later)].some(Boolean);
    this.uniforms.puppetShare.value = first === 0 ? share : 1 - share;
    const shift = this.uniforms.puppetShift.value;
    if (!this.#followRoot) {
      shift.fromArray(earlier.header.root).lerp(new Vector3(...later.header.root), share).negate();
    }
    if (isNew) {
      const [box, other] = this.#controls.map((controls) => this.#bounds.around(controls));
      box.union(other).translate(shift).getBoundingSphere(this.#sphere);
    }
    this.visible = true;
  }

  /**
   * Compute what is shown without the graphics card: positions and normals of the scene's vertices, in the coordinates of
   * this object. It takes milliseconds and is meant for tools.
   */
  evaluate() {
    const [first, second] = this.#controls;
    const share = this.uniforms.puppetShare.value;
    const evaluated = evaluate(
      this.scene,
      first.map((value, i) => value + share * (second[i] - value)),
    );
    const shift = this.uniforms.puppetShift.value.toArray();
    for (let i = 0; i < evaluated.positions.length; i++) evaluated.positions[i] += shift[i % 3];
    return evaluated;
  }

  /** Free what the graphics card holds. */
  dispose() {
    for (const texture of this.#textures) texture.dispose();
    for (const mesh of this.meshes) {
      mesh.geometry.dispose();
      for (const material of [mesh.material, mesh.customDepthMaterial, mesh.customDistanceMaterial].flat()) {
        material?.dispose();
      }
    }
  }

  /** @param {Mesh} mesh */
  #add(mesh) {
    const own = [mesh.material].flat().map((material) => deform(material, this.uniforms));
    mesh.material = own.length === 1 ? own[0] : own;
    mesh.customDepthMaterial = deform(new MeshDepthMaterial({ depthPacking: RGBADepthPacking }), this.uniforms);
    mesh.customDistanceMaterial = deform(new MeshDistanceMaterial(), this.uniforms);
    mesh.geometry.boundingSphere = this.#sphere; // of the pose, not of the rest pose
    this.add(mesh);
  }

  /**
   * Upload a frame; return false if it is already there.
   *
   * @param {number} i
   * @param {Message} frame
   */
  #upload(i, frame) {
    if (this.#frames[i] === frame || frame.kind !== "controls") return false;
    if (frame.body.length !== this.#controls[i].length) return false;
    this.#frames[i] = frame;
    this.#controls[i].set(frame.body);
    this.#textures[i].needsUpdate = true;
    return true;
  }
}

/**
 * A character of a service. Add it to a scene, and call `update` before each image.
 *
 * `mesh` is null until the character has arrived, and replaced when it is reloaded. The event `rebuilt` follows.
 *
 * @extends {Group<Object3DEventMap & {rebuilt: {}}>}
 */
export class Puppet extends Group {
  #options;
  #buffer;
  /** Stays until the new mesh shows a pose. @type {PuppetMesh | null} */
  #previous = null;

  /**
   * @param {Client} client
   * @param {string} name of the character
   * @param {{delay?: number, source?: () => Object3D, followRoot?: boolean}} [options] `delay` is the time by which the
   * shown pose lags behind the received frames, in seconds; `source` makes an object as described at `PuppetMesh`
   */
  constructor(client, name, options = {}) {
    super();
    this.#options = options;
    this.#buffer = new JitterBuffer(options.delay);
    /** @type {PuppetMesh | null} */
    this.mesh = null;
    this.character = new Character(client, name);
    this.character.addEventListener("scene", () => this.#rebuild());
    this.character.addEventListener("frame", () => {
      if (this.character.frame) this.#buffer.push(this.character.frame, seconds());
    });
  }

  /** Show the pose of this moment. */
  update() {
    const { earlier, later } = this.#buffer.advance(seconds()) ? this.#buffer : { earlier: null, later: null };
    if (!this.mesh || !earlier || !later) return;
    this.mesh.show(earlier, later, this.#buffer.share);
    this.#discard(this.#previous);
    this.#previous = null;
  }

  /** Stop following the character, and free what the graphics card holds. */
  dispose() {
    this.character.close();
    this.#discard(this.mesh);
    this.#discard(this.#previous);
    this.mesh = this.#previous = null;
  }

  #rebuild() {
    if (!this.character.scene) return;
    if (this.mesh?.visible) this.#previous = this.mesh;
    else this.#discard(this.mesh);
    const { delay, source, followRoot } = this.#options;
    this.#buffer = new JitterBuffer(delay);
    this.mesh = new PuppetMesh(this.character.scene, { source: source?.(), followRoot });
    this.add(this.mesh);
    this.dispatchEvent({ type: "rebuilt" });
  }

  /** @param {PuppetMesh | null} mesh */
  #discard(mesh) {
    if (!mesh) return;
    this.remove(mesh);
    mesh.dispose();
  }
}

function seconds() {
  return performance.now() / 1000;
}

/**
 * Return a mesh for each part of a scene that has triangles.
 *
 * @param {Scene} scene
 */
function partsOf(scene) {
  const attributes = attributesOf(scene, null);
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
 */
function meshesOf(source, scene) {
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
    for (const [name, attribute] of Object.entries(attributesOf(scene, order))) {
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
 * @param {Uint32Array | null} order number of each vertex; null for all in their order
 * @returns {{[name: string]: BufferAttribute | InterleavedBufferAttribute}}
 */
function attributesOf(scene, order) {
  const { fields } = scene;
  const coordinates = new InterleavedBuffer(picked(scene.coordinates, fields, MAX_FIELDS, order), MAX_FIELDS);
  const slopes = new InterleavedBuffer(picked(scene.slopes, 2 * fields, 2 * MAX_FIELDS, order), 2 * MAX_FIELDS);
  return {
    position: new BufferAttribute(picked(scene.positions, 3, 3, order), 3),
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
