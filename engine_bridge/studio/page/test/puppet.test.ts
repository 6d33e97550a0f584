import assert from "node:assert/strict";
import test from "node:test";

import {
  type Puppet,
  addHandle,
  addJaw,
  addLimb,
  addPoint,
  follow,
  freeName,
  has,
  jawPoint,
  jointsOf,
  leftOf,
  sidewaysAxis,
  mirror,
  move,
  otherSide,
  remove,
  rename,
  symmetryPoint,
  withHandleJoints,
  withLimb,
} from "../src/model/puppet";

const PUPPET: Puppet = {
  character: { mesh: "horse.glb", up: "y", front: "z" },
  limb: [
    { name: "trunk", points: [[1, 0, 0], [1, 1, 0]], joints: ["hip_center", "shoulder_center"] },
    { name: "left wing", points: [[2, 1, 0], [3, 2, 0], [4, 3, 1]], joints: ["shoulder_left", "elbow_left", "hand_left"], gain: 0.5 },
    { name: "left feather", points: [[4, 3, 1], [5, 3, 1]], joints: ["wrist_left", "hand_left"], parent: "left wing" },
  ],
  handle: [{ name: "head", position: [1, 2, 1], joint: "head" }],
};

const wing = { kind: "limb", name: "left wing" } as const;
const head = { kind: "handle", name: "head" } as const;

test("names change sides whatever their case and separators", () => {
  assert.equal(otherSide("left wing"), "right wing");
  assert.equal(otherSide("Right front leg"), "Left front leg");
  assert.equal(otherSide("hand_left"), "hand_right");
  assert.equal(otherSide("wing.L"), "wing.R");
  assert.equal(otherSide("cleft"), null);
  assert.equal(otherSide("tail"), null);
});

test("a mirrored limb has the other name, joints and points, and keeps the rest", () => {
  const mirrored = mirror(PUPPET, wing, symmetryPoint(PUPPET, [[0, 0, 0], [2, 2, 2]]));
  assert.deepEqual(mirrored?.part, { kind: "limb", name: "right wing" });
  assert.deepEqual(mirrored.puppet.limb?.at(-1), {
    name: "right wing",
    points: [[0, 1, 0], [-1, 2, 0], [-2, 3, 1]],
    joints: ["shoulder_right", "elbow_right", "hand_right"],
    gain: 0.5,
  });
  assert.deepEqual(mirrored.puppet.limb.slice(0, 3), PUPPET.limb);
});

test("mirroring twice replaces the limb by itself", () => {
  const through = symmetryPoint(PUPPET, [[0, 0, 0], [2, 2, 2]]);
  const once = mirror(PUPPET, wing, through);
  const twice = once === null ? null : mirror(once.puppet, once.part, through);
  assert.deepEqual(twice?.puppet, once?.puppet);
});

test("a mirrored limb hangs on the other side's parent if there is one", () => {
  const through = symmetryPoint(PUPPET, [[0, 0, 0], [2, 2, 2]]);
  const feather = { kind: "limb", name: "left feather" } as const;
  assert.equal(mirror(PUPPET, feather, through)?.puppet.limb?.at(-1)?.parent, "left wing");
  const winged = mirror(PUPPET, wing, through)?.puppet ?? PUPPET;
  assert.equal(mirror(winged, feather, through)?.puppet.limb?.at(-1)?.parent, "right wing");
});

test("a handle without a side cannot be mirrored", () => {
  assert.equal(mirror(PUPPET, head, [0, 0, 0]), null);
});

test("left is up times front", () => {
  assert.deepEqual(leftOf(PUPPET), [1, 0, 0]);
  assert.deepEqual(leftOf({ character: { up: "z", front: "-y" } }), [1, 0, 0]);
  const [x, y, z] = leftOf({ character: { up: "y", front: "z", turn: 30 } });
  assert.ok(Math.hypot(x - Math.cos(Math.PI / 6), y, z + Math.sin(Math.PI / 6)) < 1e-12);
  assert.equal(sidewaysAxis({ character: { up: "y", front: "z", turn: 60 } }), "-z");
});

test("without a trunk, the plane of symmetry goes through the middle of the box", () => {
  assert.deepEqual(symmetryPoint({ character: {} }, [[0, 2, 4], [2, 4, 8]]), [1, 3, 6]);
});

test("a joint moves the point or the handle that it is given to, or a whole limb along its chain", () => {
  assert.deepEqual(jointsOf(follow(PUPPET, head, "hand_right"), head), ["hand_right"]);
  assert.deepEqual(jointsOf(follow(PUPPET, { ...wing, point: 1 }, "head"), wing), ["shoulder_left", "head", "hand_left"]);
  assert.deepEqual(jointsOf(follow(PUPPET, wing, "knee_right"), wing), ["hip_right", "ankle_right", "foot_right"]);
});

test("a limb with more points than the chain has joints follows means of neighbours", () => {
  const longer = addPoint(addPoint(PUPPET, "left wing", 2), "left wing", 3);
  const mapped = follow(longer, wing, "hand_left");
  assert.deepEqual(mapped.limb?.[1]?.joints, ["shoulder_left", "elbow_left", "wrist_left", ["wrist_left", "hand_left"], "hand_left"]);
});

test("a handle follows one joint, the mean of several, or none", () => {
  assert.deepEqual(withHandleJoints(PUPPET, "head", ["hand_left", "hand_right"]).handle, [
    { name: "head", position: [1, 2, 1], joints: ["hand_left", "hand_right"] },
  ]);
  assert.deepEqual(withHandleJoints(PUPPET, "head", []).handle, [{ name: "head", position: [1, 2, 1] }]);
});

test("a new point lies in the middle of its bone, and beyond the tip as far as the last bone is long", () => {
  assert.deepEqual(addPoint(PUPPET, "left wing", 0).limb?.[1]?.points, [[2, 1, 0], [2.5, 1.5, 0], [3, 2, 0], [4, 3, 1]]);
  assert.deepEqual(addPoint(PUPPET, "left wing", 0).limb?.[1]?.joints[1], ["shoulder_left", "elbow_left"]);
  assert.deepEqual(addPoint(PUPPET, "left wing", 2).limb?.[1]?.points[3], [5, 4, 2]);
});

test("a limb whose points change forgets the joints that it was read from", () => {
  const nodes = (puppet: Puppet | undefined, limb = 1): unknown => puppet?.limb?.[limb]?.nodes;
  const read = withLimb(PUPPET, "left wing", (limb) => ({ ...limb, nodes: ["Wing"] }));
  assert.deepEqual(nodes(rename(follow(read, wing, "hand_right"), wing, "left arm")), ["Wing"]);
  for (const changed of [move(read, { ...wing, point: 0 }, [9, 9, 9]), addPoint(read, "left wing", 0)]) {
    assert.equal(nodes(changed), undefined);
  }
  assert.equal(nodes(mirror(read, wing, [0, 0, 0])?.puppet, 3), undefined);
});

test("points can be removed down to two; removing another removes the limb and frees its children", () => {
  const shorter = remove(PUPPET, { ...wing, point: 1 });
  assert.deepEqual(shorter.limb?.[1]?.points, [[2, 1, 0], [4, 3, 1]]);
  const gone = remove(shorter, { ...wing, point: 0 });
  assert.deepEqual(gone.limb?.map(({ name }) => name), ["trunk", "left feather"]);
  assert.equal(gone.limb[1]?.parent, undefined);
});

test("renaming a limb renames the parent of its children", () => {
  const renamed = rename(PUPPET, wing, "left arm");
  assert.deepEqual(renamed.limb?.map(({ name, parent }) => [name, parent]), [
    ["trunk", undefined],
    ["left arm", undefined],
    ["left feather", "left arm"],
  ]);
});

test("parts are found by their name and point", () => {
  assert.equal(has(PUPPET, { ...wing, point: 2 }), true);
  assert.equal(has(PUPPET, { ...wing, point: 3 }), false);
  assert.equal(has(remove(PUPPET, head), head), false);
});

test("edits leave the puppet that they begin with as it was", () => {
  const before = structuredClone(PUPPET);
  move(PUPPET, { ...wing, point: 0 }, [9, 9, 9]);
  addHandle(PUPPET, "tail", [0, 0, 0]);
  addLimb(PUPPET, "tail", [[0, 0, 0], [0, 0, -1]]);
  assert.deepEqual(PUPPET, before);
});

test("a new limb follows what its name suggests, and a new name is free", () => {
  assert.deepEqual(addLimb(PUPPET, "right leg", [[0, 0, 0], [0, 1, 0]]).limb?.at(-1)?.joints, ["hip_right", "foot_right"]);
  assert.deepEqual(addLimb(PUPPET, "tail", [[0, 0, 0], [0, 1, 0]]).limb?.at(-1)?.joints, ["hip_center", "head"]);
  assert.equal(freeName("limb", ["limb", "limb 2"]), "limb 3");
});

test("a click puts a point of a jaw into the plane of symmetry, or inside the body from the front", () => {
  const bounds = [[0, 0, 0], [2, 2, 2]] as const;
  assert.deepEqual(jawPoint(PUPPET, bounds, [3, 1, 1], [5, 1, 2]), [1, 1, 0]);
  assert.deepEqual(jawPoint(PUPPET, bounds, [3, 1, 1], [3.1, 1, 2]), [3, 1, 1]);
  assert.deepEqual(jawPoint(PUPPET, bounds, [-1, 1, 1], [0, 1, 1]), [-1, 1, 1]);
});

test("a jaw opens downwards with the voice, whatever the mesh's directions, and replaces the one that there is", () => {
  for (const [up, front, axis] of [["y", "z", "x"], ["z", "-y", "x"], ["z", "y", "-x"], ["y", "x", "-z"]] as const) {
    const puppet = { ...PUPPET, character: { up, front }, limb: [...(PUPPET.limb ?? []), { name: "head", points: [], joints: [] }] };
    const made = addJaw(addJaw(puppet, [0, 0, 0], [1, 1, 1]), [1, 2, 3], [1, 2, 4]);
    const limbs = made.limb ?? [];
    assert.deepEqual(limbs.at(-1), {
      name: "jaw", points: [[1, 2, 3], [1, 2, 4]], joints: ["shoulder_center", "head"], follow: "turn", gain: 0, parent: "head",
      bend: { channel: "voice", degrees: 20, axis },
    });
    assert.equal(limbs.length, 5);
  }
  assert.equal(addJaw(PUPPET, [0, 0, 0], [1, 1, 1]).limb?.at(-1)?.parent, undefined);
});
