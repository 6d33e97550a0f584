// The mesh's own morph targets, such as a mouth that opens (docs/protocol.md, Targets).

import { Mesh, Vector3 } from "three";

/** @import {BufferAttribute, Object3D} from "three" */
/** @import {Scene} from "./message.js" */

/**
 * Return the interpolation of two arrays of the same length; the first one if they differ in length.
 *
 * @param {Float32Array} earlier
 * @param {Float32Array} later
 * @param {number} share
 */
export function between(earlier, later, share) {
  if (earlier.length !== later.length) return earlier;
  return earlier.map((value, i) => value + share * (later[i] - value));
}

/**
 * Return two corners of a box in which a vertex of the rest pose is, whatever the weights of the targets.
 *
 * @param {Scene} scene
 * @param {number} vertex
 */
export function reachOf({ positions, displacements }, vertex) {
  const [low, high, moved] = [new Vector3().fromArray(positions, 3 * vertex), new Vector3(), new Vector3()];
  high.copy(low);
  const none = new Vector3();
  for (let at = 3 * vertex; at < displacements.length; at += positions.length) {
    low.add(moved.fromArray(displacements, at).min(none));
    high.add(moved.fromArray(displacements, at).max(none));
  }
  return [low, high];
}

/** The rest pose of a character's meshes, which targets move before controls do. The cost is that of the moved vertices. */
export class RestPose {
  #scene;
  /** Vertices that some target moves. @type {number[]} */
  #moved = [];
  /** Weights of `positions`. @type {Float32Array} */
  #weights = new Float32Array();
  /** Attributes of meshes with the rows of moved vertices, as pairs of row and vertex. @type {[BufferAttribute, number[]][]} */
  #attributes = [];

  /** @param {Scene} scene */
  constructor(scene) {
    const { positions, displacements } = scene;
    this.#scene = scene;
    /** Three numbers per vertex of the scene. */
    this.positions = displacements.length ? positions.slice() : positions;
    const isMoved = new Set();
    displacements.forEach((value, i) => value && isMoved.add(Math.floor((i % positions.length) / 3)));
    this.#moved = [...isMoved];
  }

  /**
   * Keep an attribute of positions equal to the rest pose.
   *
   * @param {BufferAttribute} attribute
   * @param {Uint32Array | null} order number of each vertex; null if the attribute has the array `positions`
   */
  follow(attribute, order) {
    const isMoved = new Set(this.#moved);
    /** @type {number[]} */
    const rows = [];
    order?.forEach((vertex, row) => isMoved.has(vertex) && rows.push(row, vertex));
    this.#attributes.push([attribute, rows]);
    return attribute;
  }

  /**
   * Move the rest pose.
   *
   * @param {Float32Array} weights of the targets; missing ones are 0
   */
  move(weights) {
    const before = this.#weights;
    const isSame = weights.length === before.length && weights.every((value, i) => value === before[i]);
    if (isSame || !this.#moved.length) return;
    this.#weights = weights;
    const { positions, displacements } = this.#scene;
    for (const vertex of this.#moved) {
      for (let i = 3 * vertex; i < 3 * vertex + 3; i++) {
        this.positions[i] = positions[i];
        for (let k = 0; k < weights.length; k++) {
          this.positions[i] += weights[k] * (displacements[k * positions.length + i] ?? 0);
        }
      }
    }
    for (const [attribute, rows] of this.#attributes) {
      for (let i = 0; i < rows.length; i += 2) {
        attribute.array.set(this.positions.subarray(3 * rows[i + 1], 3 * rows[i + 1] + 3), 3 * rows[i]);
      }
      attribute.needsUpdate = true;
    }
  }
}

/** Sets the influences of morph targets of any model by their names. */
export class TargetInfluences {
  /** @type {{influences: number[], number: number, name: string, rest: number}[]} */
  #targets = [];

  /** @param {Object3D} model at rest */
  constructor(model) {
    model.traverse((each) => {
      if (!(each instanceof Mesh) || !each.morphTargetInfluences) return;
      const influences = each.morphTargetInfluences;
      for (const [name, number] of Object.entries(each.morphTargetDictionary ?? {})) {
        this.#targets.push({ influences, number, name, rest: influences[number] });
      }
    });
  }

  /**
   * Show weights: 0 is the target's influence at rest, 1 is the whole target.
   *
   * @param {string[]} names of the targets; other targets of the model are left as they are
   * @param {Float32Array} weights
   */
  show(names, weights) {
    for (const { influences, number, name, rest } of this.#targets) {
      const weight = weights[names.indexOf(name)];
      if (weight !== undefined) influences[number] = rest + (1 - rest) * weight;
    }
  }
}
