/** The whole page as a function of the state. */

import { type Child, h } from "./dom";
import type { Vector } from "./model/vector";
import { banner } from "./panels/banner";
import { characters } from "./panels/characters";
import { empty } from "./panels/empty";
import { covers } from "./panels/film";
import { header } from "./panels/header";
import { performer } from "./panels/performer";
import { recording } from "./panels/recording";
import { status } from "./panels/status";
import { strip } from "./panels/strip";
import { tabs } from "./panels/tabs";
import { toolHint, toolbar } from "./panels/toolbar";
import { type State, isWorking } from "./store";
import { strings } from "./strings";

/** What the page says of the 3D view. */
export interface Shown {
  readonly drawnPerSecond: number;
  has: (character: string) => boolean;
  bounds: (character: string) => readonly [Vector, Vector] | null;
  /** How tall a character is, in metres, if its row in the scene does not say so. */
  height: (character: string) => number | null;
  fit: () => void;
}

export function page(state: State, viewer: Shown): readonly Child[] {
  const { character, server } = state;
  const working = isWorking(state);
  const started = server !== null && server.characters.length > 0 && character !== null && !state.adding;
  return [
    header(state),
    banner(state),
    started
      ? h(
          "main",
          { class: `studio ${state.face} ${state.drawer === null ? "" : `with-${state.drawer}`} ${working ? "working" : ""}`, key: "studio" },
          state.face === "film" ? characters(state) : performer(state),
          h(
            "div",
            { class: "middle" },
            h("h1", { class: "hidden" }, `${strings.title}: ${character}`),
            h("div", { class: "place", key: "place", raw: true }),
            toolbar(state, () => {
              viewer.fit();
            }),
            state.face === "workshop" && toolHint(state),
            recording(state),
            state.face === "film" && h("div", { class: "shown-film", key: "shown-film", raw: true, "aria-hidden": "true" }),
            !viewer.has(character) && h("p", { class: "preparing", key: "preparing" }, strings.viewer.preparing(character)),
          ),
          tabs(state, viewer.bounds(character), viewer.height(character)),
          strip(state),
        )
      : empty(state),
    status(state, viewer.drawnPerSecond),
    covers(state),
    state.dropping && h("div", { class: "dropping", key: "dropping" }, h("p", {}, strings.empty.drop), h("p", { class: "small" }, strings.empty.dropHint)),
  ];
}
