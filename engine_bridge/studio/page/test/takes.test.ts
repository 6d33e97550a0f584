import assert from "node:assert/strict";
import test from "node:test";

import type { Timeline } from "../src/messages";
import { editScene, position } from "../src/film";
import { EMPTY, filmOf } from "../src/model/film";
import { update } from "../src/store";
import { pass } from "./clock";
import { Page, saved, typing } from "./page";
import { FILM, NAME, clip, take } from "./server";

const TIMELINE: Timeline = { position: 1, moment: 0, start: 0, end: 8, speed: 2, paused: false, loop: false, takes: [] };

test("a recording plays from one second to another, in a loop or once, and is exported in a format", async () => {
  const page = await Page.open((server) => {
    server.on("export", () => ({ job: "job-1", file: "file-1", name: "figure.glb", text: "120 frames of a new skeleton", numbers: {} }));
    server.change({ takes: [take("take-1")], uploads: [{ upload: "id-1", name: "two.log", kind: "log", bytes: 9, ...{ facts: {} } }] });
  });
  await page.button("Takes").click();
  assert.ok(page.text.includes("Select a take to play, trim or export it."));
  await page.line("Take 1, 4 seconds").click();
  await page.field("From second").enter(0.5);
  await page.field("From second").enter(5);
  await page.field("To second").enter(1.5);
  await page.button("Use as the performer").click();
  await page.field("Loop").check(false);
  await page.button("Use as the performer").click();
  assert.deepEqual(page.server.asked("source"), [true, false].map((loop) => ({ take: "take-1", loop, start: 0.5, stop: 1.5 })));
  await page.button("Limbs").click();
  await page.button("Change…").click();
  await page.button("Walk").click(); // all of it, in a loop
  assert.deepEqual(page.server.asked("source").at(-1), { example: "walk", loop: true, start: null, stop: null });
  await page.button("Takes").click();
  await page.button("Export").click();
  assert.ok(page.text.includes("120 frames of a new skeleton"));
  await page.button("Download figure.glb").click();
  assert.equal(saved.at(-1)?.name, "figure.glb");
  await page.line("Trot and rear").click();
  await page.field("Format").choose("Morph targets: plays everywhere");
  await page.button("Export").click();
  assert.deepEqual(page.server.asked("export"), [
    { character: NAME, take: "take-1", form: null, start: 0.5, stop: 1.5 },
    { character: NAME, example: "rear", form: "morph", start: null, stop: null },
  ]);
});

test("takes and recordings are deleted, unless the server refuses it", async () => {
  const page = await Page.open((server) => {
    server.refuse("delete_upload", "a recording that is playing now");
    server.change({ takes: [take("take-1")], uploads: [{ upload: "id-1", name: "two.log", kind: "log", bytes: 9, ...{ facts: {} } }] });
  });
  await page.button("Takes").click();
  await page.line("Take 1, 4 seconds").click();
  await page.button("Delete Take 1 for ever").click();
  assert.deepEqual(page.server.asked("delete_take"), [{ take: "take-1" }]);
  await page.line("two.log").click();
  await page.button("Delete recording two.log").click();
  assert.deepEqual(page.server.asked("delete_upload"), [{ upload: "id-1" }]);
  assert.ok(page.text.includes("found a recording that is playing now"));
});

test("long work shows its steps, and is cancelled", async () => {
  const page = await Page.open((server) => server.refuse("export", "a job that was cancelled"));
  await page.button("Takes").click();
  await page.line("Kung fu").click();
  page.server.change({ jobs: [{ job: "job-1", title: "Export of kung_fu", text: "Reading", fraction: 0, state: "running", result: null, error: null }] });
  const [before] = page.every("progress");
  assert.equal(before?.value, null);
  page.server.send({ event: "progress", job: "job-1", text: "Writing", fraction: 0.5 });
  await pass(1);
  assert.ok(page.text.includes("Writing"));
  assert.equal(page.every("progress")[0]?.value, "0.5");
  await page.button("Cancel: Export of kung_fu").click();
  assert.deepEqual(page.server.asked("cancel"), [{ job: "job-1" }]);
  await page.button("Export").click();
  assert.ok(page.text.includes("found a job that was cancelled"));
  assert.equal(page.state.exported, null);
});

test("a take is recorded after a count of three, by a button or a key, and stopped before or after it has begun", async () => {
  const page = await Page.open((server) => server.on("record_stop", () => ({ name: "take-1" })));
  await page.button("Record").click();
  assert.deepEqual(page.server.asked("record_start"), [{ count_in: 3, character: NAME }]);
  for (const left of [3, 2, 1]) {
    assert.equal(page.state.count, left);
    await pass(1000);
  }
  assert.ok(page.text.includes("Action!"));
  await pass(700);
  assert.equal(page.state.count, null);
  page.server.change({ recording: "take-1" });
  assert.ok(page.button("Microphone").disabled);
  await page.press("r");
  assert.deepEqual([page.state.tab, page.state.recording], ["takes", { kind: "take", name: "take-1" }]);
  page.server.change({ recording: null });
  page.server.on("record_stop", () => ({}));
  for (const key of ["r", "R"]) await page.press(key);
  assert.equal(page.state.count, null);
  await pass(5000);
  assert.equal(page.state.count, null);
  for (const more of [{ target: typing() }, { ctrlKey: true }]) await page.press("r", more);
  assert.deepEqual([page.server.asked("record_start").length, page.server.asked("record_stop").length], [2, 2]);
});

test("a take of the film is moved, muted and deleted by keys and buttons, and each is undone", async () => {
  const page = await Page.open((server) => {
    server.change({ takes: [take("take-1"), take("take-2")], film: { ...FILM, takes: [clip("take-1", 0), clip("take-2", 4)] } });
  });
  const starts = (): unknown[] => [page.state.film.present.takes, page.server.state.film.takes].map((takes) => takes.map(({ at, mute }) => [at, mute]));
  const both = (...expected: unknown[]): void => {
    assert.deepEqual(starts(), [expected, expected]);
  };
  const clips = () => page.every("button", "clip-button");
  await clips()[1]?.press("ArrowLeft");
  both([0, false], [3.9, false]);
  const keys = page.every("div", "clip").map((each) => each.is("key"));
  await clips()[0]?.click();
  await page.button("Mute").click();
  both([0, true], [3.9, false]);
  assert.deepEqual(page.every("div", "clip").map((each) => each.is("key")), keys);
  assert.ok(String(clips()[0]?.is("aria-label")).includes("muted"));
  await clips()[1]?.press("Delete");
  both([0, true]);
  assert.ok(page.button("Make the film").disabled);
  for (const expected of [[[0, true], [3.9, false]], [[0, false], [3.9, false]], [[0, false], [4, false]]]) {
    await page.press("z", { ctrlKey: true });
    both(...expected);
  }
  await page.button("Redo").click();
  both([0, false], [3.9, false]);
  await clips()[1]?.click();
  update({ face: "film" });
  await page.press("ArrowRight", { repeat: true });
  both([0, false], [3.9, false]);
  await page.press("ArrowRight");
  both([0, false], [4, false]);
  update({ asking: "film" });
  await page.press("Delete");
  both([0, false], [4, false]);
  await page.press("Escape");
  await clips()[1]?.click();
  await page.press("Delete");
  both([0, false]);
  update({ face: "workshop" });
  await page.button("Takes").click();
  await page.line("Take 2, 4 seconds").click();
  await page.button("Add to the film").click();
  both([0, false], [4, false]);
});

test("a take that was recorded is a step of the film that can be undone, and a refused edit changes nothing", async () => {
  const page = await Page.open();
  page.server.change({ film: { ...FILM, takes: [clip("take-1", 0)] } });
  await page.press("r");
  page.server.on("record_stop", () => ({ name: "take-1" }));
  page.server.change({ recording: "take-1" });
  await page.press("r");
  page.server.change({ recording: null });
  await page.press("z", { ctrlKey: true });
  assert.deepEqual(page.server.asked("edit_film"), [{ takes: [] }]);
  await page.press("y", { ctrlKey: true });
  assert.deepEqual(page.server.asked("edit_film").at(-1), { takes: [clip("take-1", 0)] });
  page.server.refuse("edit_film", "the file");
  await page.every("button", "clip-button")[0]?.press("ArrowRight");
  assert.deepEqual(page.state.film.present.takes, [clip("take-1", 0)]);
  await page.press("z", { ctrlKey: true });
  assert.deepEqual(page.state.film.past, [], "the refused edit is no step");
});

test("an edit of the scene keeps a take that is recorded while it is applied, and later edits follow it", async () => {
  const page = await Page.open();
  const next = page.server.hold("edit_film");
  const music = (loop: "calm" | "waltz"): void => {
    editScene({ music: { loop } });
  };
  music("calm");
  music("waltz");
  page.server.change({ film: { ...FILM, takes: [clip("take-1", 0)] } });
  await next();
  await next();
  assert.deepEqual(page.server.asked("edit_film").map((each) => Object.keys(each)), [["scene"], ["scene"]]);
  assert.deepEqual(page.state.film.present, { takes: [clip("take-1", 0)], scene: { ...EMPTY.scene, music: { loop: "waltz" } } });
  assert.deepEqual(filmOf(page.server.state.film), page.state.film.present);
});

test("after a character was removed, no step brings its takes back", async () => {
  const page = await Page.open((server) => {
    server.change({ film: { ...FILM, takes: [clip("take-1", 0)] } });
  });
  editScene({ music: { loop: "calm" } });
  await pass(0);
  page.server.change({ characters: [], film: FILM });
  assert.deepEqual([page.state.film.past, page.state.film.present.takes], [[], []]);
  await page.press("z", { ctrlKey: true });
  assert.deepEqual(page.state.film.present, EMPTY);
});

test("the film plays from the playhead on, pauses, jumps, and stops", async () => {
  const page = await Page.open((server) => {
    server.change({ film: { ...FILM, takes: [clip("take-1", 0)], problem: "The file is damaged." } });
  });
  assert.ok(page.text.includes("The file is damaged."));
  await page.button("Play").click();
  assert.deepEqual(page.server.asked("play_film"), [{ at: 0 }]);
  page.server.change({ timeline: TIMELINE });
  assert.equal(page.button("Pause").is("class"), "pause");
  await pass(1500);
  assert.equal(position(page.state), 4);
  await pass(15_000);
  assert.equal(position(page.state), 8);
  await page.press(" ");
  page.server.change({ timeline: { ...TIMELINE, paused: true } });
  await pass(1500);
  assert.equal(position(page.state), 1);
  await page.press(" ");
  assert.deepEqual(page.server.asked("pause"), [{ on: true }, { on: false }]);
  const track = {};
  const event = { target: track, currentTarget: Object.assign(track, { getBoundingClientRect: () => ({ left: 100, width: 600 }) }), clientX: 200 };
  (page.every("div", "track")[0]?.is("onpointerdown") as (event: object) => void)(event);
  assert.deepEqual(page.server.asked("seek"), [{ seconds: 2 }]);
  await page.button("Stop").click();
  assert.deepEqual(page.server.asked("stop"), [{}]);
  page.server.change({ timeline: null });
  assert.equal(position(page.state), 2);
});

test("a film is made, shown and saved; what that needs is installed if the user wants it", async () => {
  const page = await Page.open((server) => {
    server.on("make_film", () => ({ file: "file-9", name: "film.mp4", seconds: 4, notes: ["Take 1 is short."] }));
    server.change({ film: { ...FILM, takes: [clip("take-1", 0)] }, installed: [] });
  });
  await page.button("Make the film").click();
  assert.ok(page.text.includes("Make films?"));
  await page.press("Escape");
  await page.button("Make the film").click();
  page.server.on("install", () => {
    page.server.change({ installed: ["film"] });
    return {};
  });
  await page.button("Yes, get it").click();
  assert.deepEqual(page.server.asked("install"), [{ extra: "film" }]);
  assert.ok(page.text.includes("Take 1 is short."));
  await page.button("Save the film").click();
  assert.equal(saved.at(-1)?.name, "film.mp4");
  page.server.on("share_film", () => ({ address: "http://192.168.1.5:7482/K7M2QX", code: "PHN2Zy8+", poster: "file-10", poster_name: "film.jpg" }));
  await page.button("Show it on a phone").click();
  assert.deepEqual(page.server.asked("share_film"), [{ file: "file-9" }]);
  assert.equal(page.every("a").find((each) => each.text.includes("K7M2QX"))?.is("href"), "http://192.168.1.5:7482/K7M2QX");
  await page.button("Save a poster").click();
  assert.equal(saved.at(-1)?.name, "film.jpg");
  await page.press("Escape");
  assert.equal(page.state.made, null);
});

test("the microphone is switched on and off, and installed first if it must be", async () => {
  const page = await Page.open((server) => {
    server.change({ installed: [] });
  });
  await page.button("Microphone").click();
  assert.ok(page.text.includes("Use the microphone?"));
  page.server.change({ installed: ["sound"] });
  await page.button("Yes, get it").click();
  page.server.change({ microphone: true });
  assert.equal(page.button("Microphone").is("aria-pressed"), "true");
  await page.button("Microphone").click();
  assert.deepEqual(page.server.asked("microphone"), [{ on: true }, { on: false }]);
});
