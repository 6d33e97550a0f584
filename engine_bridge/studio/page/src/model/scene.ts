/** The film's scene: where characters stand, and its tables as people see them. */

import type { FilmCharacter } from "../messages";
import { strings } from "../strings";
import type { Film } from "./film";

type Scene = Film["scene"];

/** Greatest distance of a character from the middle to a side, in metres. */
export const FARTHEST = 6;

/** The name of a character for people: that of the example, or of its file without its ending, and a number from the second one on. */
export function titleOf(name: string, title: string): string {
  const file = (title === "" ? name : title).replace(/\.\w+$/, "").replace(/ \(example\)$/, "");
  const words = strings.examples[file] ?? file.replaceAll(/[_-]+/g, " ").trim();
  const number = title === "" ? "" : (/-(\d+)$/.exec(name)?.[1] ?? "");
  return `${words.charAt(0).toUpperCase()}${words.slice(1)} ${number}`.trim();
}

/** The address of the picture of the place, for the page; null for a background of one's own. */
export function placeOf({ background }: Scene): string | null {
  const { set, color, colors, picture } = background;
  const own = color ?? colors ?? picture ?? null;
  return own === null ? pictureOfSet(set ?? "studio") : null;
}

export const pictureOfSet = (set: string): string => `/assets/set_${set}.webp`;

/** Where a character stands in the film; it has no row until the server has added one. */
export const rowOf = ({ character }: Scene, name: string): FilmCharacter | undefined => character.find((each) => each.name === name);

/** Change the row of a character. */
export const withRow = ({ character }: Scene, name: string, change: Partial<FilmCharacter>): Scene["character"] =>
  character.map((each) => (each.name === name ? { ...each, ...change } : each));
