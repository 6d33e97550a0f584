import assert from "node:assert/strict";
import { test } from "node:test";

import { FILM_MS, MAKING_MS, SHORT_FILM_MS, type Seen, newest, noticed, phaseOf } from "../src/screen/phase";
import { TEXTS } from "../src/screen/texts";

type Report = Parameters<typeof phaseOf>[0];

/** A report of performers with their states, and of what is recorded, counted and offered. */
function report(states: readonly string[], clips: Record<string, number | null> = {}, count = 0, recording: string | null = null): Report {
  const users = states.map((state, k) => ({ user: k + 1, state }));
  return {
    stages: [{ users, recording, count_in: count }],
    clips: Object.entries(clips).map(([code, seconds_left]) => ({ code, seconds_left })),
  } as unknown as Report;
}

test("a visitor is led from stepping in to the film", () => {
  const steps: [Report, string][] = [
    [report([]), "attract"],
    [report(["waiting"]), "stand"],
    [report(["calibrating"]), "stand"],
    [report(["performing"]), "raise"],
    [report(["performing"], {}, 3), "count"],
    [report(["performing"], {}, 0, "ABCDEF"), "recording"],
    [report(["performing"], { ABCDEF: null }), "making"],
    [report(["performing"], { ABCDEF: 600 }), "film"],
  ];
  let [seen, before]: [Seen | null, Report | null] = [null, null];
  for (const [now, kind] of steps) {
    seen = noticed(now, before, seen, 1000);
    before = now;
    assert.equal(phaseOf(now, seen, 1000).kind, kind);
  }
});

test("a film has the screen for a time, a shorter one if another visitor plays, and stays in the corner until it is deleted", () => {
  const offered = report(["performing"], { ABCDEF: 600 });
  const seen = noticed(offered, null, null, 0);
  assert.deepEqual(phaseOf(offered, seen, FILM_MS - 1), { kind: "film", code: "ABCDEF" });
  assert.equal(phaseOf(offered, seen, FILM_MS).kind, "raise");
  const other = report(["leaving", "performing"], { ABCDEF: 600 });
  assert.equal(phaseOf(other, seen, SHORT_FILM_MS - 1).kind, "film");
  assert.equal(phaseOf(other, seen, SHORT_FILM_MS).kind, "raise");
  assert.equal(phaseOf(report([], { ABCDEF: 600 }), seen, FILM_MS).kind, "attract");
  const next = report(["performing"], { ABCDEF: 600, GHJKLM: null });
  const making = noticed(next, offered, seen, 0);
  assert.equal(phaseOf(next, making, MAKING_MS - 1).kind, "making");
  assert.equal(phaseOf(next, making, MAKING_MS).kind, "raise");
  assert.equal(noticed(next, next, making, 9), making);
  assert.equal(newest(next), "ABCDEF");
  assert.equal(newest(report([])), null);
});

test("every language has every text", () => {
  const keys = Object.keys(TEXTS.en ?? {});
  for (const [language, texts] of Object.entries(TEXTS)) {
    assert.deepEqual(Object.keys(texts), keys, language);
    assert.ok(texts.minutes.includes("{n}"), language);
  }
});
