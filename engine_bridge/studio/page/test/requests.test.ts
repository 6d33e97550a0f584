import assert from "node:assert/strict";
import test from "node:test";

import { tried } from "../src/requests";
import { pass } from "./clock";

const failing = (times: number): { count: number; work: () => Promise<string> } => {
  const calls = { count: 0, work: () => ++calls.count > times ? Promise.resolve("a picture") : Promise.reject(new Error("lost")) };
  return calls;
};

test("what fails for a while is tried again after ever longer pauses, and no longer after four times", async () => {
  const twice = failing(2);
  const result = tried(twice.work);
  await pass(999);
  assert.equal(twice.count, 1);
  await pass(5000);
  assert.equal(await result, "a picture");
  const always = failing(Infinity);
  const refused = assert.rejects(tried(always.work), /lost/);
  await pass(600_000);
  await refused;
  assert.equal(always.count, 4);
});
