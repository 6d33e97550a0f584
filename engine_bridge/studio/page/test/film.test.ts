import assert from "node:assert/strict";
import { test } from "node:test";
import type { FilmTake } from "../src/messages";
import { EMPTY, append, endOf, keepFilm, move, mute, nameOf, remove, takeOf, trimStart, trimStop } from "../src/model/film";
import { keyOf } from "../src/model/rows";

const take = (character: string, at: number, start = 0, stop = 4): FilmTake => ({ character, file: "takes/take-1.log", at, start, stop, mute: false });
const [dog, human] = [take("dog", 0), take("human", 2, 1, 3)];
const takes = [dog, human];
const [first, second] = [keyOf(dog), keyOf(human)];

test("a take moves in time and to another character, never before the film", () => {
  assert.deepEqual(move(takes, second, -0.5, "dog")[1], { ...takes[1], at: 1.5, character: "dog" });
  assert.equal(move(takes, first, -3)[0]?.at, 0);
  assert.deepEqual(move(takes, "none", 1), takes);
});

test("a take is the same one wherever it is moved to, also when the server sends it again beside a new one", () => {
  const moved = move(takes, first, 5);
  assert.deepEqual(moved.map(keyOf), [second, first]);
  const sent = [take("cat", 1), ...moved.map((each) => ({ ...each }))];
  keepFilm({ ...EMPTY, takes: moved }, { ...EMPTY, takes: sent });
  assert.deepEqual(sent.slice(1).map(keyOf), [second, first]);
  assert.equal(takeOf(sent, first)?.at, 5);
  assert.ok(![first, second].includes(keyOf(sent[0] ?? {})));
});

test("trimming the beginning keeps what follows in its place", () => {
  assert.deepEqual(trimStart(takes, second, 0.5)[1], { ...takes[1], start: 1.5, at: 2.5 });
  assert.deepEqual(trimStart(takes, second, -9)[1], { ...takes[1], start: 0, at: 1 });
  assert.equal(trimStart(takes, second, 9)[1]?.start, 2.7);
  assert.equal(trimStart(takes, first, -1)[0]?.at, 0);
});

test("trimming the end stays inside of the recording", () => {
  assert.equal(trimStop(takes, second, 9, 4)[1]?.stop, 4);
  assert.equal(trimStop(takes, second, -9, 4)[1]?.stop, 1.3);
});

test("a take is muted, removed, and added after the last one of its character", () => {
  assert.equal(mute(mute(takes, first), first)[0]?.mute, false);
  assert.deepEqual(remove(takes, first), [takes[1]]);
  const added = append(takes, "dog", "take-9")[2];
  assert.deepEqual([added?.at, added === undefined ? "" : nameOf(added)], [4, "take-9"]);
  assert.equal(endOf(takes), 4);
});
