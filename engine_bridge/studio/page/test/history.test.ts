import assert from "node:assert/strict";
import test from "node:test";

import { MAX_STEPS, begin, commit, redo, settle, undo } from "../src/model/history";

test("undo returns through all steps, and redo to the last one", () => {
  const made = commit(commit(begin("a"), "b"), "c");
  assert.equal(undo(made).present, "b");
  assert.equal(undo(undo(made)).present, "a");
  assert.equal(redo(redo(undo(undo(made)))).present, "c");
});

test("without a step, undo and redo return the same history", () => {
  const made = begin("a");
  assert.equal(undo(made), made);
  assert.equal(redo(made), made);
});

test("a new step discards what was undone", () => {
  const made = commit(undo(commit(begin("a"), "b")), "c");
  assert.deepEqual(made, { past: ["a"], present: "c", future: [] });
});

test("only the newest steps are kept", () => {
  let made = begin(0);
  for (let step = 1; step <= MAX_STEPS + 5; step++) made = commit(made, step);
  assert.equal(made.past.length, MAX_STEPS);
  assert.equal(made.past[0], 5);
});

test("a step that changed nothing after all is none, and other steps stay", () => {
  const made = commit(commit(begin("a"), "b"), "c");
  assert.deepEqual(settle(made, "b"), commit(begin("a"), "b"));
  assert.deepEqual(settle(undo(made), "c"), { past: ["a"], present: "c", future: [] });
  assert.deepEqual(settle(made, "d"), { ...made, present: "d" });
});
