/** The right panel: its tabs. */

import { type Node_, h } from "../dom";
import type { Vector } from "../model/vector";
import { type State, type Tab, update } from "../store";
import { strings } from "../strings";
import { limbs } from "./limbs";
import { motion } from "./motion";
import { takes } from "./takes";

const TABS: readonly Tab[] = ["limbs", "motion", "takes"];

export function tabs(state: State, bounds: readonly [Vector, Vector] | null): Node_ {
  const { tab } = state;
  const content = tab === "limbs" ? limbs(state, bounds) : tab === "motion" ? motion(state) : takes(state);
  return h(
    "aside",
    { class: "tabbed", "aria-label": strings[tab].tab, key: "tabs" },
    h(
      "div",
      { class: "tabs", role: "tablist" },
      TABS.map((name, i) =>
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
              update({ tab: name });
            },
            onkeydown: ({ key }: KeyboardEvent) => {
              const step = key === "ArrowRight" ? 1 : key === "ArrowLeft" ? TABS.length - 1 : 0;
              const next = TABS[(i + step) % TABS.length];
              if (step === 0 || next === undefined) return;
              update({ tab: next });
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
