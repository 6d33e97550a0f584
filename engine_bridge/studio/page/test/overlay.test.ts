import assert from "node:assert/strict";
import test from "node:test";

import type { Puppet } from "../src/model/puppet";
import { marksOf, partAt } from "../src/viewer/overlay";

const PUPPET: Puppet = {
  character: {},
  limb: [{ name: "arm", points: [[0, 0, 0], [100, 0, 0]], joints: ["shoulder_left", "hand_left"] }],
  handle: [{ name: "head", position: [50, 60, 0] }],
};
const marks = marksOf(PUPPET, (_part, point) => point);

test("the nearest point or handle within reach is picked", () => {
  assert.deepEqual(partAt(marks, 95, 5), { kind: "limb", name: "arm", point: 1 });
  assert.deepEqual(partAt(marks, 52, 55), { kind: "handle", name: "head" });
});

test("between its points, a bone picks its limb", () => {
  assert.deepEqual(partAt(marks, 50, 8), { kind: "limb", name: "arm" });
  assert.equal(partAt(marks, 50, 30), null);
});

test("what is behind the camera is not picked", () => {
  assert.equal(partAt(marksOf(PUPPET, () => null), 50, 8), null);
});
