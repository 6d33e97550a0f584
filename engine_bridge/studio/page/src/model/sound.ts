/** When the sounds of takes are heard. Seconds of the timeline, except where something else is said. */

import type { FilmTake, TakeState, Timeline } from "../messages";
import { nameOf } from "./film";

/** A part of a sound: the id of its file, its first and last second, and the second of its first sample. */
export interface Part {
  readonly character: string;
  readonly file: string;
  readonly from: number;
  readonly to: number;
  readonly at: number;
}

/** The sounds of the takes that play; a take that is mute in the film has none, and ends when the character's next begins. */
export function partsOf({ takes }: Timeline, recorded: readonly TakeState[], film: readonly FilmTake[]): Part[] {
  return takes.flatMap(({ character, take, at, seconds, sound }): Part[] => {
    const file = recorded.find(({ name }) => name === take)?.sound_file ?? "";
    const same = film.filter((each) => each.character === character && nameOf(each) === take);
    if (sound === null || file === "" || (same.length > 0 && same.every(({ mute }) => mute))) return [];
    const next = takes.filter((each) => each.character === character && each.at > at).map((each) => each.at);
    return [{ character, file, from: Math.max(at, sound.at), to: Math.min(at + seconds, ...next), at: sound.at }];
  });
}

/** The second of the timeline at a moment of the service's clock, and the seconds until it runs. */
export function positionAt({ position, moment, start, end, speed, loop }: Timeline, now: number): [number, number] {
  const passed = position + speed * Math.max(now - moment, 0);
  const looped = loop && passed > end && end > start ? start + ((passed - start) % (end - start)) : passed;
  return [looped, Math.max(moment - now, 0)];
}
