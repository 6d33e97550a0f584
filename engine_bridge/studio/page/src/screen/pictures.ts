/** Pictures that say what to do without words; the style sheet moves them. */

import { type Node_, h } from "../dom";

const picture = (name: string, ...parts: readonly Node_[]): Node_ =>
  h("svg", { class: `picture ${name}`, viewBox: "0 0 200 200", key: name, "aria-hidden": "true" }, ...parts);

const line = (d: string, name = "body"): Node_ => h("path", { class: name, d });
const disc = (cx: number, cy: number, r: number, name = "head"): Node_ => h("circle", { class: name, cx, cy, r });

const LEGS = "M100 108 L84 164 M100 108 L116 164";
const TRUNK = "M100 70 L100 108";

/** Two feet on a spot, and a person who stands on it. */
export const stand = (): Node_ =>
  picture(
    "stand",
    h("g", { class: "spot" }, line("M40 172 a60 16 0 1 0 120 0 a60 16 0 1 0 -120 0", "ground")),
    h("g", { class: "person" }, disc(100, 44, 20), line(`${TRUNK} ${LEGS} M100 76 L74 116 M100 76 L126 116`)),
  );

/** A person who raises both hands, and lowers them. */
export const raise = (): Node_ =>
  picture(
    "raise",
    disc(100, 58, 20),
    line("M100 84 L100 122 M100 122 L84 176 M100 122 L116 176"),
    h("g", { class: "arm left" }, line("M100 90 L62 62 L58 16")),
    h("g", { class: "arm right" }, line("M100 90 L138 62 L142 16")),
    line("M30 34 L30 6 M20 16 L30 6 L40 16 M170 34 L170 6 M160 16 L170 6 L180 16", "arrow"),
  );

/** A person who steps nearer. */
export const invite = (): Node_ =>
  picture(
    "invite",
    h("g", { class: "walker" }, disc(100, 40, 20), line(`${TRUNK} M100 108 L76 160 M100 108 L126 158 M100 76 L70 104 M100 76 L132 100`)),
    line("M76 184 L100 196 L124 184", "arrow"),
  );

/** A camera with a red light. */
export const recording = (): Node_ =>
  picture(
    "recording",
    line("M30 66 h96 a12 12 0 0 1 12 12 v50 a12 12 0 0 1 -12 12 h-96 a12 12 0 0 1 -12 -12 v-50 a12 12 0 0 1 12 -12 z M138 92 L182 68 V138 L138 114 z", "solid"),
    disc(60, 103, 16, "light"),
  );

/** A strip of film that turns. */
export const making = (): Node_ =>
  picture(
    "making",
    h("g", { class: "reel" }, disc(100, 100, 72, "ring"), disc(100, 58, 17, "hole"), disc(136, 84, 17, "hole"), disc(122, 128, 17, "hole"), disc(78, 128, 17, "hole"), disc(64, 84, 17, "hole")),
  );
