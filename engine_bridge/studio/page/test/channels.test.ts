import assert from "node:assert/strict";
import test from "node:test";

import { held, metersOf, movedByChannel, rangeOf, ranged, withBend, withMorph, withMove, withRange, withoutBend, withoutMorph, withoutMove } from "../src/model/channels";
import { type Limb, type Puppet, handleNamed, limbNamed, mirror } from "../src/model/puppet";

const EAR: Limb = { name: "left ear", points: [[1, 2, 0], [1, 3, 0]], joints: ["shoulder_center", "head"] };

const PUPPET: Puppet = {
  character: { up: "y", front: "z" },
  limb: [{ name: "trunk", points: [[0, 0, 0], [0, 1, 0]], joints: ["hip_center", "head"] }, EAR],
  handle: [{ name: "tail", position: [0, 0, -1], channel: "voice" }],
};

test("a channel bends a limb about the axis to the side, and a bend keeps its angle and axis", () => {
  const bent = withBend(PUPPET, "left ear", "blink_left");
  assert.deepEqual(limbNamed(bent, "left ear")?.bend, { channel: "blink_left", degrees: 20, axis: "x" });
  const other: Puppet = { ...PUPPET, limb: [{ ...EAR, bend: { channel: "smile", degrees: -5, axis: "z" } }] };
  assert.deepEqual(limbNamed(withBend(other, "left ear", "voice"), "left ear")?.bend, { channel: "voice", degrees: -5, axis: "z" });
  assert.equal(limbNamed(withoutBend(bent, "left ear"), "left ear")?.bend, null);
});

test("a limb that is copied to the other side is bent by the channel of that side, the other way", () => {
  const bent: Puppet = { ...PUPPET, limb: [{ ...EAR, bend: { channel: "blink_left", degrees: 30, axis: "-z" } }] };
  const copied = mirror(bent, { kind: "limb", name: "left ear" }, [0, 0, 0])?.puppet;
  assert.deepEqual(copied?.limb?.[1]?.bend, { channel: "blink_right", degrees: 30, axis: "z" });
});

test("a channel moves a handle upwards, one that is moved keeps its way, and a copy on the other side moves as its mirror image", () => {
  const claw: Puppet = { character: { up: "z", front: "y", scale: 0.01 }, handle: [{ name: "left claw", position: [1, 0, 0] }] };
  const moved = withMove(claw, "left claw", "blink_left");
  assert.deepEqual(handleNamed(moved, "left claw"), { name: "left claw", position: [1, 0, 0], channel: "blink_left", moves: [0, 0, 10] });
  const aside: Puppet = { ...claw, handle: [{ name: "left claw", position: [1, 0, 0], channel: "smile", moves: [2, 3, 0] }] };
  assert.deepEqual(handleNamed(withMove(aside, "left claw", "blink_left"), "left claw")?.moves, [2, 3, 0]);
  const copied = mirror(withMove(aside, "left claw", "blink_left"), { kind: "handle", name: "left claw" }, [0, 0, 0])?.puppet;
  assert.deepEqual(copied?.handle?.[1], { name: "right claw", position: [-1, 0, 0], channel: "blink_right", moves: [-2, 3, 0] });
  assert.deepEqual(handleNamed(withoutMove(aside, "left claw"), "left claw"), { name: "left claw", position: [1, 0, 0], channel: null, moves: [0, 0, 0] });
});

test("a morph target is moved by a channel once, with a gain, and by several channels", () => {
  let puppet = withMorph(PUPPET, "jawOpen", "voice");
  assert.equal(withMorph(puppet, "jawOpen", "voice"), puppet);
  puppet = withMorph(withMorph(puppet, "jawOpen", "mouth_open"), "jawOpen", "voice", 0.5);
  assert.deepEqual(puppet.morph, [{ target: "jawOpen", channel: "voice", gain: 0.5 }, { target: "jawOpen", channel: "mouth_open" }]);
  assert.deepEqual(movedByChannel(puppet, "voice"), ["tail", "jawOpen"]);
  assert.deepEqual(withoutMorph(puppet, "jawOpen", "voice").morph, [{ target: "jawOpen", channel: "mouth_open" }]);
});

test("fingers have meters if they are measured or move something", () => {
  const names = metersOf(withMorph(PUPPET, "claw", "index_1_left"), { thumb_2_right: 0.5 });
  assert.deepEqual(names.slice(11), ["index_1_left", "thumb_2_right"]);
});

test("a range makes its values 0 and 1, also the other way round, and is replaced or removed", () => {
  const puppet = withRange(withRange(PUPPET, "smile", { neutral: 0, full: 1 }), "smile", { neutral: 0.5, full: 0.25 });
  assert.deepEqual(puppet.channel, [{ name: "smile", neutral: 0.5, full: 0.25 }]);
  assert.deepEqual([0.75, 0.5, 0.375, 0].map((value) => ranged(rangeOf(puppet, "smile"), value)), [0, 0, 0.5, 1]);
  assert.equal(ranged(undefined, 0.25), 0.25);
  assert.deepEqual(withRange(puppet, "smile", null).channel, []);
});

test("a value counts as held after a second in which it hardly moves, and only away from the neutral one", () => {
  const samples = (...values: number[]) => values.map((value, i) => ({ time: 100 * i, value }));
  const still = new Array<number>(11).fill(0.1);
  assert.equal(held(samples(...still.slice(1)), null), null);
  assert.equal(held(samples(...still), null), 0.1);
  assert.equal(held(samples(...still), 0.1), null);
  const opening = [...still, 0.3, 0.5, 0.7, 0.8];
  assert.equal(held(samples(...opening), null), null);
  assert.equal(held(samples(...opening), 0.1), null);
  assert.equal(held(samples(...opening, ...new Array<number>(10).fill(0.8)), 0.1), 0.8);
});
