/** Channels of the performer, what they move in a puppet, and the values that count as 0 and 1. */

import {
  BEND_DEGREES,
  type Handle,
  type Limb,
  type Morph,
  type Part,
  type Puppet,
  type Range,
  axis,
  handleNamed,
  handlesOf,
  limbNamed,
  limbsOf,
  sidewaysAxis,
  withHandle,
  withLimb,
} from "./puppet";
import { scale } from "./vector";

/** Channels that always have a meter; those of the joints of fingers have one if they are measured or move something. */
export const CHANNELS = [
  "voice",
  "mouth_open",
  "mouth_wide",
  "smile",
  "brow_up",
  "blink_left",
  "blink_right",
  "hand_open_left",
  "hand_open_right",
  "point_left",
  "point_right",
] as const;

export const morphsOf = (puppet: Puppet): readonly Morph[] => puppet.morph ?? [];

/** Names of all that a channel moves. */
export function movedByChannel(puppet: Puppet, channel: string): string[] {
  return [
    ...limbsOf(puppet).filter(({ bend }) => bend?.channel === channel).map(({ name }) => name),
    ...handlesOf(puppet).filter((handle) => handle.channel === channel).map(({ name }) => name),
    ...morphsOf(puppet).filter((morph) => morph.channel === channel).map(({ target }) => target),
  ];
}

/** The channels that have a meter: all that a performer has, or that move something. */
export function metersOf(puppet: Puppet | null, values: Readonly<Record<string, number>>): string[] {
  const mapped = puppet === null ? [] : [...limbsOf(puppet).map(({ bend }) => bend?.channel), ...handlesOf(puppet).map(({ channel }) => channel), ...morphsOf(puppet).map(({ channel }) => channel)];
  const others = [...Object.keys(values), ...mapped.filter((name) => name != null)];
  return [...new Set([...CHANNELS, ...others.sort()])];
}

/** Let a channel bend a limb; a bend that the limb has keeps its angle and axis. */
export function withBend(puppet: Puppet, limb: string, channel: string): Puppet {
  return withLimb(puppet, limb, (old) => ({
    ...old,
    bend: { ...(old.bend ?? { degrees: BEND_DEGREES, axis: sidewaysAxis(puppet) }), channel },
  }));
}

export function withoutBend(puppet: Puppet, limb: string): Puppet {
  return withLimb(puppet, limb, (old): Limb => ({ ...old, bend: null }));
}

/** How far a channel moves a handle upwards, in metres, until it is changed. */
const MOVE_METRES = 0.1;

/** Let a channel move a handle; one that a channel moves already keeps its way. */
export function withMove(puppet: Puppet, handle: string, channel: string): Puppet {
  const up = scale(axis(puppet.character.up ?? "y"), MOVE_METRES / (puppet.character.scale ?? 1));
  return withHandle(puppet, handle, (old) => ({ ...old, channel, moves: old.channel == null ? up : (old.moves ?? up) }));
}

export function withoutMove(puppet: Puppet, handle: string): Puppet {
  return withHandle(puppet, handle, (old): Handle => ({ ...old, channel: null, moves: [0, 0, 0] }));
}

/** Let a channel bend a limb or move a handle. */
export const withChannel = (puppet: Puppet, { kind, name }: Part, channel: string): Puppet =>
  kind === "limb" ? withBend(puppet, name, channel) : withMove(puppet, name, channel);

/** The channel that bends a limb or moves a handle. */
export const channelOf = (puppet: Puppet, { kind, name }: Part): string | null | undefined =>
  kind === "limb" ? limbNamed(puppet, name)?.bend?.channel : handleNamed(puppet, name)?.channel;

/** Let a channel move a morph target, or change how far it does. */
export function withMorph(puppet: Puppet, target: string, channel: string, gain?: number): Puppet {
  const morph: Morph = { target, channel, ...(gain === undefined ? {} : { gain }) };
  const index = morphsOf(puppet).findIndex((each) => each.target === target && each.channel === channel);
  if (index < 0) return { ...puppet, morph: [...morphsOf(puppet), morph] };
  return gain === undefined ? puppet : { ...puppet, morph: morphsOf(puppet).with(index, morph) };
}

export function withoutMorph(puppet: Puppet, target: string, channel: string): Puppet {
  return { ...puppet, morph: morphsOf(puppet).filter((each) => each.target !== target || each.channel !== channel) };
}

/** Set the values of a channel that count as 0 and 1; null for the measured ones. */
export function withRange(puppet: Puppet, name: string, range: { neutral: number; full: number } | null): Puppet {
  const others = (puppet.channel ?? []).filter((each) => each.name !== name);
  return { ...puppet, channel: range === null ? others : [...others, { name, ...range }] };
}

export const rangeOf = (puppet: Puppet | null, channel: string): Range | undefined => puppet?.channel?.find(({ name }) => name === channel);

/** A channel's value as it moves the character. */
export function ranged(range: Range | undefined, value: number): number {
  const [neutral, full] = [range?.neutral ?? 0, range?.full ?? 1];
  return Math.min(1, Math.max(0, (value - neutral) / (full - neutral)));
}

/** A value of a channel at a time in milliseconds. */
export interface Sample {
  readonly time: number;
  readonly value: number;
}

/** How long a value is held, in milliseconds. */
export const HOLD_MS = 1000;

/** Largest difference of values that count as held, and least difference of the values that count as 0 and 1. */
const STILL = 0.15;
const LEAST = 0.1;

/** The value that a channel has been held at for a second; with `neutral`, only one that differs from it. */
export function held(samples: readonly Sample[], neutral: number | null): number | null {
  const [first, last] = [samples[0], samples.at(-1)];
  if (first === undefined || last === undefined || last.time - first.time < HOLD_MS) return null;
  const values = samples.filter(({ time }) => time >= last.time - HOLD_MS).map(({ value }) => value).sort((a, b) => a - b);
  const middle = values[Math.floor(values.length / 2)] ?? 0;
  const spread = (values.at(-1) ?? 0) - (values[0] ?? 0);
  if (neutral === null) return spread <= STILL ? middle : null;
  const away = Math.abs(middle - neutral);
  return away >= LEAST && spread <= Math.max(STILL, away / 3) ? middle : null;
}
