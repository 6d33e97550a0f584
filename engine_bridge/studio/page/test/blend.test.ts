import assert from "node:assert/strict";
import test from "node:test";

import { type Shape, apply, carried, nearest, transformOf } from "../src/viewer/blend";

// one field of three isolines: the first moves by x, the second by 2 y, the third by 4 z
const row = (...values: number[]): number[] => values;
const CONTROLS = new Float32Array([
  ...row(1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0),
  ...row(1, 0, 0, 0, 0, 1, 0, 2, 0, 0, 1, 0),
  ...row(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 4),
]);

const SHAPE: Shape = {
  count: 3,
  fields: 1,
  isolines: 3,
  weights: [1],
  positions: new Float32Array([0, 0, 0, 1, 1, 1, 5, 0, 0]),
  coordinates: new Float32Array([0, 0.5, 2]),
};

test("a vertex moves by the mean of the two isolines that it lies between", () => {
  assert.deepEqual(apply(transformOf(SHAPE, CONTROLS, 0), [0, 0, 0]), [1, 0, 0]);
  assert.deepEqual(apply(transformOf(SHAPE, CONTROLS, 1), [1, 1, 1]), [1.5, 2, 1]);
  assert.deepEqual(apply(transformOf(SHAPE, CONTROLS, 2), [5, 0, 0]), [5, 0, 4]);
});

test("a point inside is carried by the surface around it", () => {
  assert.deepEqual(nearest(SHAPE, [0.9, 0.9, 0.9], 2), [1, 0]);
  assert.deepEqual(carried(SHAPE, CONTROLS, [0, 2], [0, 0, 0]), [0.5, 0, 2]);
});
