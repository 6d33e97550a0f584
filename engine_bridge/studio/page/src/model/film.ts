/** The film: its takes and its scene, and edits of takes, which return new takes; times are in seconds. */

import type { FilmState, FilmTake } from "../messages";
import { keepKeys, keyOf, withItem } from "./rows";

/** What can be edited, and undone. */
export type Film = Pick<FilmState, "takes" | "scene">;

/** A film without takes, in a scene as it is when nothing was chosen. */
export const EMPTY: Film = { takes: [], scene: { film: {}, sound: [], music: {}, camera: [], background: {}, floor: {}, light: {}, title: [], bubble: [], character: [] } };

export const filmOf = ({ takes, scene }: Film): Film => ({ takes, scene });

/** Give the takes and the scene's rows of a film that the server has sent the keys that they had, see `keepKeys`. */
export function keepFilm(before: Film, after: Film): void {
  keepKeys(before.takes, after.takes);
  for (const [name, rows] of Object.entries(after.scene)) {
    const old: unknown = before.scene[name as keyof Film["scene"]];
    if (Array.isArray(rows) && Array.isArray(old)) keepKeys(old as object[], rows as object[]);
  }
}

/** The shortest part of a take. */
export const SHORTEST = 0.3;

type Takes = readonly FilmTake[];

export const beginOf = ({ at }: FilmTake): number => at ?? 0;
export const secondsOf = ({ start, stop }: FilmTake): number => Math.max((stop ?? start) - start, 0);
export const endOf = (takes: Takes): number => Math.max(0, ...takes.map((take) => beginOf(take) + secondsOf(take)));

/** The name of a take's recording. */
export const nameOf = ({ file }: FilmTake): string => file.replace(/^.*\//, "").replace(/\.log$/, "");

/** The take that has a key, see `keyOf`. */
export const takeOf = (takes: Takes, key: string | null): FilmTake | undefined => takes.find((take) => keyOf(take) === key);

/** Replace a take, or remove it with null; the takes of the film stay in the order of their times, as the server keeps them. */
function changed(takes: Takes, take: FilmTake, change: Partial<FilmTake> | null): Takes {
  return withItem(takes, takes.indexOf(take), change === null ? null : { ...take, ...change });
}

/** Move a take in time, and perhaps to another character. */
export function move(takes: Takes, key: string, by: number, character?: string): Takes {
  const take = takeOf(takes, key);
  if (take === undefined) return takes;
  return changed(takes, take, { at: round(Math.max(0, beginOf(take) + by)), character: character ?? take.character });
}

/** Move the first moment of a take; what follows stays where it is in the film. */
export function trimStart(takes: Takes, key: string, by: number): Takes {
  const take = takeOf(takes, key);
  if (take === undefined) return takes;
  const earliest = Math.max(-take.start, -beginOf(take));
  const moved = Math.min(Math.max(by, earliest), secondsOf(take) - SHORTEST);
  return changed(takes, take, { start: round(take.start + moved), at: round(beginOf(take) + moved) });
}

/** Move the last moment of a take of `whole` seconds. */
export function trimStop(takes: Takes, key: string, by: number, whole: number): Takes {
  const take = takeOf(takes, key);
  if (take === undefined) return takes;
  const stop = Math.min(Math.max(take.start + secondsOf(take) + by, take.start + SHORTEST), whole);
  return changed(takes, take, { stop: round(stop) });
}

export function mute(takes: Takes, key: string): Takes {
  const take = takeOf(takes, key);
  return take === undefined ? takes : changed(takes, take, { mute: !take.mute });
}

export function remove(takes: Takes, key: string): Takes {
  const take = takeOf(takes, key);
  return take === undefined ? takes : changed(takes, take, null);
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
