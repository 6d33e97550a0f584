import assert from "node:assert/strict";
import { test } from "node:test";
import type { FilmTake, TakeState, Timeline } from "../src/messages";
import { partsOf, positionAt } from "../src/model/sound";

const entry = (take: string, at: number) => ({ character: "dog", take, at, seconds: 4, sound: { file: `${take}.wav`, at: at - 0.5 } });
const timeline: Timeline = { position: 1, moment: 100, start: 0, end: 7, speed: 2, paused: false, loop: false, takes: [entry("a", 0), entry("b", 3)] };
const recorded = ["a", "b"].map((name): TakeState => ({ name, seconds: 4, frames: 120, bytes: 9, written: 0, at: null, parts: [], picture: "", wave: "", sound: true, sound_file: `id-${name}` }));
const mute = (take: string): FilmTake => ({ character: "dog", file: `takes/${take}.log`, at: 0, start: 0, stop: 4, mute: true });

test("a sound is cut where its take begins, and where it or the character's next one ends it", () => {
  assert.deepEqual(partsOf(timeline, recorded, []), [
    { character: "dog", file: "id-a", from: 0, to: 3, at: -0.5 },
    { character: "dog", file: "id-b", from: 3, to: 7, at: 2.5 },
  ]);
});

test("takes without a sound, and those that are mute in the film, are not heard", () => {
  assert.deepEqual(partsOf(timeline, recorded, [mute("a"), { ...mute("b"), mute: false }]).map(({ file }) => file), ["id-b"]);
  assert.deepEqual(partsOf(timeline, recorded.slice(1), []).map(({ file }) => file), ["id-b"]);
});

test("the timeline runs from its moment on, and begins again in a loop", () => {
  assert.deepEqual(positionAt(timeline, 99), [1, 1]);
  assert.deepEqual(positionAt(timeline, 102), [5, 0]);
  assert.deepEqual(positionAt(timeline, 104), [9, 0]);
  assert.deepEqual(positionAt({ ...timeline, loop: true }, 104), [2, 0]);
});
