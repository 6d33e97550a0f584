import assert from "node:assert/strict";
import test from "node:test";

import type { Puppet } from "../src/model/puppet";
import { Page, typing } from "./page";
import { NAME, PUPPET } from "./server";

const edited = (page: Page): Puppet[] => page.server.asked("edit").map((each) => (each as { puppet: Puppet }).puppet);

test("a change is shown immediately, sent, undone and done again, by buttons and by keys", async () => {
  const page = await Page.open();
  await page.line("left arm").click();
  const send = page.server.hold("edit");
  await page.field("How far it moves").enter(1.5);
  assert.equal(page.limb("left arm").gain, 1.5);
  assert.deepEqual(page.state.busy, ["Applying the change…"]);
  await send();
  assert.deepEqual(page.state.busy, []);
  const [changed] = edited(page);
  assert.deepEqual(changed, { ...PUPPET, limb: PUPPET.limb?.map((limb) => limb.name === "left arm" ? { ...limb, gain: 1.5 } : limb) });
  assert.ok(page.text.includes("Unsaved changes"));
  await page.button("Undo").click();
  await send();
  assert.deepEqual(page.puppet, PUPPET);
  assert.ok(page.button("Undo").disabled);
  await page.button("Redo").click();
  await send();
  assert.deepEqual(page.puppet, changed);
  for (const [key, more, there] of [
    ["z", { ctrlKey: true }, PUPPET],
    ["Z", { ctrlKey: true, shiftKey: true }, changed],
    ["z", { metaKey: true }, PUPPET],
    ["y", { ctrlKey: true }, changed],
    ["z", { ctrlKey: true, target: typing() }, changed],
    ["z", {}, changed],
  ] as const) {
    await page.press(key, more);
    await send();
    assert.deepEqual(page.puppet, there, key);
  }
  assert.equal(edited(page).length, 7);
});

test("of the edits made while one is being applied, only the newest is sent next", async () => {
  const page = await Page.open();
  await page.line("left arm").click();
  const send = page.server.hold("edit");
  for (const gain of [1.1, 1.2, 1.3]) await page.field("How far it moves").enter(gain);
  await send();
  assert.equal(page.limb("left arm").gain, 1.3);
  await send();
  assert.deepEqual(edited(page).map(({ limb }) => limb?.[2]?.gain), [1.1, 1.3]);
  assert.deepEqual(page.state.busy, []);
});

test("a refused edit leaves the puppet as it was and says why; the server's own version of an edit is taken", async () => {
  const page = await Page.open((server) => server.refuse("edit", "a limb inside out"));
  await page.line("hump").click();
  await page.field("How far it moves").enter(3);
  assert.deepEqual(page.puppet, PUPPET);
  assert.ok(page.text.includes("the request: found a limb inside out; expected something else. Choose it."));
  assert.ok(page.button("Redo").disabled);
  await page.button("Dismiss").click();
  assert.equal(page.state.notice, null);
  page.server.on("edit", ({ puppet }) => ({ character: NAME, saved: false, plan: null, puppet: { ...(puppet as Puppet), handle: [{ name: "hump", position: [0, 1, -0.9] }] } }));
  await page.field("Place, z").enter(-5);
  assert.deepEqual(page.handle("hump").position, [0, 1, -0.9]);
});

test("an edit of another window is shown and can be undone; characters that are closed elsewhere go", async () => {
  const page = await Page.open();
  const other = { ...PUPPET, retarget: { mirror: true } };
  page.server.open(NAME, other);
  await page.press("");
  assert.deepEqual(page.puppet, other);
  await page.button("Undo").click();
  assert.deepEqual(page.puppet, PUPPET);
  page.server.change({ characters: [] });
  assert.equal(page.state.character, null);
  assert.ok(page.text.includes("Choose a character, and it moves as you do."));
});

test("name, motion, gain, parent and joints of a limb are changed, and only to what is valid", async () => {
  const page = await Page.open();
  await page.line("left arm").click();
  await page.field("Name").enter("head");
  await page.field("Name").enter("  ");
  await page.field("How far it moves").enter(200);
  assert.deepEqual(edited(page), []);
  await page.field("Name").enter("left flipper");
  await page.field("It copies").choose("how far you turn");
  await page.field("Grows out of").choose("head");
  await page.field("Your joint for point 1").choose("spine");
  const { points } = page.limb("left flipper");
  assert.deepEqual(page.limb("left flipper"), { name: "left flipper", points, joints: ["spine", "elbow_left", "wrist_left", "hand_left"], follow: "turn", parent: "head" });
  await page.field("Grows out of").choose("the body");
  assert.equal(page.limb("left flipper").parent, null);
  assert.deepEqual(page.state.selection, { kind: "limb", name: "left flipper" });
});

test("points of a limb are moved, added and removed, down to two", async () => {
  const page = await Page.open();
  await page.line("left arm").click();
  assert.deepEqual(page.buttons("Remove point"), []);
  await page.button("Point 2").click();
  await page.field("Place, y").enter(1.05);
  assert.deepEqual(page.limb("left arm").points[1], [2, 1.05, 0]);
  await page.button("Add point").click();
  assert.deepEqual(page.limb("left arm").points[2], [2.5, 1.025, 0]);
  assert.deepEqual(page.state.selection, { kind: "limb", name: "left arm", point: 2 });
  await page.button("Remove point").click();
  assert.equal(page.limb("left arm").points.length, 4);
  await page.button("Point 1").click();
  await page.press("Delete");
  assert.deepEqual(page.limb("left arm").points, [[2, 1.05, 0], [3, 1, 0], [4, 1, 0]]);
  await page.line("head").click();
  await page.button("Point 1").click();
  assert.deepEqual(page.buttons("Remove point"), []);
});

test("a limb is deleted, also by a key, and comes back as a copy of the other side", async () => {
  const page = await Page.open();
  await page.line("right arm").click();
  await page.button("Delete right arm").click();
  assert.deepEqual(page.puppet.limb?.map(({ name }) => name), ["trunk", "head", "left arm"]);
  await page.line("left arm").click();
  await page.button("Copy to other side").click();
  assert.deepEqual(page.limb("right arm"), { name: "right arm", points: [[-1, 1, 0], [-2, 1, 0], [-3, 1, 0], [-4, 1, 0]], joints: ["shoulder_right", "elbow_right", "wrist_right", "hand_right"] });
  assert.deepEqual(page.state.selection, { kind: "limb", name: "right arm" });
  await page.press("Backspace");
  assert.equal(page.puppet.limb.length, 3);
  await page.line("head").click();
  assert.ok(page.button("Copy to other side").disabled);
});

test("a handle is added by a click, mapped, limited to axes, moved and deleted", async () => {
  const page = await Page.open();
  await page.button("+ Handle").click();
  assert.ok(page.state.atRest);
  await page.click([0, 1, 0], [0, 1, 0.5]);
  assert.deepEqual([page.state.selection, page.state.tool], [{ kind: "handle", name: "handle" }, "select"]);
  await page.field("What moves it").choose("left hand");
  await page.field("up and down").check(false);
  await page.field("to the sides").check(false);
  await page.field("up and down").check(true);
  await page.field("How far it moves").enter(-2);
  await page.field("Place, x").enter(0.25);
  assert.deepEqual(page.handle("handle"), { name: "handle", position: [0.25, 1, 0.5], joint: "hand_left", axes: "yz", gain: -2 });
  await page.field("What moves it").choose("Nothing: stays in place");
  await page.button("‹ All limbs and handles").click();
  assert.deepEqual(page.line("handle").text, "handlestays in place");
  await page.line("handle").click();
  await page.press("Backspace");
  assert.deepEqual(page.puppet.handle, PUPPET.handle);
  await page.button("Undo").click();
  await page.line("handle").click();
  await page.button("Delete handle").click();
  assert.deepEqual(page.puppet.handle, PUPPET.handle);
});

test("a limb is added by clicking its points, and finished by a button or a key", async () => {
  const page = await Page.open();
  for (const finish of [() => page.button("Finish limb").click(), () => page.press("Enter")]) {
    await page.button("+ Limb").click();
    assert.ok(page.text.includes("Click where the limb leaves the body."));
    await page.click([0, 2, 0]);
    assert.ok(page.button("Finish limb").disabled);
    await page.press("Enter");
    await page.click([0, 3, 0]);
    await finish();
    assert.deepEqual(page.limb("limb"), { name: "limb", points: [[0, 2, 0], [0, 3, 0]], joints: ["shoulder_left", "hand_left"], follow: "turn" });
    assert.deepEqual([page.state.tool, page.state.selection], ["select", { kind: "limb", name: "limb" }]);
    await page.button("Undo").click();
    assert.deepEqual([page.puppet, page.state.selection], [PUPPET, null]);
  }
});

test("two clicks make a mouth that opens with the voice, as far as is entered", async () => {
  const page = await Page.open();
  await page.button("+ Mouth").click();
  assert.ok(page.text.includes("Click where the jaw begins"));
  await page.click([0.5, 1.5, 0], [3, 1.5, 0]);
  assert.ok(page.text.includes("Click the tip of the chin."));
  await page.click([0.5, 1.4, 0.5], [3, 1.4, 0.5]);
  await page.field("Opens with the voice, degrees").enter(35);
  assert.deepEqual(page.limb("jaw"), {
    name: "jaw", points: [[0, 1.5, 0], [0, 1.4, 0.5]], joints: ["shoulder_center", "head"], follow: "turn", gain: 0, parent: "head",
    bend: { channel: "voice", degrees: 35, axis: "x" },
  });
});

test("a tool is put back by Cancel, by Select and by Escape, with what was drawn", async () => {
  const page = await Page.open();
  for (const tool of ["+ Limb", "+ Handle", "+ Mouth"]) {
    for (const back of [() => page.button("Cancel").click(), () => page.button("Select").click(), () => page.press("Escape")]) {
      await page.button(tool).click();
      if (tool !== "+ Handle") await page.click([0, 1, 0]);
      await back();
      assert.deepEqual([page.state.tool, page.state.drawn], ["select", []], tool);
    }
  }
  assert.deepEqual(page.puppet, PUPPET);
});

test("the settings of the whole body, of walking and of the mesh's directions", async () => {
  const page = await Page.open();
  await page.button("Motion").click();
  await page.field("Like a mirror: your left moves its right").check(true);
  await page.field("Its hands meet when yours do").check(false);
  await page.field("Room under the arms").enter(11);
  await page.field("How far handles go: automatic").check(false);
  assert.equal(page.puppet.retarget?.scale, 1);
  await page.field("How far handles go").enter(1.5);
  assert.deepEqual(page.puppet.retarget, { mirror: true, hands_meet: false, arm_space: 11, scale: 1.5 });

  await page.field("It walks when you walk").check(true);
  assert.deepEqual(page.puppet.root, {});
  await page.field("It turns when you turn").check(false);
  await page.field("Feet stand on the floor").check(false);
  await page.field("Where it can walk").choose("everywhere, and jump");
  assert.deepEqual(page.puppet.root, { turns: false, feet: "free", axes: "xyz" });
  await page.field("It walks when you walk").check(false);
  assert.equal(page.puppet.root, null);

  assert.deepEqual(page.field("Which way does it look?").choices, ["+x", "−x", "+z", "−z"]);
  await page.field("Which way is up?").choose("+z");
  assert.deepEqual(page.puppet.character, { mesh: "figure.glb", up: "z", front: "y", scale: 1 });
  await page.field("Which way does it look?").choose("−x");
  await page.field("Which way is up?").choose("+x");
  assert.deepEqual(page.puppet.character, { mesh: "figure.glb", up: "x", front: "z", scale: 1 });
  await page.field("Which way is up?").choose("−x");
  assert.deepEqual(page.puppet.character, { mesh: "figure.glb", up: "-x", front: "z", scale: 1 });
});

test("another body plan is asked for, and applied as an edit that can be undone", async () => {
  const legless = { ...PUPPET, limb: PUPPET.limb?.slice(0, 2) };
  const page = await Page.open((server) => server.on("change_plan", () => ({ character: NAME, puppet: legless, saved: true, plan: "no legs" })));
  await page.button("Motion").click();
  assert.equal(page.field("Kind of body").choices[0], "my own");
  await page.field("Kind of body").choose("No legs: a snake, a fish, a ghost");
  assert.deepEqual(page.server.asked("change_plan"), [{ character: NAME, plan: "no legs" }]);
  assert.deepEqual(edited(page), [legless]);
  await page.button("Undo").click();
  assert.deepEqual(page.puppet, PUPPET);
});

test("a preset of smoothing and its sliders; the plot shows what they do to a test signal, or to a joint that moves", async () => {
  const page = await Page.open();
  await page.button("Motion").click();
  await page.press("");
  const previews = (): object[] => page.server.asked("smoothing_preview");
  const before = previews().length;
  await page.field("How smooth?").choose("Very smooth, a little late");
  assert.equal(page.puppet.smoothing?.alpha, 0.3);
  assert.deepEqual(previews().slice(before), [page.puppet.smoothing]);
  assert.ok(page.text.includes("1.0 mm of 5 mm jitter left60 ms lag"));
  const values = { "Response": ["alpha", 0.95], "Trend": ["gamma", 0.35], "Jitter radius, m": ["jitter_radius", 0.03], "Deviation, m": ["max_deviation", 0.07], "Prediction, frames": ["prediction", 0.4] } as const;
  for (const [label, [, value]] of Object.entries(values)) await page.field(label).enter(value);
  assert.deepEqual(page.puppet.smoothing, Object.fromEntries(Object.values(values)));
  assert.equal(page.field("How smooth?").value, "custom");

  await page.field("Plot of").choose("live: left hand, the last 3 seconds");
  assert.deepEqual(previews().at(-1), { ...page.puppet.smoothing, joint: "hand_left", character: NAME });
  assert.ok(String(page.every("svg", "plot")[0]?.is("aria-label")).includes("the left hand in the last seconds"));
  page.server.refuse("smoothing_preview", "no performer");
  await page.field("Plot of").choose("live: head, the last 3 seconds");
  assert.ok(page.text.includes("No performer moves this joint now."));
  await page.field("Plot of").choose("a test signal: at rest, then a step");
  assert.equal(page.state.plotted, null);
});

test("characters are shown in turn, opened, closed and saved", async () => {
  const page = await Page.open((server) => {
    server.on("save_puppet", () => ({ character: NAME, name: "figure.toml", file: "file-1" }));
    server.open("dog", PUPPET, { title: "dog.glb", notes: ["It stands on four legs."] });
  });
  assert.equal(page.state.character, "dog");
  assert.ok(page.text.includes("It stands on four legs."));
  await page.field("Character").choose(NAME);
  await page.line("head").click();
  await page.button("Save the character").click();
  await page.press("s", { ctrlKey: true, target: typing() });
  assert.deepEqual(page.server.asked("save_puppet"), [{ character: NAME }, { character: NAME }]);
  await page.field("Character").choose("Open another…");
  await page.button("Back").click();
  await page.button(`Close ${NAME}`).click();
  assert.deepEqual(page.server.asked("close_character"), [{ character: NAME }]);
  await page.field("Character").choose("Open another…");
  page.server.on("open_example", () => {
    page.server.open("pegasus", PUPPET);
    return { character: "pegasus" };
  });
  await page.button("Winged horse").click();
  assert.deepEqual(page.server.asked("open_example"), [{ name: "pegasus" }]);
  assert.deepEqual([page.state.character, page.state.adding], ["pegasus", false]);
});

test("tabs are changed by arrow keys, and the pose, the bones and the drawers by their buttons", async () => {
  const page = await Page.open();
  await page.button("Limbs").press("ArrowRight");
  assert.equal(page.state.tab, "motion");
  await page.button("Limbs").press("ArrowLeft");
  assert.equal(page.state.tab, "takes");
  await page.button("Rest pose").click();
  assert.ok(page.state.atRest);
  await page.button("Live").click();
  assert.ok(!page.state.atRest);
  await page.field("Bones").check(false);
  await page.button("+ Limb").click();
  assert.ok(page.state.bones);
  await page.button("Performer").click();
  assert.equal(page.state.drawer, "left");
  await page.button("Performer").click();
  assert.equal(page.state.drawer, null);
});

test("a service that was started elsewhere chooses its characters and sources, and the page edits their puppets", async () => {
  const page = await Page.open((server) => {
    server.greeting = { ...server.greeting, joined: true };
  }, "film");
  for (const name of ["Film", "Open another…", "Change…", "Export", "Play", "Make the film", `Close ${NAME}`]) assert.deepEqual(page.buttons(name), [], name);
  assert.deepEqual(page.field("Character").choices, [NAME]);
  await page.line("hump").click();
  assert.ok(!page.field("Place, x").disabled);
  await page.field("What moves it").choose("head");
  assert.equal(page.handle("hump").joint, "head");
  await page.button("‹ All limbs and handles").click();
  await page.line("head").click();
  assert.ok(!page.field("How far it moves").disabled);
  await page.button("Motion").click();
  assert.ok(!page.field("How smooth?").disabled);
  assert.ok(page.every("button", "meter").every(({ disabled }) => !disabled));
  await page.button("Takes").click();
  assert.ok(page.text.includes("Takes are in the folder of the service"));
});
