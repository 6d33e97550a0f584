/** Vectors of three numbers, and the geometry of picking and dragging. */

export type Vector = readonly [number, number, number];

export const add = (a: Vector, b: Vector): Vector => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Vector, s: number): Vector => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const length = (a: Vector): number => Math.sqrt(dot(a, a));
export const cross = (a: Vector, b: Vector): Vector => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const middle = (a: Vector, b: Vector): Vector => scale(add(a, b), 0.5);

export interface Ray {
  readonly origin: Vector;
  /** Of any length. */
  readonly direction: Vector;
}

/** Where a ray meets the plane through a point with a normal; null if it is parallel to it or points away. */
export function meetPlane(ray: Ray, point: Vector, normal: Vector): Vector | null {
  const slope = dot(ray.direction, normal);
  if (Math.abs(slope) < 1e-12 * length(ray.direction) * length(normal)) return null;
  const distance = dot(subtract(point, ray.origin), normal) / slope;
  return distance < 0 ? null : add(ray.origin, scale(ray.direction, distance));
}

export interface Hit {
  /** In lengths of the ray's direction. */
  readonly distance: number;
  readonly triangle: number;
  readonly point: Vector;
}

/**
 * The triangles that a ray passes through, from either side, nearest first (Möller and Trumbore 1997).
 *
 * @param positions x, y, z of each vertex.
 * @param triangles Three vertices of each triangle.
 */
export function meetTriangles(ray: Ray, positions: ArrayLike<number>, triangles: ArrayLike<number>): Hit[] {
  const [ox, oy, oz] = ray.origin;
  const [dx, dy, dz] = ray.direction;
  const hits: Hit[] = [];
  const p = (i: number): number => positions[i] ?? 0;
  for (let t = 0; t < triangles.length; t += 3) {
    const a = 3 * (triangles[t] ?? 0);
    const b = 3 * (triangles[t + 1] ?? 0);
    const c = 3 * (triangles[t + 2] ?? 0);
    const [ex, ey, ez] = [p(b) - p(a), p(b + 1) - p(a + 1), p(b + 2) - p(a + 2)];
    const [fx, fy, fz] = [p(c) - p(a), p(c + 1) - p(a + 1), p(c + 2) - p(a + 2)];
    const [hx, hy, hz] = [dy * fz - dz * fy, dz * fx - dx * fz, dx * fy - dy * fx];
    const determinant = ex * hx + ey * hy + ez * hz;
    if (determinant === 0) continue;
    const [sx, sy, sz] = [ox - p(a), oy - p(a + 1), oz - p(a + 2)];
    const u = (sx * hx + sy * hy + sz * hz) / determinant;
    if (u < 0 || u > 1) continue;
    const [qx, qy, qz] = [sy * ez - sz * ey, sz * ex - sx * ez, sx * ey - sy * ex];
    const v = (dx * qx + dy * qy + dz * qz) / determinant;
    if (v < 0 || u + v > 1) continue;
    const distance = (fx * qx + fy * qy + fz * qz) / determinant;
    if (distance <= 0) continue;
    hits.push({ distance, triangle: t / 3, point: add(ray.origin, scale(ray.direction, distance)) });
  }
  return hits.sort((one, other) => one.distance - other.distance);
}

/** The middle between where a ray enters a body and where it leaves it: a point inside the limb under the pointer. */
export function insideOf(hits: readonly Hit[]): Vector | null {
  const [entry, exit] = hits;
  if (entry === undefined) return null;
  return exit === undefined ? entry.point : middle(entry.point, exit.point);
}

/** The distance of a point from a segment, in any plane or space, and the share of the segment nearest to it. */
export function toSegment(point: Vector, from: Vector, to: Vector): { distance: number; share: number } {
  const along = subtract(to, from);
  const square = dot(along, along);
  const share = square === 0 ? 0 : Math.min(1, Math.max(0, dot(subtract(point, from), along) / square));
  return { distance: length(subtract(point, add(from, scale(along, share)))), share };
}

/** A point on the other side of the plane through a point with a unit normal. */
export function reflect(point: Vector, through: Vector, normal: Vector): Vector {
  return subtract(point, scale(normal, 2 * dot(subtract(point, through), normal)));
}
