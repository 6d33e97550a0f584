/** The character that is shown, in the film: its size, its place, its colour and its name. */

import { closeCharacter } from "../actions";
import { type Node_, h } from "../dom";
import { editScene } from "../film";
import type { FilmCharacter } from "../messages";
import { FARTHEST, rowOf, titleOf, withRow } from "../model/scene";
import { type State, current, isJoined, shownCharacter, update } from "../store";
import { strings } from "../strings";
import { portrait } from "./characters";
import { button, checkbox, entry, section, slider } from "./parts";

/** Colours by which a character's own are multiplied; null leaves them. */
const COLOURS = [null, "#ffb3ae", "#ffd08a", "#fff3a6", "#b9efb0", "#a6d8ff", "#d9b8ff", "#ffb8e0", "#9aa0aa"];

export function character(state: State, height: number | null): Node_ {
  const { character: words } = strings;
  const shown = shownCharacter(state);
  const { scene } = state.film.present;
  const row = shown === null ? undefined : rowOf(scene, shown.name);
  if (shown === null) return h("div", { key: "character" });
  const { name } = shown;
  const title = titleOf(name, shown.title);
  const heading = section(title, h("div", { class: "large" }, portrait(state, name)));
  const remove = !isJoined(state) && button(words.remove(title), () => {
    void closeCharacter(name);
  }, { quiet: true, danger: true });
  if (row === undefined) return h("div", { class: "stack", key: "character" }, heading, remove);
  const drafted = (): Partial<FilmCharacter> => (current().draft?.name === name ? current().draft : null) ?? {};
  const change = (values: Partial<FilmCharacter>): void => {
    editScene({ character: withRow(scene, name, { ...drafted(), ...values }) }, { draft: null });
  };
  const slide = (values: Partial<FilmCharacter>): void => {
    update({ draft: { ...drafted(), ...values, name } });
  };
  const draft = state.draft?.name === name ? state.draft : row;
  const [x, z] = draft.position ?? row.position ?? [0, 0];
  const tall = draft.height ?? row.height ?? height ?? 1;
  const named = scene.bubble.find((each) => each.kind === "name" && each.character === name);
  const others = scene.bubble.filter((each) => each !== named);
  const length = 6 * 3600;
  return h(
    "div",
    { class: "stack", key: "character" },
    heading,
    section(
      words.size,
      // a step of the slider is the same share of the size everywhere
      slider(words.height, Math.log2(tall), { min: -4, max: 4, step: 0.05 }, (value) => {
        change({ height: metres(value) });
      }, (value) => {
        slide({ height: metres(value) });
      }, words.metres(tall)),
    ),
    section(
      words.place,
      slider(words.sideways, x, { min: -FARTHEST, max: FARTHEST, step: 0.1 }, (value) => {
        change({ position: [value, z] });
      }, (value) => {
        slide({ position: [value, z] });
      }, words.across(x)),
      slider(words.forwards, z, { min: -FARTHEST, max: FARTHEST, step: 0.1 }, (value) => {
        change({ position: [x, value] });
      }, (value) => {
        slide({ position: [x, value] });
      }, words.along(z)),
      slider(words.turn, draft.turn ?? row.turn ?? 0, { min: -180, max: 180, step: 5 }, (turn) => {
        change({ turn });
      }, (turn) => {
        slide({ turn });
      }, `${String(draft.turn ?? row.turn ?? 0)}°`),
      h("p", { class: "small" }, words.drag),
    ),
    section(
      words.colour,
      h(
        "div",
        { class: "swatches" },
        COLOURS.map((colour, i) =>
          h("button", {
            type: "button",
            class: `swatch ${colour === null ? "own" : ""}`,
            style: colour === null ? "" : `background: ${colour}`,
            "aria-label": words.colours[i],
            title: words.colours[i],
            "aria-pressed": String((row.color ?? null) === colour),
            onclick: () => {
              change({ color: colour });
            },
          }),
        ),
      ),
    ),
    section(
      words.name,
      checkbox(words.showName, named !== undefined, (on) => {
        editScene({ bubble: on ? [{ character: name, kind: "name", text: title, at: 0, seconds: length }, ...others] : others });
      }),
      named !== undefined && entry(words.name, named.text ?? title, (text) => {
        editScene({ bubble: [{ ...named, text: text === "" ? title : text }, ...others] });
      }),
    ),
    remove,
  );
}

/** The size at a place of the slider, which is logarithmic. */
const metres = (value: number): number => Number((2 ** value).toPrecision(3));
