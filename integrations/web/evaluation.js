// The positions and normals that controls give a character, computed without a graphics card (docs/protocol.md, Controls).

/** @import {Scene} from "./message.js" */

/** Number of numbers in a transform: three rows of four. */
export const TRANSFORM = 12;

/**
 * Compute positions and unit normals of all vertices, in file coordinates.
 *
 * @param {Scene} scene
 * @param {Float32Array} controls
 * @param {Float32Array} [positions] of the rest pose, if the mesh's own morph targets move it
 */
export function evaluate(scene, controls, positions = scene.positions) {
  const { count, normals } = scene;
  const out = { positions: new Float32Array(3 * count), normals: new Float32Array(3 * count) };
  const x = [0, 0, 0, 1];
  const n = [0, 0, 0];
  const moved = new Float64Array(9); // position, and the two moved tangents
  for (let vertex = 0; vertex < count; vertex++) {
    for (let axis = 0; axis < 3; axis++) {
      x[axis] = positions[3 * vertex + axis];
      n[axis] = normals[3 * vertex + axis];
    }
    const a = firstTangent(n);
    move(scene, controls, vertex, x, a, cross(n, a), moved);
    const normal = normalised(cross(moved.subarray(3, 6), moved.subarray(6, 9)));
    out.positions.set(moved.subarray(0, 3), 3 * vertex);
    out.normals.set(normal, 3 * vertex);
  }
  return out;
}

/**
 * @param {Scene} scene
 * @param {Float32Array} controls
 * @param {number} vertex
 * @param {number[]} x rest position and 1
 * @param {number[]} a first tangent
 * @param {number[]} b second tangent
 * @param {Float64Array} moved
 */
function move(scene, controls, vertex, x, a, b, moved) {
  const { fields, isolines, weights, coordinates, slopes } = scene;
  moved.fill(0);
  for (let field = 0; field < fields; field++) {
    const entry = vertex * fields + field;
    const coordinate = coordinates[entry];
    const isoline = Math.min(Math.max(Math.floor(coordinate), 0), isolines - 2);
    const share = coordinate - isoline;
    const lower = TRANSFORM * (field * isolines + isoline);
    const weight = weights[field];
    for (let row = 0; row < 3; row++) {
      let position = 0;
      let step = 0;
      let alongA = 0;
      let alongB = 0;
      for (let column = 0; column < 4; column++) {
        const at = lower + 4 * row + column;
        const rise = controls[at + TRANSFORM] - controls[at];
        const blend = controls[at] + share * rise;
        position += blend * x[column];
        step += rise * x[column];
        if (column < 3) {
          alongA += blend * a[column];
          alongB += blend * b[column];
        }
      }
      moved[row] += weight * position;
      moved[3 + row] += weight * (alongA + slopes[2 * entry] * step);
      moved[6 + row] += weight * (alongB + slopes[2 * entry + 1] * step);
    }
  }
}

/**
 * Return the tangent along which the first slopes are defined.
 *
 * @param {number[]} n unit normal, or zero
 */
function firstTangent(n) {
  const [x, y, z] = n.map(Math.abs);
  const axis = x <= y && x <= z ? [1, 0, 0] : y <= z ? [0, 1, 0] : [0, 0, 1];
  return normalised(cross(axis, n));
}

/**
 * @param {ArrayLike<number>} u
 * @param {ArrayLike<number>} v
 */
function cross(u, v) {
  return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
}

/** @param {number[]} v */
function normalised(v) {
  const length = Math.hypot(v[0], v[1], v[2]);
  return length > 0 ? v.map((each) => each / length) : v;
}
