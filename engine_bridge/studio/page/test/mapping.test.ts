import assert from "node:assert/strict";
import test from "node:test";

import { Page, focused } from "./page";
import { NAME, PUPPET } from "./server";

test("a joint moves the limb, the point or the handle that is clicked after it, or that was selected before it", async () => {
  const page = await Page.open();
  await page.joint("foot_right").click();
  assert.equal(page.state.joint, "foot_right");
  await page.line("left arm").click();
  assert.deepEqual(page.limb("left arm").joints, ["hip_right", "knee_right", "ankle_right", "foot_right"]);
  assert.equal(page.state.joint, null);
  await page.button("Point 4").click();
  await page.joint("head").press("Enter");
  assert.equal(page.limb("left arm").joints[3], "head");
  assert.equal(page.joint("head").is("aria-pressed"), "true");
  await page.button("‹ All limbs and handles").click();
  await page.joint("hand_left").click();
  await page.line("hump").click();
  assert.equal(page.handle("hump").joint, "hand_left");
  assert.equal(page.joint("hand_left").is("aria-label"), "left hand: moves hump");
  assert.equal(page.joint("hand_right").is("aria-label"), "right hand: moves right arm");
});

test("a joint that waits is put back by Cancel, by itself and by Escape", async () => {
  const page = await Page.open();
  for (const back of [() => page.button("Cancel").click(), () => page.joint("head").click(), () => page.press("Escape")]) {
    await page.joint("head").click();
    assert.ok(page.text.includes("Click the limb, point or handle that the performer's head should move."));
    await back();
    assert.equal(page.state.joint, null);
  }
});

test("arrow keys lead from joint to joint, and the figure stands as the performer", async () => {
  const page = await Page.open();
  await page.joint("head").press("ArrowDown");
  await page.joint("shoulder_center").press("ArrowRight");
  assert.equal(focused, "joint-shoulder_left");
  const place = (): unknown => page.joint("hand_left").is("transform");
  const standing = place();
  page.joints = new Float32Array(80).fill(Number.NaN);
  assert.equal(place(), standing);
  page.joints.set([0, 1, 0, 1]);
  page.joints.set([-0.4, 1.5, 0, 0], 4 * 7);
  assert.equal(place(), "translate(180.0 61.0)");
  assert.ok(String(page.joint("hand_left").is("class")).split(" ").includes("lost"));
});

const fill = (page: Page, name: string): unknown => page.within(page.meter(name)).find((each) => String(each.is("class")).startsWith("fill "))?.is("style");

test("meters show the performer's channels, and map what is clicked after them", async () => {
  const page = await Page.open();
  page.channels = { mouth_open: 0.125, index_2_left: 0.25 };
  assert.deepEqual(["mouth open", "smile", "left index 2"].map((name) => fill(page, name)), ["width: 12.5%", "width: 0.0%", "width: 25.0%"]);

  await page.meter("mouth open").click();
  await page.line("jaw").click();
  assert.deepEqual(page.puppet.morph, [{ target: "jaw", channel: "mouth_open" }]);
  await page.line("jaw").click();
  assert.ok(page.text.includes("Click the meter that should move jaw."));
  await page.meter("smile").click();
  await page.field("Gain of smile").enter(0.5);
  await page.button("Remove mouth open from jaw").click();
  assert.deepEqual(page.puppet.morph, [{ target: "jaw", channel: "smile", gain: 0.5 }]);
  assert.ok(page.meter("smile").text.includes("→ jaw"));

  await page.meter("left blink").click();
  await page.line("head").click();
  assert.deepEqual(page.limb("head").bend, { channel: "blink_left", degrees: 20, axis: "x" });
  await page.field("Bends about").choose("−z");
  assert.equal(page.limb("head").bend?.axis, "-z");
  await page.meter("smile").click();
  assert.equal(page.limb("head").bend?.channel, "smile");
  await page.field("Bent by").choose("Nothing");
  assert.equal(page.limb("head").bend, null);
  await page.press("Escape");

  await page.meter("brow up").click();
  await page.line("hump").click();
  await page.field("Way, x").enter(0.05);
  assert.deepEqual([page.handle("hump").channel, page.handle("hump").moves], ["brow_up", [0.05, 0.1, 0]]);
  await page.field("Moved by").choose("Nothing");
  assert.equal(page.handle("hump").channel, null);

  await page.press("Escape");
  for (const back of [() => page.button("Cancel").click(), () => page.meter("voice").click(), () => page.press("Escape")]) {
    await page.meter("voice").click();
    assert.equal(page.state.channel, "voice");
    await back();
    assert.equal(page.state.channel, null);
  }
});

test("the range of a channel is measured in two seconds in which the performer holds it, and forgotten", async () => {
  const page = await Page.open((server) => {
    server.open(NAME, { ...PUPPET, retarget: { mirror: true }, morph: [{ target: "jaw", channel: "blink_left" }] });
  });
  await page.perform({ blink_left: 0.125 }, 100);
  await page.meter("left blink").click();
  await page.button("Measure my range").click();
  assert.ok(page.text.includes("Open your eyes, and hold it for a second."));
  await page.perform({ blink_left: 0.125 }, 1100);
  assert.ok(page.text.includes("Close your right eye, and hold it for a second.")); // of a mirrored character
  await page.perform({ blink_left: 0.125 }, 1500);
  assert.deepEqual(page.puppet.channel, []);
  await page.perform({ blink_left: 0.625 }, 1100);
  assert.deepEqual(page.puppet.channel, [{ name: "blink_left", neutral: 0.125, full: 0.625 }]);
  for (const [value, share] of [[0.625, "100.0"], [0.375, "50.0"], [0, "0.0"]] as const) {
    page.channels = { blink_left: value };
    assert.equal(fill(page, "left blink"), `width: ${share}%`);
  }
  assert.ok(page.text.includes("Your range of left blink is measured. It now moves jaw from rest to its full way."));
  await page.meter("left blink").click();
  await page.button("Use the usual range").click();
  assert.deepEqual(page.puppet.channel, []);
  await page.button("Measure my range").click();
  await page.button("Cancel").click();
  assert.equal(page.state.finding, null);
  assert.deepEqual(page.server.asked("edit").length, 2);
});
