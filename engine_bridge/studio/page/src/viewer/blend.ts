/** How single vertices of a character move, for bones that follow the surface around them. */

import type { Vector } from "../model/vector";

/** The data of a scene that is needed to apply a frame's controls (docs/protocol.md). */
export interface Shape {
  readonly count: number;
  readonly fields: number;
  readonly isolines: number;
  readonly weights: ArrayLike<number>;
  readonly positions: ArrayLike<number>;
  readonly coordinates: ArrayLike<number>;
}

/** The affine transform (3 × 4, row by row) that controls give a vertex. */
export function transformOf(shape: Shape, controls: Float32Array, vertex: number, into = new Float64Array(12)): Float64Array {
  const { fields, isolines, weights, coordinates } = shape;
  into.fill(0);
  for (let i = 0; i < fields; i++) {
    const t = coordinates[vertex * fields + i] ?? 0;
    const k = Math.min(Math.floor(t), isolines - 2);
    const share = t - k;
    const weight = weights[i] ?? 0;
    const at = 12 * (i * isolines + k);
    for (let j = 0; j < 12; j++) {
      into[j] = (into[j] ?? 0) + weight * ((1 - share) * (controls[at + j] ?? 0) + share * (controls[at + 12 + j] ?? 0));
    }
  }
  return into;
}

export function apply(transform: ArrayLike<number>, [x, y, z]: Vector): Vector {
  const row = (r: number): number =>
    (transform[r] ?? 0) * x + (transform[r + 1] ?? 0) * y + (transform[r + 2] ?? 0) * z + (transform[r + 3] ?? 0);
  return [row(0), row(4), row(8)];
}

/** The vertices around a point of the rest pose, whose mean motion moves it. */
export function nearest(shape: Shape, point: Vector, count = 12): number[] {
  const found: { vertex: number; square: number }[] = [];
  let limit = Infinity;
  const { positions } = shape;
  for (let v = 0; v < shape.count; v++) {
    const x = (positions[3 * v] ?? 0) - point[0];
    const y = (positions[3 * v + 1] ?? 0) - point[1];
    const z = (positions[3 * v + 2] ?? 0) - point[2];
    const square = x * x + y * y + z * z;
    if (square >= limit) continue;
    const place = found.findIndex((other) => square < other.square);
    found.splice(place < 0 ? found.length : place, 0, { vertex: v, square });
    if (found.length > count) found.pop();
    if (found.length === count) limit = found.at(-1)?.square ?? Infinity;
  }
  return found.map(({ vertex }) => vertex);
}

/** Move a point of the rest pose as the surface around it moves. */
export function carried(shape: Shape, controls: Float32Array, vertices: readonly number[], point: Vector): Vector {
  if (vertices.length === 0) return point;
  const sum = new Float64Array(12);
  for (const vertex of vertices) {
    const transform = transformOf(shape, controls, vertex);
    for (let j = 0; j < 12; j++) sum[j] = (sum[j] ?? 0) + (transform[j] ?? 0) / vertices.length;
  }
  return apply(sum, point);
}
