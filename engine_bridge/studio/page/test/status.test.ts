import assert from "node:assert/strict";
import test from "node:test";

import { pass } from "./clock";
import { Page } from "./page";

test("a page whose connection is lost says so, and connects again with its session", async () => {
  const page = await Page.open((server) => server.hold("edit"));
  await page.line("head").click();
  await page.field("How far it moves").enter(2);
  page.server.end(1006);
  await pass(999);
  assert.ok(page.text.includes("The studio does not answer."));
  assert.deepEqual(page.state.busy, []);
  assert.deepEqual(page.every("span", "lamp").map((lamp) => lamp.is("class")), ["lamp starting"]);
  assert.ok(page.button("Record").disabled);
  await pass(1);
  assert.equal(page.state.connected, "open");
  assert.equal(page.server.tokens.at(-1), "session");
  assert.equal(page.limb("head").gain, undefined);
});

test("a session of a server that has ended is replaced by the token of the address, and without a valid one, the page says what to do", async () => {
  const page = await Page.open((server) => {
    server.refused.set("session", "a wrong token");
  });
  assert.deepEqual(page.server.tokens, ["session", "once"]);
  assert.equal(page.state.connected, "open");
  const other = await Page.open((server) => {
    for (const token of ["session", "once"]) server.refused.set(token, "a wrong token");
  });
  assert.equal(other.state.connected, "refused");
  assert.ok(other.text.includes("a wrong token Open the address that the terminal shows last"));
  await pass(5000);
  assert.deepEqual(other.server.tokens, ["session", "once"]);
});

test("what waits says for how long, and for how long still as soon as that can be told", async () => {
  const page = await Page.open((server) => server.hold("edit"));
  await page.line("head").click();
  await page.field("How far it moves").enter(2);
  assert.deepEqual(page.every("small", "waited"), []);
  await pass(4000);
  assert.equal(page.every("small", "waited")[0]?.text, "for 4 seconds");
  page.server.change({ jobs: [{ job: "job-1", title: "Making the film", text: "Drawing", fraction: 0, state: "running", result: null, error: null }] });
  page.server.send({ event: "progress", job: "job-1", text: "Drawing", fraction: 0.1 });
  await pass(10_000);
  page.server.send({ event: "progress", job: "job-1", text: "Drawing", fraction: 0.25 });
  assert.equal(page.every("small", "waited")[0]?.text, "about 30 seconds left");
});

test("another window gets an address of its own", async () => {
  const page = await Page.open((server) => server.on("invite", () => ({ address: "http://127.0.0.1:7480/#token=x" })));
  await page.button("Another window…").click();
  assert.ok(page.text.includes("once: http://127.0.0.1:7480/#token=x"));
});

test("the most important message is shown: the page's own, then the server's, but not twice on the empty page", async () => {
  const page = await Page.open();
  page.server.change({ banner: { level: "warning", text: "No performer is in view.", fix: "Stand in front of it." } });
  assert.ok(page.text.includes("No performer is in view. Stand in front of it."));
  page.server.refuse("calibrate", "no performer");
  await page.button("Start from this pose").click();
  assert.ok(page.text.includes("found no performer"));
  assert.ok(!page.text.includes("Stand in front of it."));
  page.server.change({ characters: [], banner: { level: "info", text: "No character is open.", fix: "" } });
  await page.button("Dismiss").click();
  assert.ok(!page.text.includes("No character is open."));
});

test("the line at the bottom says what the service does, in numbers", async () => {
  const page = await Page.open();
  for (const text of ["Ready", "30 frames per second", "30 images per second", "4.0 ms latency", "1 client", "0 dropped", "8 vertices"]) assert.ok(page.text.includes(text), text);
  page.server.change({ service: { running: false, starting: true, address: "", restarts: 1, problem: "", text: "" } });
  assert.ok(page.text.includes("Getting ready…"));
  assert.ok(!page.text.includes("dropped"));
  page.server.change({ service: { running: false, starting: false, address: "", restarts: 1, problem: "", text: "" } });
  assert.ok(page.text.includes("The characters have stopped"));
  page.server.change({ characters: [] }); // nothing is wrong before there is a character
  assert.ok(page.text.includes("Ready"));
});
