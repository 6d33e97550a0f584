import assert from "node:assert/strict";
import test from "node:test";

import { type Ray, type Vector, insideOf, meetPlane, meetTriangles, reflect, toSegment } from "../src/model/vector";

const down: Ray = { origin: [0.25, 5, 0.25], direction: [0, -2, 0] };

// two parallel triangles at the heights 3 and 1, and one beside the ray
const positions = [0, 3, 0, 1, 3, 0, 0, 3, 1, 0, 1, 0, 1, 1, 0, 0, 1, 1, 4, 2, 4, 5, 2, 4, 4, 2, 5];
const triangles = [3, 4, 5, 6, 7, 8, 0, 1, 2];

test("a ray meets the triangles on its way, nearest first, from either side", () => {
  const hits = meetTriangles(down, positions, triangles);
  assert.deepEqual(
    hits.map(({ triangle, distance, point }) => [triangle, distance, point]),
    [
      [2, 1, [0.25, 3, 0.25]],
      [0, 2, [0.25, 1, 0.25]],
    ],
  );
  const up: Ray = { origin: [0.25, 0, 0.25], direction: [0, 1, 0] };
  assert.deepEqual(meetTriangles(up, positions, triangles).map(({ triangle }) => triangle), [0, 2]);
});

test("what lies behind the ray's origin or outside of the triangle is not met", () => {
  assert.deepEqual(meetTriangles({ origin: [0.25, 0.5, 0.25], direction: [0, -1, 0] }, positions, triangles), []);
  assert.deepEqual(meetTriangles({ origin: [0.6, 5, 0.6], direction: [0, -1, 0] }, positions, triangles), []);
});

test("the point inside a body is halfway between where the ray enters and leaves it", () => {
  assert.deepEqual(insideOf(meetTriangles(down, positions, triangles)), [0.25, 2, 0.25]);
  assert.deepEqual(insideOf(meetTriangles(down, positions, [0, 1, 2])), [0.25, 3, 0.25]);
  assert.equal(insideOf([]), null);
});

test("a ray meets a plane in front of it", () => {
  const ray: Ray = { origin: [0, 0, 10], direction: [1, 0, -2] };
  assert.deepEqual(meetPlane(ray, [7, 7, 4], [0, 0, 1]), [3, 0, 4]);
  assert.equal(meetPlane(ray, [0, 0, 11], [0, 0, 1]), null);
  assert.equal(meetPlane(ray, [0, 0, 4], [2, 0, 1]), null);
});

test("the distance of a point from a segment ends at the segment's ends", () => {
  const [from, to]: [Vector, Vector] = [[0, 0, 0], [10, 0, 0]];
  assert.deepEqual(toSegment([4, 3, 0], from, to), { distance: 3, share: 0.4 });
  assert.deepEqual(toSegment([13, 4, 0], from, to), { distance: 5, share: 1 });
  assert.deepEqual(toSegment([3, 4, 0], from, from), { distance: 5, share: 0 });
});

test("a reflected point is as far behind the plane as it was before it", () => {
  assert.deepEqual(reflect([5, 1, 2], [1, 0, 0], [1, 0, 0]), [-3, 1, 2]);
});
