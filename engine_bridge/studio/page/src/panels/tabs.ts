/** The right panel: its tabs, which the two faces have of their own. */

import { type Node_, h } from "../dom";
import type { Vector } from "../model/vector";
import { type FilmTab, type State, type Tab, update } from "../store";
import { strings } from "../strings";
import { character } from "./character";
import { limbs } from "./limbs";
import { motion } from "./motion";
import { scene } from "./scene";
import { takes } from "./takes";

const WORKSHOP: readonly Tab[] = ["limbs", "motion", "takes"];
const FILM: readonly FilmTab[] = ["scene", "character"];

/** The tabs; `bounds` is the box of the shown character at rest, and `height` its height in metres. */
export function tabs(state: State, bounds: readonly [Vector, Vector] | null, height: number | null): Node_ {
  if (state.face === "film") {
    return panel(FILM, state.filmTab, state.filmTab === "scene" ? scene(state) : character(state, height), (filmTab) => {
      update({ filmTab });
    });
  }
  const { tab } = state;
  return panel(WORKSHOP, tab, tab === "limbs" ? limbs(state, bounds) : tab === "motion" ? motion(state) : takes(state), (next) => {
    update({ tab: next });
  });
}

function panel<T extends Tab | FilmTab>(names: readonly T[], tab: T, content: Node_, choose: (tab: T) => void): Node_ {
  return h(
    "aside",
    { class: "right tabbed", "aria-label": strings[tab].tab, key: "tabs" },
    h(
      "div",
      { class: "tabs", role: "tablist" },
      names.map((name, i) =>
        h(
          "button",
          {
            type: "button",
            role: "tab",
            id: `tab-${name}`,
            "aria-selected": String(name === tab),
            "aria-controls": "tab-panel",
            tabindex: name === tab ? 0 : -1,
            onclick: () => {
              choose(name);
            },
            onkeydown: ({ key }: KeyboardEvent) => {
              const step = key === "ArrowRight" ? 1 : key === "ArrowLeft" ? names.length - 1 : 0;
              const next = names[(i + step) % names.length];
              if (step === 0 || next === undefined) return;
              choose(next);
              document.getElementById(`tab-${next}`)?.focus();
            },
          },
          strings[name].tab,
        ),
      ),
    ),
    h("div", { class: "panel", role: "tabpanel", id: "tab-panel", "aria-labelledby": `tab-${tab}`, tabindex: -1 }, content),
  );
}
