import assert from "node:assert/strict";
import test from "node:test";
import { Box3, PerspectiveCamera, Ray, Vector3 } from "three";

import { FARTHEST } from "../src/model/scene";
import { remember, remembered } from "../src/storage";
import { RADIUS } from "../src/viewer/backdrop";
import { untilRelease } from "../src/viewer/pointer";
import { aim } from "../src/viewer/stage";
import { characterAt, dragged } from "../src/viewer/standing";

const ROW = { name: "dog", puppet: "live.toml", position: [1, 2] as const };
const onto = (x: number, z: number): Ray => new Ray(new Vector3(x, 3, z + 4), new Vector3(0, -3, -4).normalize());

test("a character follows the pointer over the floor, to centimetres, and not further than the sliders go", () => {
  assert.deepEqual(dragged(ROW, onto(0, 0), onto(0.5, -1)), { name: "dog", position: [1.5, 1] });
  assert.deepEqual(dragged({ name: "dog", puppet: "" }, onto(1, 1), onto(1.234, 1)), { name: "dog", position: [0.23, 0] });
  assert.deepEqual(dragged(ROW, onto(0, 0), onto(99, -99)), { name: "dog", position: [FARTHEST, -FARTHEST] });
  assert.equal(dragged(ROW, onto(0, 0), new Ray(new Vector3(0, 1, 0), new Vector3(0, 1, 0))), null);
});

test("a click chooses the character in front", () => {
  const box = (z: number): Box3 => new Box3(new Vector3(-1, 0, z - 1), new Vector3(1, 2, z + 1));
  const ray = new Ray(new Vector3(0, 1, 20), new Vector3(0, 0, -1));
  assert.equal(characterAt(ray, new Map([["behind", box(-5)], ["front", box(5)]])), "front");
  assert.equal(characterAt(new Ray(new Vector3(5, 1, 20), new Vector3(0, 0, -1)), new Map([["front", box(5)]])), null);
});

test("the picture of the place is in sight of every camera, however small or large the characters are", () => {
  for (const size of [0.01, 1, 8, 60]) {
    const camera = new PerspectiveCamera(35, 1.6);
    aim(camera, new Box3(new Vector3(-size, 0, -size), new Vector3(size, 2 * size, size)), new Vector3(0, 0, 1), 0.62);
    const farthest = camera.position.length() + RADIUS;
    assert.ok(camera.near < size && camera.far > Math.min(farthest, 2 * RADIUS), `${size}: ${camera.far}`);
  }
});

test("a drag ends where the pointer is released, and without effect where the browser takes it away", () => {
  for (const [end, expected] of [["pointerup", ["moved", "released"]], ["pointercancel", ["moved", "cancelled"]]] as const) {
    const [element, seen] = [new EventTarget(), [] as string[]];
    untilRelease(element, () => seen.push("moved"), () => seen.push("released"), () => seen.push("cancelled"));
    for (const name of ["pointermove", end, "pointermove", "pointerup", "pointercancel"]) element.dispatchEvent(new Event(name));
    assert.deepEqual(seen, expected);
  }
});

test("a browser that lets no page store anything remembers nothing, and the page works", () => {
  const blocked = { getItem: () => {
    throw new Error("blocked");
  }, setItem: () => {
    throw new Error("blocked");
  } };
  Object.assign(globalThis, { localStorage: blocked });
  remember("key", "value");
  assert.equal(remembered("key"), null);
});
