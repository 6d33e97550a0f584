import assert from "node:assert/strict";
import test from "node:test";

import { openFiles } from "../src/files";
import { pass } from "./clock";
import { Page, chooser } from "./page";

const SOURCES = {
  characters: [], examples: ["walk", "rear"],
  devices: [
    { name: "/dev/video0", ok: true, detail: "a camera", fix: "", uri: "camera:0" },
    { name: "Kinect", ok: true, detail: "a Kinect", fix: "", uri: "freenect:" },
    { name: "OpenNI2", ok: false, detail: "is missing", fix: "Install it.", uri: "" },
  ],
  ports: [{ uri: "osc:7110", text: "OSC", arriving: 2, rate: 30, refused: { "a size": 1 }, problem: "" }, { uri: "vmc:39539", text: "VMC", arriving: 0, rate: 0, refused: {}, problem: "" }],
};

const upload = (id: string, name: string) => ({ upload: id, name, kind: "log" as const, bytes: 9, facts: {} });

test("examples, recordings, sensors and ports are listed, and the one that is chosen performs", async () => {
  const page = await Page.open((server) => {
    server.on("sources", () => SOURCES).change({ uploads: [upload("id-1", "two.log")] });
  });
  for (const [name, source] of [
    ["Use my webcam", { uri: "camera:0" }],
    ["Use my Kinect", { uri: "freenect:" }],
    ["Use osc:7110", { uri: "osc:7110" }],
    ["Use /dev/video0", { uri: "camera:0" }],
    ["Trot and rear", { example: "rear", loop: true, start: null, stop: null }],
    ["two.log", { upload: "id-1", loop: true, start: null, stop: null }],
  ] as const) {
    await page.button("Change…").click();
    await page.button(name).click();
    assert.deepEqual(page.server.asked("source").at(-1), source, name);
    assert.ok(!page.state.choosing);
  }
  await page.button("Change…").click();
  for (const text of ["2 performers, 30 per second. 1 packet not understood: a size", "Nothing arrives", "is missing Install it."]) assert.ok(page.text.includes(text), text);
  const sent = page.server.hold("sources");
  await page.button("Look again").click();
  assert.ok(page.text.includes("Looking for sensors and listening to ports…"));
  await sent();
  await page.button("‹ Back to the figure").click();
  assert.equal(page.every("g", "joint").length, 20);
});

test("without a webcam or the program that it needs, the page says so, and installs it if it may", async () => {
  const page = await Page.open((server) => {
    server.change({ installed: [] });
  });
  await page.button("Change…").click();
  await page.button("Use my webcam").click();
  await page.button("Not now").click();
  assert.deepEqual(page.server.asked("install"), []);
  page.server.on("install", () => {
    page.server.change({ installed: ["camera"] });
    return {};
  });
  await page.button("Use my webcam").click();
  await page.button("Yes, get it").click();
  assert.deepEqual(page.server.asked("install"), [{ extra: "camera" }]);
  await pass(1);
  assert.ok(page.text.includes("No webcam was found."));
  await page.button("Use my Kinect").click();
  assert.ok(page.text.includes("No Kinect was found."));
  assert.deepEqual(page.server.asked("source"), []);
  page.server.on("sources", () => SOURCES);
  await page.field("My face and my hands too").check(true);
  await page.button("Use my webcam").click();
  assert.deepEqual(page.server.asked("source"), [{ uri: "camera:0?face&hands" }]);
});

test("without a source, the page offers the example that walks, and nothing is recorded", async () => {
  const page = await Page.open((server) => {
    server.change({ source: { ...server.state.source, kind: "none", name: "" } });
  });
  assert.ok(page.button("Record").disabled);
  await page.press("r");
  assert.deepEqual(page.server.asked("record_start"), []);
  await page.button("Use Walk").click();
  assert.deepEqual(page.server.asked("source"), [{ example: "walk", loop: true, start: null, stop: null }]);
});

test("files that are chosen or dropped become a character or the performer, and a puppet file finds its mesh", async () => {
  const page = await Page.open((server) => {
    for (const what of ["open_character", "open_puppet"]) server.on(what, () => ({ character: "figure" }));
  });
  const asked = (): unknown[] => page.server.requests.filter((each) => each.do.startsWith("open_") || each.do === "source").map((each) => [each.do, each.upload]);
  await openFiles([new File([""], "dog.toml"), new File([""], "dog.glb")]);
  assert.deepEqual(page.server.uploads, ["dog.glb", "dog.toml"]);
  await openFiles([new File([""], "horse.glb")]);
  await page.button("Change…").click();
  await page.button("Open a video or recording…").click();
  assert.equal(chooser.accept, ".log,.mp4");
  chooser.files = [new File([""], "walk.log")];
  chooser.onchange();
  await pass(1);
  assert.deepEqual(asked(), [["open_puppet", "id-of-dog"], ["open_character", "id-of-horse"], ["source", "id-of-walk"]]);
  await openFiles([new File([""], "dance.mp4"), new File([""], "song.mp3"), new File([""], "beach.png")]);
  assert.deepEqual(asked().at(-1), ["source", "id-of-dance"]);
  const { music, background } = page.server.state.film.scene;
  assert.deepEqual([music, background], [{ file: "media/song.mp3" }, { picture: "media/beach.png" }]);
});

test("performers in view are told, chosen, and calibrated", async () => {
  const performer = (user: number, character: string | null) => ({ user, stage: "stage", state: "performing", character, distance: 2, height: 1.8 });
  const page = await Page.open((server) => {
    server.change({ performers: [performer(1, "figure"), performer(2, null), { ...performer(3, null), stage: "another" }] });
  });
  assert.deepEqual(page.buttons("Choose performer 1").length + page.buttons("Choose performer 3").length, 0);
  assert.ok(page.text.includes("Performer 2: performing"));
  await page.button("Choose performer 2").click();
  await page.button("Choose the performer automatically").click();
  assert.deepEqual(page.server.asked("choose_user"), [{ character: "figure", user: 2 }, { character: "figure", user: null }]);
  page.server.change({ performers: [performer(1, "figure")] });
  assert.deepEqual(page.buttons("Choose the performer automatically"), []);
  await page.button("Start from this pose").click();
  assert.deepEqual(page.server.asked("calibrate"), [{ character: "figure" }]);
});

test("what the sensor sees is shown with its joints and problems, again and again until it is hidden", async () => {
  const joints = [...new Array<null>(18).fill(null), [0.5, 0.75], [0.25, 0.5]];
  const seen = { picture: "/9j/", width: 640, height: 480, problems: [], performers: [{ user: 1, text: "user 1: well", joints }] };
  const page = await Page.open((server) => server.on("look", () => seen));
  await page.button("Show what the sensor sees").click();
  const drawn = (tag: string, ...names: string[]): unknown[][] =>
    page.every(tag).map((each) => names.map((name) => each.is(name))).filter(([first]) => first !== undefined);
  assert.deepEqual(drawn("circle", "cx", "cy").slice(0, 2), [[320, 360], [160, 240]]);
  assert.deepEqual(drawn("line", "x1", "y1", "x2", "y2")[0], [320, 360, 160, 240]);
  assert.equal(page.every("img")[0]?.is("src"), "data:image/jpeg;base64,/9j/");
  for (const text of ["user 1: well", "No problems found."]) assert.ok(page.text.includes(text));
  page.server.on("look", () => ({ ...seen, picture: "", problems: [{ level: "warning", text: "It is dark.", fix: "Switch on a light." }] }));
  await pass(500);
  for (const text of ["This source has no images.", "It is dark. Switch on a light."]) assert.ok(page.text.includes(text));
  page.server.refuse("look", "no source");
  await pass(500);
  assert.ok(page.text.includes("found no source"));
  await page.button("Hide what the sensor sees").click();
  await pass(5000);
  assert.equal(page.server.asked("look").length, 3);
  assert.equal(page.state.look, null);
});
