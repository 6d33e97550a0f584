import assert from "node:assert/strict";
import test from "node:test";

import type { Timeline } from "../src/messages";
import { EMPTY } from "../src/model/film";
import { playSounds } from "../src/sound";
import { INITIAL, type State } from "../src/store";
import { pass } from "./clock";
import { Page } from "./page";
import { clip, take } from "./server";

interface Playing {
  readonly speed: number;
  when: number;
  offset: number;
  duration: number;
  stopped: boolean;
}

const played: Playing[] = [];
let heard = 0;

Object.assign(globalThis, {
  AudioContext: class {
    readonly destination = {};
    get currentTime(): number {
      return heard;
    }
    getOutputTimestamp = () => ({ contextTime: heard, performanceTime: 1 });
    decodeAudioData = () => Promise.resolve({});
  },
  AudioBufferSourceNode: class {
    private readonly own: Playing;
    constructor(_: object, { playbackRate }: { playbackRate: number }) {
      this.own = { speed: playbackRate, when: 0, offset: 0, duration: 0, stopped: false };
      played.push(this.own);
    }
    connect = (): void => undefined;
    start(when: number, offset: number, duration: number): void {
      Object.assign(this.own, { when, offset, duration });
    }
    stop(): void {
      this.own.stopped = true;
    }
  },
});
performance.now = () => 1;

const near = (found: readonly number[], expected: readonly number[]): void => {
  assert.equal(found.length, expected.length);
  found.forEach((value, i) => {
    assert.ok(Math.abs(value - (expected[i] ?? Number.NaN)) < 1e-9, `${value} is not ${expected[i] ?? ""}`);
  });
};

test("a sound plays in step with the image of its character, again after a jump, and not while the timeline pauses", async () => {
  const page = await Page.open();
  const timeline: Timeline = {
    position: 0, moment: 100, start: 0, end: 4, speed: 1, paused: false, loop: false,
    takes: [{ character: "figure", take: "take-1", at: 0, seconds: 4, sound: { file: "take.wav", at: -0.25 } }],
  };
  const state = (change: Partial<Timeline> = {}): State => ({
    ...INITIAL, server: { ...page.server.state, takes: [take("take-1", { sound_file: "id-1" })], timeline: { ...timeline, ...change } },
  });
  // the image shows this second of the service while the sound of this second is heard
  const play = (service: number, audible: number, change: Partial<Timeline> = {}): void => {
    heard = audible;
    playSounds(state(change), () => service);
  };
  play(101, 7);
  await pass(1);
  assert.equal(played.length, 0); // it is being loaded

  play(101, 7);
  const last = (): Playing => played[played.length - 1] ?? assert.fail("silence");
  // a hundredth of a second later, second 1.01 of the timeline, which is second 1.26 of the sound that began before it
  near([last().when, last().offset, last().duration], [7.01, 1.26, 2.99]);
  play(101.5, 7.51);
  assert.equal(played.length, 1); // within the tolerance
  play(101.5, 7.55);
  assert.deepEqual([played.length, played[0]?.stopped], [2, true]);
  near([last().when - last().offset], [7.55 - 1.75]);

  play(100, 8, { position: 3, moment: 100 });
  assert.equal(played.length, 3);
  near([last().when - last().offset], [8 - 3.25]);
  play(100, 9, { position: 1, moment: 100, speed: 2 });
  near([last().speed, last().offset / 2 - last().when], [2, 1.25 / 2 - 9]);
  play(100, 9, { position: 1, moment: 100.5, speed: 1 });
  near([last().when, last().offset], [9.01, 0.76]); // the timeline runs in half a second
  play(104, 9);
  assert.ok(last().stopped); // its take has ended
  play(101, 9);
  play(101, 9, { paused: true });
  assert.ok(played.every(({ stopped }) => stopped));
  const before = played.length;
  playSounds({ ...state(), film: { past: [], present: { ...EMPTY, takes: [{ ...clip("take-1", 0), mute: true }] }, future: [] } }, () => 101);
  playSounds(state(), () => null);
  assert.equal(played.length, before);
});
