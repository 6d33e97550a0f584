import assert from "node:assert/strict";
import test from "node:test";

import { path, range } from "../src/model/plot";

test("the range covers all series, and is never empty", () => {
  assert.deepEqual(range([1, 4], [-2, Number.NaN]), [-2, 4]);
  assert.deepEqual(range([3, 3]), [2.5, 3.5]);
  assert.deepEqual(range([]), [0, 1]);
});

test("a path runs from left to right, with high values at the top", () => {
  assert.equal(path([0, 1, 2], [0, 10, 5], [0, 2], [0, 10], { width: 100, height: 50 }), "M0.0 50.0L50.0 0.0L100.0 25.0");
});

test("a value that is missing leaves a gap", () => {
  const line = path([0, 1, 2, 3], [0, Number.NaN, 0, 1], [0, 3], [0, 1], { width: 3, height: 1 });
  assert.equal(line, "M0.0 1.0M2.0 1.0L3.0 0.0");
});
