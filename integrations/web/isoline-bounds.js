// The bounding box of a character that the graphics card deforms. Its cost does not depend on the number of vertices.
//
// Vertices with similar isoline coordinates form a piece. The weighted mean of the transforms at the middle of a piece
// approximates the positions of its vertices, and the change of the transforms over its coordinates bounds the error.

import { Box3, Vector3 } from "three";
import { TRANSFORM } from "./evaluation.js";
import { reachOf } from "./targets.js";

/** @import {Scene} from "./message.js" */

/** Maximum number of pieces. */
const MAX_PIECES = 48;

/** Minimum spread of isoline coordinates, in isolines; smaller ones count as zero. */
const MIN_SPREAD = 1e-6;

/**
 * @typedef {object} Piece
 * @property {number[]} center
 * @property {number[]} half
 * @property {{number: number, share: number}[]} transforms whose weighted mean belongs to the middle of the piece
 * @property {{number: number, below: number, above: number}[][]} gaps between isolines that have coordinates of the piece,
 * by field: the number of the lower transform, and the weighted spread of the coordinates below and above the middle
 */

export class IsolineBounds {
  /** @param {Scene} scene */
  constructor(scene) {
    this.pieces = divided(scene).map((vertices) => pieceOf(scene, vertices));
  }

  /**
   * Return a box that contains all vertices.
   *
   * @param {Float32Array} controls
   */
  around(controls) {
    const box = new Box3();
    const low = new Vector3();
    const high = new Vector3();
    for (const piece of this.pieces) {
      for (let row = 0; row < 3; row++) {
        const [middle, reach] = extent(piece, controls, row);
        low.setComponent(row, middle - reach);
        high.setComponent(row, middle + reach);
      }
      box.expandByPoint(low).expandByPoint(high);
    }
    return box;
  }
}

/**
 * Return the middle of a piece along an axis, and the greatest distance of a vertex from it.
 *
 * @param {Piece} piece
 * @param {Float32Array} controls
 * @param {number} row
 */
function extent({ center, half, transforms, gaps }, controls, row) {
  const mean = [0, 0, 0, 0];
  for (const { number, share } of transforms) {
    for (let column = 0; column < 4; column++) mean[column] += share * controls[TRANSFORM * number + 4 * row + column];
  }
  let middle = mean[3];
  let reach = 0;
  for (let column = 0; column < 3; column++) {
    middle += mean[column] * center[column];
    reach += Math.abs(mean[column]) * half[column];
  }
  for (const field of gaps) {
    let below = 0;
    let above = 0;
    for (const gap of field) {
      const at = TRANSFORM * gap.number + 4 * row;
      let moved = controls[at + TRANSFORM + 3] - controls[at + 3];
      let change = 0;
      for (let column = 0; column < 3; column++) {
        const rise = controls[at + TRANSFORM + column] - controls[at + column];
        moved += rise * center[column];
        change += Math.abs(rise) * half[column];
      }
      change += Math.abs(moved);
      below += gap.below * change;
      above += gap.above * change;
    }
    reach += Math.max(below, above);
  }
  return [middle, reach];
}

/**
 * Repeatedly cut the piece with the greatest weighted spread of coordinates at its middle.
 *
 * @param {Scene} scene
 * @returns {Uint32Array[]} vertices of each piece
 */
function divided(scene) {
  const all = Uint32Array.from({ length: scene.count }, (_, vertex) => vertex);
  const pieces = [{ vertices: all, cut: bestCut(scene, all) }];
  while (pieces.length < MAX_PIECES) {
    const widest = pieces.reduce((most, each) => (each.cut.spread > most.cut.spread ? each : most));
    const { field, coordinate, spread } = widest.cut;
    if (spread <= MIN_SPREAD) break;
    const isBeyond = (/** @type {number} */ vertex) => scene.coordinates[vertex * scene.fields + field] > coordinate;
    pieces.splice(pieces.indexOf(widest), 1);
    for (const side of [true, false]) {
      const vertices = widest.vertices.filter((vertex) => isBeyond(vertex) === side);
      pieces.push({ vertices, cut: bestCut(scene, vertices) });
    }
  }
  return pieces.map(({ vertices }) => vertices);
}

/**
 * @param {Scene} scene
 * @param {Uint32Array} vertices
 */
function bestCut(scene, vertices) {
  let best = { field: 0, coordinate: 0, spread: 0 };
  for (let field = 0; field < scene.fields; field++) {
    const [low, high] = range(scene, vertices, field);
    const spread = (high - low) * scene.weights[field];
    if (spread > best.spread) best = { field, coordinate: (low + high) / 2, spread };
  }
  return best;
}

/**
 * @param {Scene} scene
 * @param {Uint32Array} vertices
 * @param {number} field
 */
function range(scene, vertices, field) {
  let low = Infinity;
  let high = -Infinity;
  for (const vertex of vertices) {
    const coordinate = scene.coordinates[vertex * scene.fields + field];
    low = Math.min(low, coordinate);
    high = Math.max(high, coordinate);
  }
  return [low, high];
}

/**
 * @param {Scene} scene
 * @param {Uint32Array} vertices
 * @returns {Piece}
 */
function pieceOf(scene, vertices) {
  const box = new Box3();
  for (const vertex of vertices) {
    for (const point of reachOf(scene, vertex)) box.expandByPoint(point);
  }
  /** @type {Piece} */
  const piece = { center: box.getCenter(new Vector3()).toArray(), half: [], transforms: [], gaps: [] };
  piece.half = box.getSize(new Vector3()).divideScalar(2).toArray();
  for (let field = 0; field < scene.fields; field++) {
    const first = field * scene.isolines;
    const weight = scene.weights[field];
    const [low, high] = range(scene, vertices, field);
    const middle = (low + high) / 2;
    const lower = Math.min(Math.floor(middle), scene.isolines - 2);
    piece.transforms.push({ number: first + lower, share: weight * (lower + 1 - middle) });
    piece.transforms.push({ number: first + lower + 1, share: weight * (middle - lower) });
    const gaps = [];
    for (let gap = 0; gap < scene.isolines - 1; gap++) {
      const below = Math.min(gap + 1, middle) - Math.max(gap, low);
      const above = Math.min(gap + 1, high) - Math.max(gap, middle);
      if (Math.max(below, above) > MIN_SPREAD) {
        gaps.push({ number: first + gap, below: weight * Math.max(below, 0), above: weight * Math.max(above, 0) });
      }
    }
    if (gaps.length) piece.gaps.push(gaps);
  }
  return piece;
}
