import assert from "node:assert/strict";
import test from "node:test";

import { chooseFace, rememberedFace } from "../src/face";
import { recordedSeconds } from "../src/film";
import type { FilmCharacter } from "../src/messages";
import { EMPTY } from "../src/model/film";
import { withItem } from "../src/model/rows";
import { titleOf } from "../src/model/scene";
import { strings } from "../src/strings";
import { pass } from "./clock";
import { Page, chooser, typing } from "./page";
import { FILM, NAME, PUPPET, clip, take } from "./server";

const ROW: FilmCharacter = { name: NAME, puppet: "live.toml" };

const film = (prepare: (page: Parameters<NonNullable<Parameters<typeof Page.open>[0]>>[0]) => void = () => undefined): Promise<Page> =>
  Page.open((server) => {
    server.change({ film: { ...FILM, scene: { ...EMPTY.scene, character: [ROW] } } });
    prepare(server);
  }, "film");

test("the film has none of the workshop's controls, a click changes the face, and the browser remembers it", async () => {
  const page = await film();
  const { viewer, performer, limbs, motion, takes, status } = strings;
  for (const word of [viewer.addHandle, viewer.addLimb, viewer.bones, performer.calibrate, limbs.tab, motion.tab, takes.form, takes.forms[""] ?? "", "vertices", "frames per second", status.fps(30)]) {
    assert.ok(!page.text.includes(word), word);
  }
  await page.button("Workshop").click();
  assert.ok(page.text.includes("8 vertices"));
  assert.equal(rememberedFace(), "workshop");
  chooseFace("film");
  assert.deepEqual([page.state.face, rememberedFace()], ["film", "film"]);
});

test("each control of the scene changes a table of the scene file, and is undone by itself", async () => {
  const page = await film();
  const scene = () => page.server.state.film.scene;
  const steps: [() => Promise<void>, object][] = [
    [() => page.button("Snow").click(), { background: { set: "snow" } }],
    [() => page.field("Light").choose("Warm evening"), { light: { mood: "evening" } }],
    [() => page.button("Waltz").click(), { music: { file: null, loop: "waltz" } }],
    [() => page.field("How loud").enter(-20), { music: { file: null, loop: "waltz", gain: -20 } }],
    [() => page.field("What is your film called?").enter("The ghost"), { title: [{ text: "The ghost", at: 0, place: "top" }] }],
    [() => page.field("Letters").choose("Poster"), { title: [{ text: "The ghost", at: 0, place: "top", font: "poster" }] }],
    [() => page.field("Begin and end in the dark").check(true), { film: { fade_in: 1, fade_out: 1 } }],
    [() => page.field("What does Figure say at the red line?").enter("Boo!"), { bubble: [{ character: NAME, text: "Boo!", at: 0 }] }],
    [() => page.button("Add a shot at the red line").click(), { camera: [{ at: 0 }] }],
    [() => page.field("Shows").choose("Figure"), { camera: [{ at: 0, show: [NAME] }] }],
    [() => page.button("Add a shot at the red line").click(), { camera: [{ at: 0, show: [NAME] }, { at: 1, shot: "follow", show: [NAME] }] }],
  ];
  const before = [scene()];
  for (const [act, change] of steps) {
    await act();
    assert.deepEqual(scene(), { ...before.at(-1), ...change });
    before.push(scene());
  }
  await page.button("Delete: Shot 1").click();
  assert.deepEqual(scene().camera.map(({ at }) => at), [1]);
  for (const earlier of before.toReversed()) {
    await page.press("z", { ctrlKey: true });
    assert.deepEqual(scene(), earlier);
  }
});

test("a character's size and place follow the slider, are sent when it is released, and its colour and name are chosen", async () => {
  const page = await film();
  await page.button("Character").click();
  const row = () => page.server.state.film.scene.character[0];
  const size = page.field("How tall");
  assert.equal(size.value, "1"); // it is 2 m tall: 2 to the power of 1
  (size.is("oninput") as (event: object) => void)({ target: { valueAsNumber: 2 } });
  await pass(1);
  assert.deepEqual([page.state.draft, row()], [{ name: NAME, height: 4 }, ROW]);
  await page.field("How tall").enter(2);
  await page.field("Left, right").enter(1.5);
  await page.field("Back, front").enter(-2);
  await page.field("Turned").enter(90);
  await page.button("Green").click();
  assert.deepEqual([page.state.draft, row()], [null, { ...ROW, height: 4, position: [1.5, -2], turn: 90, color: "#b9efb0" }]);
  await page.field("Show its name in the film").check(true);
  await page.field("Name").enter("Rex");
  assert.deepEqual(page.server.state.film.scene.bubble.map(({ kind, text, character }) => [kind, text, character]), [["name", "Rex", NAME]]);
  await page.button("Remove Figure").click();
  assert.deepEqual(page.server.asked("close_character"), [{ character: NAME }]);
});

test("a picture and music of one's own are uploaded, and become part of the film", async () => {
  const page = await film();
  for (const [button, file] of [["My own picture…", "park.png"], ["My own…", "song.mp3"]] as const) {
    await page.button(button).click();
    assert.equal(chooser.accept, file.endsWith("png") ? ".png" : ".mp3");
    chooser.files = [new File([""], file)];
    chooser.onchange();
    await pass(1);
  }
  const { background, music } = page.server.state.film.scene;
  assert.deepEqual([background.picture, music.file, music.loop], ["media/park.png", "media/song.mp3", null]);
});

test("characters are chosen by their cards; one without a take is said, and a take that is being made is not filmed", async () => {
  const page = await film((server) => {
    server.open("dog", PUPPET, { title: "my_dog.glb" });
    server.change({ takes: [take("take-1")], film: { ...FILM, takes: [clip("take-1", 0)] } });
  });
  const card = (text: string) => page.every("button", "card").find((each) => each.text.startsWith(text)) ?? assert.fail(text);
  assert.equal(card("Figure").text, "Figure1 recording");
  assert.equal(card("My dog").text, "My dognothing recorded yet");
  assert.ok(page.text.includes("My dog has nothing recorded yet, and stands still in the film."));
  await card("My dog").click();
  assert.equal(page.state.character, "dog");
  await page.press("r");
  assert.ok(page.button("Make the film").disabled);
  await pass(3700);
  assert.deepEqual(page.every("div", "recording-frame"), []);
  page.server.change({ recording: "take-2" });
  assert.equal(page.every("div", "recording-frame").length, 1);
  assert.equal(page.every("div", "growing").length, 1);
  assert.ok(!page.text.includes("My dog has nothing recorded yet, and"));
  for (const name of ["Make the film", "Play"]) assert.ok(page.button(name).disabled, name);
  await page.press(" ");
  assert.deepEqual(page.server.asked("play_film"), []);
  await pass(2000);
  assert.equal(recordedSeconds(page.state), 2.7); // since the clapper
  await page.press("r");
  page.server.change({ recording: null });
  assert.deepEqual([page.every("div", "recording-frame").length, page.state.recordedFrom], [0, null]);
  const stage = { name: "stage", source: "demo:walk", rate: 30, refused: {}, recording: "take-3" };
  for (const count_in of [2, 0]) page.server.change({ recording: "take-3", stages: [{ ...stage, count_in }] }); // of another window
  await pass(1000);
  assert.equal(recordedSeconds(page.state), 1);
});

test("a question mark shows the keys, Escape closes them, and neither does anything in a field", async () => {
  const page = await film();
  await page.press("?", { target: typing() });
  assert.ok(!page.state.help);
  await page.press("?");
  assert.ok(page.text.includes("Begin to record, and stop"));
  await page.press("Escape");
  assert.ok(!page.state.help);
});

test("names of files become names for people, and rows stay in the order of their times", () => {
  assert.deepEqual([["dog", ""], ["red_fox-2", "red_fox.glb"], ["x", "Rex.toml"], ["pegasus", "pegasus (example)"]].map(([name, title]) => titleOf(name ?? "", title ?? "")), ["Dog", "Red fox 2", "Rex", "Winged horse"]);
  const rows = [{ at: 1 }, { at: 3 }];
  assert.deepEqual(withItem(rows, 2, { at: 2 }), [{ at: 1 }, { at: 2 }, { at: 3 }]);
  assert.deepEqual(withItem(rows, 0, { at: 4 }), [{ at: 3 }, { at: 4 }]);
  assert.deepEqual(withItem(rows, 1, null), [{ at: 1 }]);
});

test("a row keeps its key while it is edited, wherever its time puts it, and after the server has answered", async () => {
  const page = await film();
  const keys = (): unknown[] => page.every("div", "entry").map((each) => each.is("key"));
  await page.field(strings.scene.firstTitle).enter("One");
  await page.field(strings.scene.newTitle).enter("Two");
  const [one, two] = keys();
  assert.notEqual(one, two);
  await page.within(page.every("div", "entry")[0] ?? page.button("Film")).find((each) => each.is("type") === "number")?.enter(9);
  assert.deepEqual(page.server.state.film.scene.title.map(({ text }) => text), ["Two", "One"]);
  await pass(0);
  assert.deepEqual(keys(), [two, one]);
  page.server.change({ film: { ...page.server.state.film, scene: structuredClone(page.server.state.film.scene), problem: "" } });
  assert.deepEqual(keys(), [two, one]);
  await page.press("z", { ctrlKey: true });
  assert.deepEqual(keys(), [one, two]);
});

test("keys of the page rest behind a dialog", async () => {
  const page = await film();
  await page.press("?");
  for (const key of ["r", " ", "Delete"]) await page.press(key);
  await page.press("z", { ctrlKey: true });
  assert.deepEqual(page.server.requests.filter(({ do: what }) => what !== "puppet"), []);
  assert.ok(page.state.help);
  await page.press("Escape");
  assert.ok(!page.state.help);
  await page.press("?");
  await page.press("?");
  assert.ok(!page.state.help);
});
