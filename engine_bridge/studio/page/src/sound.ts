/** Plays the sounds of takes in step with the images of their characters. */

import { type Part, partsOf, positionAt } from "./model/sound";
import { download } from "./requests";
import type { State } from "./store";

/** Difference from the images after which a sound is played anew, in seconds. */
const TOLERANCE = 0.02;

/** Time from a call until a sound can begin, in seconds. */
const LEAD = 0.01;

interface Playing {
  readonly node: AudioBufferSourceNode;
  readonly speed: number;
  /** When the first sample is heard, or would be, in seconds of the audio context. */
  readonly origin: number;
}

let audio: AudioContext | null = null;
const buffers = new Map<string, AudioBuffer | null>();
const playing = new Map<string, Playing>();

/** The one audio context of the page. */
export function context(): AudioContext {
  audio ??= new AudioContext();
  return audio;
}

/** Play what is heard now; `shown` returns the service's time of a character's image at a moment of the page. */
export function playSounds({ server, film }: State, shown: (character: string, now: number) => number | null): void {
  const timeline = server?.timeline ?? null;
  const parts = server === null || timeline === null || timeline.paused ? [] : partsOf(timeline, server.takes, film.present.takes);
  const keys = new Set<string>();
  for (const part of parts) {
    const now = performance.now();
    const moment = shown(part.character, now / 1000);
    const buffer = bufferOf(part.file);
    if (timeline === null || moment === null || buffer === null) continue;
    const [position, wait] = positionAt(timeline, moment);
    if (position >= part.to) continue;
    const key = `${part.file} ${part.from} ${part.to} ${part.at}`;
    keys.add(key);
    const origin = heardAt(now) + wait - (position - part.at) / timeline.speed;
    const before = playing.get(key);
    if (before?.speed === timeline.speed && Math.abs(before.origin - origin) < TOLERANCE) continue;
    before?.node.stop();
    playing.set(key, { node: begin(buffer, part, origin, timeline.speed), speed: timeline.speed, origin });
  }
  for (const [key, { node }] of playing) {
    if (keys.has(key)) continue;
    node.stop();
    playing.delete(key);
  }
}

function begin(buffer: AudioBuffer, { from, to, at }: Part, origin: number, speed: number): AudioBufferSourceNode {
  const audio = context();
  const when = Math.max(origin + (from - at) / speed, audio.currentTime + LEAD);
  const offset = (when - origin) * speed;
  const node = new AudioBufferSourceNode(audio, { buffer, playbackRate: speed });
  node.connect(audio.destination);
  node.start(when, offset, Math.max(to - at - offset, 0));
  return node;
}

/** The time of the audio context whose sound is heard at a moment of the page, in milliseconds. */
function heardAt(now: number): number {
  const audio = context();
  const { contextTime = 0, performanceTime = 0 } = audio.getOutputTimestamp();
  return performanceTime === 0 ? audio.currentTime - audio.outputLatency : contextTime + (now - performanceTime) / 1000;
}

/** The sound of a file; null until it has been loaded. */
function bufferOf(file: string): AudioBuffer | null {
  const known = buffers.get(file);
  if (known !== undefined) return known;
  buffers.set(file, null);
  void download(file).then(async (blob) => {
    buffers.set(file, await context().decodeAudioData(await blob.arrayBuffer()));
  }).catch(() => undefined); // a sound that cannot be read is not heard
  return null;
}
