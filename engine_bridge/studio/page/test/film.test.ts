import assert from "node:assert/strict";
import { test } from "node:test";
import type { FilmTake } from "../src/messages";
import { append, endOf, move, mute, nameOf, remove, trimStart, trimStop } from "../src/model/film";

const take = (character: string, at: number, start = 0, stop = 4): FilmTake => ({ character, file: "takes/take-1.log", at, start, stop, mute: false });
const takes = [take("dog", 0), take("human", 2, 1, 3)];

test("a take moves in time and to another character, never before the film", () => {
  assert.deepEqual(move(takes, 1, -0.5, "dog")[1], { ...takes[1], at: 1.5, character: "dog" });
  assert.equal(move(takes, 0, -3)[0]?.at, 0);
  assert.deepEqual(move(takes, 7, 1), takes);
});

test("trimming the beginning keeps what follows in its place", () => {
  assert.deepEqual(trimStart(takes, 1, 0.5)[1], { ...takes[1], start: 1.5, at: 2.5 });
  assert.deepEqual(trimStart(takes, 1, -9)[1], { ...takes[1], start: 0, at: 1 });
  assert.equal(trimStart(takes, 1, 9)[1]?.start, 2.7);
  assert.equal(trimStart(takes, 0, -1)[0]?.at, 0);
});

test("trimming the end stays inside of the recording", () => {
  assert.equal(trimStop(takes, 1, 9, 4)[1]?.stop, 4);
  assert.equal(trimStop(takes, 1, -9, 4)[1]?.stop, 1.3);
});

test("a take is muted, removed, and added after the last one of its character", () => {
  assert.equal(mute(mute(takes, 0), 0)[0]?.mute, false);
  assert.deepEqual(remove(takes, 0), [takes[1]]);
  const added = append(takes, "dog", "take-9")[2];
  assert.deepEqual([added?.at, added === undefined ? "" : nameOf(added)], [4, "take-9"]);
  assert.equal(endOf(takes), 4);
});
