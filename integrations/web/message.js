// Messages of Puppetline's wire protocol, version 1 (docs/protocol.md): decoded without copies, and checked.

/** @typedef {"scene" | "controls" | "morphs" | "vertices" | "vertices16" | "joints" | "handles" | "performer" | "status" | "characters" | "bones" | "channels"} Kind */

/**
 * @typedef {object} Header
 * @property {number} major
 * @property {number} minor
 * @property {number} kind number of the kind
 * @property {number} state index in `STATES`
 * @property {number} user user number of the performer; −1 for no performer
 * @property {number} revision revision of the scene that the frame belongs to
 * @property {number} length size of the payload in bytes
 * @property {number} sequence number of the frame
 * @property {number} time seconds on the source's clock
 * @property {bigint} received nanoseconds on the service's clock: arrival of the data
 * @property {bigint} published nanoseconds on the service's clock: encoding of the message
 * @property {[number, number, number]} root displacement of the whole character, in file coordinates
 * @property {number} targets number of weights of the mesh's own morph targets after the payload
 */

/** @typedef {{weights: Float32Array, residual: number}} Morphs */
/** @typedef {{positions: Float32Array, normals: Float32Array}} Vertices three numbers per vertex each */
/** @typedef {{[key: string]: any}} Json */

/**
 * @typedef {object} Part a primitive of the character's file
 * @property {string} name
 * @property {[number, number]} vertices first index and count
 * @property {[number, number]} triangles first index and count
 * @property {{name: string, base_color: number[], metallic: number, roughness: number, emissive: number[], alpha_mode: string, double_sided: boolean}} material
 */

/**
 * @typedef {object} Bone a joint at rest, relative to its parent
 * @property {string} name
 * @property {number} parent −1 for none
 * @property {number[]} position
 * @property {number[]} rotation unit quaternion x, y, z, w
 * @property {boolean} travels whether frames have its position
 * @property {number[] | null} from_t_pose rotation from the T-pose to rest
 */

/**
 * @typedef {object} Description what a scene says about its character; later versions may add keys
 * @property {string} character
 * @property {number} revision
 * @property {number} vertices
 * @property {number} triangles
 * @property {number} fields
 * @property {number} isolines
 * @property {number[]} weights weights of the fields
 * @property {number} diagonal
 * @property {[number[], number[]]} bounds
 * @property {string} up
 * @property {string} front
 * @property {number} [turn] degrees by which the character is turned from `front` to its left
 * @property {number} metres_a_unit
 * @property {{name: string, position: number[], joints: string[]}[]} handles
 * @property {Bone[] | null} [bones] the character's own joints, parents first
 * @property {string[]} joints
 * @property {string[] | null} morphs
 * @property {string[]} [targets] the mesh's own morph targets whose weights frames have
 * @property {Part[]} parts
 */

/**
 * A decoded message. `kind` is null, and so is the body, for a kind that a later version has added.
 *
 * `targets` are the weights of the mesh's own morph targets, in the order of the scene's `targets`; empty without any.
 *
 * @typedef {{topic: string, header: Header, targets: Float32Array} & (
 *   | {kind: "scene", body: Scene}
 *   | {kind: "controls" | "joints" | "handles" | "bones", body: Float32Array}
 *   | {kind: "morphs", body: Morphs}
 *   | {kind: "vertices" | "vertices16", body: Vertices}
 *   | {kind: "channels", body: {[name: string]: number}}
 *   | {kind: "performer" | "status", body: Json}
 *   | {kind: "characters", body: {name: string, revision: number, vertices: number, kinds: Kind[]}[]}
 *   | {kind: null, body: null}
 * )} Message
 */

/** Version of the protocol that this module reads. */
export const MAJOR = 1;

/** Names of the kinds by their numbers. @type {readonly (Kind | null)[]} */
export const KINDS = [
  null, "scene", "controls", "morphs", "vertices", "vertices16", "joints", "handles", "performer", "status", "characters",
  null, "bones", "channels",
];

/** Kinds that are sent for every frame. @type {ReadonlySet<Kind | null>} */
export const FRAME_KINDS = new Set(["controls", "morphs", "vertices", "vertices16", "joints", "handles", "bones", "channels"]);

/** States of a character by their numbers. */
export const STATES = /** @type {const} */ (["waiting", "calibrating", "performing", "leaving"]);

/** Number of joints of a performer. */
export const JOINT_COUNT = 20;

/** Arrays that only some scenes have. */
const OPTIONAL = new Set(["uv", "colors", "displacements"]);

const TOPIC_BYTES = 64;
const PAYLOAD_OFFSET = 128;
const TOPIC = /^[\x20-\x7e]{1,63}$/;

/** Bytes that are no message of this protocol. */
export class WireError extends Error {}

/** The constant part of a character, with which its controls become positions and normals. */
export class Scene {
  /**
   * @param {Description} description
   * @param {{[name: string]: Float32Array | Uint32Array}} arrays
   */
  constructor(description, arrays) {
    this.description = description;
    /** Number of vertices. */
    this.count = description.vertices;
    this.fields = description.fields;
    this.isolines = description.isolines;
    this.weights = Float32Array.from(description.weights);
    this.triangles = /** @type {Uint32Array} */ (arrays.triangles);
    /** Rest pose, three numbers per vertex. */
    this.positions = /** @type {Float32Array} */ (arrays.positions);
    this.normals = /** @type {Float32Array} */ (arrays.normals);
    /** Isoline coordinates, one number per vertex and field. */
    this.coordinates = /** @type {Float32Array} */ (arrays.ladder);
    /** Their derivatives along two tangents, two numbers per vertex and field. */
    this.slopes = /** @type {Float32Array} */ (arrays.slopes);
    this.uv = /** @type {Float32Array | null} */ (arrays.uv ?? null);
    /** Linear RGB, three numbers per vertex. */
    this.colors = /** @type {Float32Array | null} */ (arrays.colors ?? null);
    /** Displacements of the rest pose by the mesh's own morph targets, target by target; empty without any. */
    this.displacements = /** @type {Float32Array} */ (arrays.displacements ?? new Float32Array());
  }
}

/**
 * Decode a whole message. Arrays are views of its bytes.
 *
 * @param {ArrayBuffer | ArrayBufferView} message
 * @returns {Message}
 * @throws {WireError} bytes that do not follow the protocol; reading them takes no more memory than they have
 */
export function decode(message) {
  const bytes = aligned(message);
  if (bytes.length < PAYLOAD_OFFSET) fail(`${bytes.length} bytes, and a message has at least ${PAYLOAD_OFFSET}`);
  const topic = readTopic(bytes.subarray(0, TOPIC_BYTES));
  const header = readHeader(new DataView(bytes.buffer, bytes.byteOffset + TOPIC_BYTES, TOPIC_BYTES));
  if (header.major !== MAJOR) fail(`protocol version ${header.major}.${header.minor}, and this is version ${MAJOR}`);
  if (header.state >= STATES.length) fail(`state ${header.state} of ${STATES.length}`);
  const end = PAYLOAD_OFFSET + header.length;
  const payload = bytes.subarray(PAYLOAD_OFFSET, end);
  if (payload.length < header.length) fail(`${payload.length} bytes of payload of ${header.length} announced`);
  const weights = bytes.slice(end, end + 4 * header.targets);
  if (weights.length < 4 * header.targets) fail(`${weights.length} bytes for ${header.targets} weights of morph targets`);
  const targets = new Float32Array(weights.buffer);
  const kind = KINDS[header.kind] ?? null;
  if (kind !== null && topic.split("/")[1] !== kind) fail(`${kind} under the topic ${topic}`);
  return /** @type {Message} */ ({ topic, header, targets, kind, body: kind === null ? null : BODIES[kind](payload) });
}

/** @type {Record<Kind, (payload: Uint8Array) => unknown>} */
const BODIES = {
  scene: readScene,
  controls: (payload) => floats(payload, 12),
  morphs: (payload) => {
    const values = floats(payload, 1);
    if (!values.length) fail("morphs without a residual");
    return { weights: values.subarray(1), residual: values[0] };
  },
  vertices: (payload) => {
    const values = floats(payload, 6);
    return { positions: values.subarray(0, values.length / 2), normals: values.subarray(values.length / 2) };
  },
  vertices16: readVertices16,
  joints: (payload) => {
    if (payload.length !== 16 * JOINT_COUNT) fail(`${payload.length} bytes, which are not ${JOINT_COUNT} joints`);
    return floats(payload, 4);
  },
  handles: (payload) => floats(payload, 3),
  bones: (payload) => floats(payload, 1),
  channels: readJson,
  performer: readJson,
  status: readJson,
  characters: readJson,
};

/**
 * @param {string} reason
 * @returns {never}
 */
function fail(reason) {
  throw new WireError(reason);
}

/**
 * Return bytes at a position where its numbers can be read without a copy.
 *
 * @param {ArrayBuffer | ArrayBufferView} message
 */
function aligned(message) {
  const bytes = ArrayBuffer.isView(message)
    ? new Uint8Array(message.buffer, message.byteOffset, message.byteLength)
    : new Uint8Array(message);
  return bytes.byteOffset % 4 ? bytes.slice() : bytes;
}

/** @param {Uint8Array} field */
function readTopic(field) {
  const end = field.indexOf(0);
  const text = String.fromCharCode(...field.subarray(0, end < 0 ? field.length : end));
  if (end < 0 || !TOPIC.test(text) || field.subarray(end).some(Boolean)) fail("a topic field that holds no topic");
  return text;
}

/**
 * @param {DataView} view
 * @returns {Header}
 */
function readHeader(view) {
  return {
    major: view.getUint8(0),
    minor: view.getUint8(1),
    kind: view.getUint8(2),
    state: view.getUint8(3),
    user: view.getInt32(4, true),
    revision: view.getUint32(8, true),
    length: view.getUint32(12, true),
    sequence: Number(view.getBigUint64(16, true)),
    time: view.getFloat64(24, true),
    received: view.getBigUint64(32, true),
    published: view.getBigUint64(40, true),
    root: [view.getFloat32(48, true), view.getFloat32(52, true), view.getFloat32(56, true)],
    targets: view.getUint32(60, true),
  };
}

/**
 * Return a payload as numbers, in rows of so many. Every processor that runs browsers is little-endian, as the protocol.
 *
 * @param {Uint8Array} payload
 * @param {number} row
 */
function floats(payload, row) {
  if (payload.length % (4 * row)) fail(`${payload.length} bytes, which are not rows of ${row} numbers`);
  return new Float32Array(payload.buffer, payload.byteOffset, payload.length / 4);
}

/** @param {Uint8Array} payload */
function readJson(payload) {
  try {
    return JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(payload));
  } catch {
    return fail("a payload that is not JSON");
  }
}

/**
 * @param {Uint8Array} payload
 * @returns {Vertices}
 */
function readVertices16(payload) {
  const count = Math.floor((payload.length - 24) / 10);
  const places = 24 + Math.ceil((6 * count) / 4) * 4;
  if (count < 0 || payload.length !== places + 4 * count) {
    fail(`${payload.length} bytes, which are not a box and vertices of 10`);
  }
  const box = floats(payload.subarray(0, 24), 3);
  if (!box.every(Number.isFinite)) fail("a box without bounds");
  const steps = new Uint16Array(payload.buffer, payload.byteOffset + 24, 3 * count);
  const folded = new Int16Array(payload.buffer, payload.byteOffset + places, 2 * count);
  const size = Float32Array.from([0, 1, 2], (axis) => Math.fround(box[3 + axis] - box[axis]) / 65535);
  const positions = new Float32Array(3 * count);
  for (let i = 0; i < positions.length; i++) positions[i] = box[i % 3] + Math.fround(steps[i] * size[i % 3]);
  const normals = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) unfold(folded[2 * i], folded[2 * i + 1], normals, 3 * i);
  return { positions, normals };
}

/**
 * @param {number} i
 * @param {number} j
 * @param {Float32Array} normals
 * @param {number} at
 */
function unfold(i, j, normals, at) {
  const u = Math.max(i / 32767, -1);
  const v = Math.max(j / 32767, -1);
  const z = 1 - Math.abs(u) - Math.abs(v);
  const beyond = Math.max(-z, 0);
  const x = u - (u < 0 ? -beyond : beyond);
  const y = v - (v < 0 ? -beyond : beyond);
  const length = Math.hypot(x, y, z);
  normals[at] = x / length;
  normals[at + 1] = y / length;
  normals[at + 2] = z / length;
}

/**
 * @param {Uint8Array} payload
 * @returns {Scene}
 */
function readScene(payload) {
  if (payload.length < 4) fail("a scene without a description");
  const start = 4 + new DataView(payload.buffer, payload.byteOffset).getUint32(0, true);
  if (start > payload.length) fail(`a description of ${start - 4} bytes in a scene of ${payload.length}`);
  const description = readJson(payload.subarray(4, start));
  if (!isObject(description) || !isObject(description.arrays)) fail("a scene that does not say what arrays it has");
  /** @type {{[name: string]: Float32Array | Uint32Array}} */
  const arrays = {};
  const data = payload.subarray(start);
  for (const [name, entry] of Object.entries(description.arrays)) arrays[name] = readArray(data, entry, name);
  checkScene(description, arrays);
  return new Scene(/** @type {Description} */ (/** @type {unknown} */ (description)), arrays);
}

/**
 * @param {unknown} value
 * @returns {value is {[key: string]: any}}
 */
function isObject(value) {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

/**
 * @param {Uint8Array} data
 * @param {any} entry
 * @param {string} name
 */
function readArray(data, entry, name) {
  const shape = isObject(entry) && Array.isArray(entry.shape) ? entry.shape : [];
  const isCount = (/** @type {unknown} */ size) => Number.isInteger(size) && Number(size) > 0;
  if (shape.length < 1 || shape.length > 3 || !shape.every(isCount)) fail(`an array ${name} without a shape`);
  const count = shape.reduce((product, size) => product * size, 1);
  const { offset, type } = entry;
  if (!Number.isInteger(offset) || offset < 0 || offset % 4 || offset + 4 * count > data.length) {
    fail(`an array ${name} that goes beyond the scene`);
  }
  if (type !== "f32" && type !== "u32") fail(`an array ${name} of type ${type}`);
  const bytes = aligned(data.subarray(offset, offset + 4 * count));
  return new (type === "f32" ? Float32Array : Uint32Array)(
    /** @type {ArrayBuffer} */ (bytes.buffer), bytes.byteOffset, count,
  );
}

/**
 * Refuse numbers that would make a client read beyond an array.
 *
 * @param {{[key: string]: any}} description
 * @param {{[name: string]: Float32Array | Uint32Array}} arrays
 */
function checkScene(description, arrays) {
  const { vertices, triangles, fields, isolines, weights, targets } = description;
  for (const name of ["vertices", "triangles", "fields", "isolines"]) {
    if (!Number.isInteger(description[name]) || description[name] < 1) fail(`a scene without ${name}`);
  }
  if (!Array.isArray(weights) || weights.length !== fields || !weights.every(Number.isFinite)) {
    fail(`a scene whose ${fields} fields have no weights`);
  }
  const sizes = {
    triangles: 3 * triangles,
    positions: 3 * vertices,
    normals: 3 * vertices,
    ladder: fields * vertices,
    slopes: 2 * fields * vertices,
    uv: 2 * vertices,
    colors: 3 * vertices,
    displacements: 3 * vertices * (Array.isArray(targets) ? targets.length : 0),
  };
  for (const [name, size] of Object.entries(sizes)) {
    const array = arrays[name];
    if (array === undefined && OPTIONAL.has(name)) continue;
    if (array?.length !== size || array instanceof Uint32Array !== (name === "triangles")) {
      fail(`a scene whose ${name} are not there or do not fit the rest`);
    }
  }
  if (!arrays.triangles.every((vertex) => vertex < vertices)) fail("a triangle of a vertex that is not there");
  if (!arrays.ladder.every((coordinate) => coordinate >= 0 && coordinate <= isolines - 1)) {
    fail("an isoline coordinate beyond the isolines");
  }
}
