/** The film: its takes and its scene, and edits of takes, which return new takes; times are in seconds. */

import type { FilmState, FilmTake } from "../messages";

/** What can be edited, and undone. */
export type Film = Pick<FilmState, "takes" | "scene">;

/** A film without takes, in a scene as it is when nothing was chosen. */
export const EMPTY: Film = { takes: [], scene: { film: {}, sound: [], music: {}, camera: [], background: {}, floor: {}, light: {}, title: [], bubble: [], character: [] } };

export const filmOf = ({ takes, scene }: Film): Film => ({ takes, scene });

/** The shortest part of a take. */
export const SHORTEST = 0.3;

type Takes = readonly FilmTake[];

export const beginOf = ({ at }: FilmTake): number => at ?? 0;
export const secondsOf = ({ start, stop }: FilmTake): number => Math.max((stop ?? start) - start, 0);
export const endOf = (takes: Takes): number => Math.max(0, ...takes.map((take) => beginOf(take) + secondsOf(take)));

/** The name of a take's recording. */
export const nameOf = ({ file }: FilmTake): string => file.replace(/^.*\//, "").replace(/\.log$/, "");

/** Change a take; the takes of the film stay in the order of their times, as the server keeps them. */
function changed(takes: Takes, index: number, change: Partial<FilmTake>): Takes {
  return takes.map((take, i) => (i === index ? { ...take, ...change } : take));
}

/** Move a take in time, and perhaps to another character. */
export function move(takes: Takes, index: number, by: number, character?: string): Takes {
  const take = takes[index];
  if (take === undefined) return takes;
  return changed(takes, index, { at: round(Math.max(0, beginOf(take) + by)), character: character ?? take.character });
}

/** Move the first moment of a take; what follows stays where it is in the film. */
export function trimStart(takes: Takes, index: number, by: number): Takes {
  const take = takes[index];
  if (take === undefined) return takes;
  const earliest = Math.max(-take.start, -beginOf(take));
  const moved = Math.min(Math.max(by, earliest), secondsOf(take) - SHORTEST);
  return changed(takes, index, { start: round(take.start + moved), at: round(beginOf(take) + moved) });
}

/** Move the last moment of a take of `whole` seconds. */
export function trimStop(takes: Takes, index: number, by: number, whole: number): Takes {
  const take = takes[index];
  if (take === undefined) return takes;
  const stop = Math.min(Math.max(take.start + secondsOf(take) + by, take.start + SHORTEST), whole);
  return changed(takes, index, { stop: round(stop) });
}

export function mute(takes: Takes, index: number): Takes {
  return changed(takes, index, { mute: takes[index]?.mute !== true });
}

export function remove(takes: Takes, index: number): Takes {
  return takes.filter((_, i) => i !== index);
}

/** Add a whole recording after a character's last take. */
export function append(takes: Takes, character: string, name: string): Takes {
  const at = round(endOf(takes.filter((take) => take.character === character)));
  return [...takes, { character, file: `takes/${name}.log`, at, start: 0, stop: null, mute: false }];
}

/** Milliseconds. */
function round(seconds: number): number {
  return Math.round(1000 * seconds) / 1000;
}
