import assert from "node:assert/strict";
import test from "node:test";

import type { FilmPlan, Moment, ShownView } from "../src/messages";
import { momentAt } from "../src/model/plan";
import { shownMoment } from "../src/plan";
import { strings } from "../src/strings";
import { pass } from "./clock";
import { Page } from "./page";
import { FILM, NAME, clip, take } from "./server";

const view = (shot: number, x: number): ShownView => ({ shot, share: 1, eye: [x, 1, 4], target: [x, 1, 0], field_of_view: 30, bubbles: [{ number: 0, opacity: 1, middle: [x / 10, 0.2], tip: [0.5, 0.5] }] });
const moment = (views: ShownView[], x: number): Moment => ({ brightness: 1, titles: [1], views, places: { [NAME]: [x, 0, 0, 90] } });
const PLAN: FilmPlan = {
  size: [640, 360],
  step: 0.5,
  bubbles: [{ kind: "speech", lines: [["Boo!", 0.1]], letter: 0.05, half: [0.1, 0.1] }],
  moments: [moment([view(0, 0)], 0), moment([view(0, 2)], 1), moment([view(1, 9)], 1)],
};

test("between two moments cameras, bubbles and characters are on their way, at a cut they are not", () => {
  const between = momentAt(PLAN, 0.25);
  assert.deepEqual(between, moment([{ ...view(0, 1), bubbles: [{ number: 0, opacity: 1, middle: [0.1, 0.2], tip: [0.5, 0.5] }] }], 0.5));
  assert.deepEqual(momentAt(PLAN, 0.75)?.views, [view(0, 2)]);
  assert.deepEqual(momentAt(PLAN, 1), PLAN.moments[2]);
  assert.deepEqual([momentAt(PLAN, -3), momentAt(PLAN, 99)], [PLAN.moments[0], PLAN.moments[2]]);
  assert.equal(momentAt({ ...PLAN, moments: [] }, 0), null);
});

test("the film is planned again after each change of what it shows, once for changes that come meanwhile, and not for others", async () => {
  const page = await Page.open((server) => {
    server.on("plan_film", () => PLAN).change({ takes: [take("take-1")], film: { ...FILM, takes: [clip("take-1", 0)] } });
  }, "film");
  const asked = (): number => page.server.asked("plan_film").length;
  await pass(0);
  assert.deepEqual([asked(), page.state.plan?.film], [1, PLAN]);
  await page.button("Waltz").click();
  await page.button("Snow").click();
  assert.equal(asked(), 1);
  const answer = page.server.hold("plan_film");
  await page.field(strings.scene.firstTitle).enter("One");
  for (const title of ["Two", "Three"]) await page.field(strings.scene.newTitle).enter(title);
  await answer();
  await answer();
  await pass(0);
  assert.equal(asked(), 3);
});

test("the plan is shown while the film plays, not while a take is recorded or the workshop is open", async () => {
  const page = await Page.open((server) => {
    server.on("plan_film", () => PLAN).change({ takes: [take("take-1")], film: { ...FILM, takes: [clip("take-1", 0)] } });
  }, "film");
  await pass(0);
  assert.equal(shownMoment(page.state), null);
  const timeline = { position: 0, moment: 0, start: 0, end: 4, speed: 1, paused: false, loop: false, takes: [] };
  page.server.change({ timeline });
  await pass(500);
  assert.deepEqual(shownMoment(page.state)?.views, PLAN.moments[1]?.views);
  page.server.change({ recording: "take-2" });
  assert.equal(shownMoment(page.state), null);
  page.server.change({ recording: null });
  await page.button("Workshop").click();
  assert.equal(shownMoment(page.state), null);
});

test("a film that cannot be planned plays without a plan, and is planned again when it has changed", async () => {
  const page = await Page.open((server) => {
    server.refuse("plan_film", "a missing file").change({ takes: [take("take-1")], film: { ...FILM, takes: [clip("take-1", 0)] } });
  }, "film");
  await pass(0);
  assert.deepEqual([page.state.plan?.film, page.state.notice, page.server.asked("plan_film").length], [null, null, 1]);
  page.server.on("plan_film", () => PLAN).change({ film: { ...FILM, takes: [clip("take-1", 1)] } });
  await pass(0);
  assert.deepEqual(page.state.plan?.film, PLAN);
});
