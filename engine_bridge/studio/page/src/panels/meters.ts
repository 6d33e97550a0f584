/** Meters of the performer's channels, which are mapped by choosing a meter and then a limb, a handle or a morph target. */

import { edit, findRange, pickChannel } from "../actions";
import { type Node_, h } from "../dom";
import { CHANNELS, channelOf, metersOf, movedByChannel, rangeOf, ranged, withRange } from "../model/channels";
import { sideOf } from "../model/skeleton";
import { type State, shownPuppet } from "../store";
import { strings } from "../strings";
import { button } from "./parts";

export function meters(state: State, values: Readonly<Record<string, number>>): Node_ {
  const { channels: words } = strings;
  const puppet = shownPuppet(state);
  const names = metersOf(puppet, values);
  const few = names.slice(0, CHANNELS.length);
  const fingers = names.slice(CHANNELS.length);
  const row = (name: string): Node_ => meter(state, name, values[name]);
  return h(
    "section",
    { class: "meters", "aria-label": words.title, key: "meters" },
    h("h2", {}, words.title),
    h("p", { class: "hint" }, Object.keys(values).length === 0 ? words.none : words.hint),
    h("ul", {}, few.map(row)),
    fingers.length > 0 && h("details", { key: "fingers" }, h("summary", {}, words.fingers), h("ul", {}, fingers.map(row))),
  );
}

function meter(state: State, name: string, value: number | undefined): Node_ {
  const { channels: words } = strings;
  const puppet = shownPuppet(state);
  const range = rangeOf(puppet, name);
  const shown = value === undefined ? 0 : ranged(range, value);
  const moves = puppet === null ? [] : movedByChannel(puppet, name);
  const selected = state.selection !== null && puppet !== null ? channelOf(puppet, state.selection) : undefined;
  const chosen = state.channel === name || selected === name;
  const fill = h("span", { class: `fill ${sideOf(name)}`, style: `width: ${(100 * shown).toFixed(1)}%` });
  return h(
    "li",
    { key: name, class: value === undefined ? "unknown" : null },
    h(
      "button",
      {
        type: "button",
        class: "meter",
        "aria-pressed": String(chosen),
        "aria-label": words.meter(name, moves),
        title: words.meter(name, moves),
        onclick: () => {
          pickChannel(name);
        },
      },
      h("span", { class: "name" }, words.name(name), moves.length > 0 && h("small", {}, ` → ${moves.join(", ")}`)),
      h("span", { class: "bar", "aria-hidden": "true" }, fill),
    ),
    chosen &&
      h(
        "div",
        { class: "row", key: "range" },
        button(words.find, () => {
          findRange(name);
        }, { hint: words.findHint, disabled: value === undefined }),
        range !== undefined && puppet !== null && button(words.forget, () => {
          edit(withRange(puppet, name, null));
        }, { quiet: true }),
      ),
  );
}
