/** What the film shows over the view while it plays: its frame, bubbles and titles, and the black of its fades. */

import { type Child, type Node_, draw, h } from "../dom";
import type { BubbleShape, FilmBubble, FilmPlan, FilmTitle, Moment, ShownBubble } from "../messages";
import type { State } from "../store";

type Point = readonly [number, number];

/** Size of a title and typeface of a text when none was chosen. */
const [SIZE, FONT] = [0.09, "plain"];

/** Show a moment of the film, which changes in every image; with null, nothing. */
export function showFilm({ film, plan }: State, moment: Moment | null): void {
  const box = document.querySelector(".shown-film");
  if (box !== null) draw(box, moment === null || plan?.film == null ? [] : [frame(plan.film, film.present.scene, moment)]);
}

function frame({ size, bubbles: shapes }: FilmPlan, { title, bubble }: State["film"]["present"]["scene"], { brightness, titles, views }: Moment): Node_ {
  const [width, height] = size;
  return h(
    "div",
    { class: "frame", style: `--ratio: ${width / height}` },
    h(
      "svg",
      { viewBox: `0 0 ${width} ${height}` },
      views.flatMap((view) => view.bubbles.map((each) => drawn(shapes[each.number], bubble[each.number], each, view.share, size))),
    ),
    title.map((row, i) => (titles[i] ?? 0) > 0 && written(row, titles[i] ?? 0)),
    brightness < 1 && h("div", { class: "black", key: "black", style: `opacity: ${1 - brightness}` }),
  );
}

function written({ text, place = "middle", size = SIZE, color = "white", font = FONT }: FilmTitle, opacity: number): Node_ {
  return h("p", { class: `${place} ${font}`, style: `font-size: ${100 * size}cqh; color: ${color}; opacity: ${opacity}` }, text);
}

function drawn(shape: BubbleShape | undefined, row: FilmBubble | undefined, { middle, tip, opacity }: ShownBubble, share: number, size: Point): Child {
  if (shape === undefined) return null;
  const pixels = ([x, y]: Point): Point => [x * size[0], y * size[1]];
  const [center, half, letter] = [pixels(middle), pixels(shape.half), shape.letter * size[1]];
  const outline = shape.kind === "name" ? box(center, half, 0.5 * letter) : [...body(shape.kind, center, half, letter), ...tail(shape.kind, center, half, pixels(tip), letter)];
  const first = center[1] - 0.6 * (shape.lines.length - 1) * letter;
  return h(
    "g",
    { class: `bubble ${shape.kind}`, style: `opacity: ${opacity * share}; font-size: ${letter}px; stroke-width: ${0.12 * letter}px` },
    shape.kind !== "name" && h("g", { class: "line" }, outline),
    h("g", { class: "paper" }, outline),
    shape.lines.map(([line, wide], i) => h("text", { class: row?.font ?? FONT, x: center[0], y: first + 1.2 * i * letter, textLength: wide * size[0], lengthAdjust: "spacingAndGlyphs" }, line)),
  );
}

function box([x, y]: Point, [wide, tall]: Point, round: number): Node_[] {
  return [h("rect", { x: x - wide, y: y - tall, width: 2 * wide, height: 2 * tall, rx: round })];
}

const disc = (cx: number, cy: number, r: number): Node_ => h("circle", { cx, cy, r });

/** A bubble without its tail; a thought has round edges like a cloud. */
function body(kind: BubbleShape["kind"], center: Point, half: Point, letter: number): Node_[] {
  if (kind === "speech") return box(center, half, letter);
  const r = 0.75 * letter;
  const inside: Point = [half[0] - r / 2, half[1] - r / 2];
  const along = (from: number, to: number): number[] => {
    const count = Math.max(Math.round((to - from) / letter), 2);
    return Array.from({ length: count }, (_, i) => from + ((to - from) * i) / (count - 1));
  };
  const [[x, y], [wide, tall]] = [center, inside];
  return [
    ...box(center, inside, r / 2),
    ...along(x - wide, x + wide).flatMap((at) => [disc(at, y - tall, r), disc(at, y + tall, r)]),
    ...along(y - tall, y + tall).flatMap((at) => [disc(x - wide, at, r), disc(x + wide, at, r)]),
  ];
}

function tail(kind: BubbleShape["kind"], [x, y]: Point, [wide, tall]: Point, tip: Point, letter: number): Node_[] {
  if (kind === "speech") {
    const length = Math.max(Math.hypot(tip[0] - x, tip[1] - y), 1e-9);
    const across: Point = [(-0.45 * letter * (tip[1] - y)) / length, (0.45 * letter * (tip[0] - x)) / length];
    return [h("path", { d: `M${x + across[0]} ${y + across[1]} L${tip[0]} ${tip[1]} L${x - across[0]} ${y - across[1]} Z` })];
  }
  const edge: Point = [Math.min(Math.max(tip[0], x - wide), x + wide), Math.min(Math.max(tip[1], y - tall), y + tall)];
  return [[0.45, 0.3], [0.75, 0.2], [1, 0.12]].map(([share = 0, r = 0]) => disc(edge[0] + share * (tip[0] - edge[0]), edge[1] + share * (tip[1] - edge[1]), r * letter));
}
