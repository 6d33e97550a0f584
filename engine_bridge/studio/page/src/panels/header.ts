/** The top line: the face of the page, undo and redo, and in the workshop which character, and save. */

import { closeCharacter, redo, save, show, undo } from "../actions";
import { type Node_, h } from "../dom";
import { chooseFace } from "../face";
import { type Face, type State, isJoined, shownCharacter, update } from "../store";
import { strings } from "../strings";
import { button, choice, select } from "./parts";

const ANOTHER = " another";

export function header(state: State): Node_ {
  const { header: words } = strings;
  const { server, character, puppets, adding } = state;
  const shown = shownCharacter(state);
  const history = state.edited === "film" ? state.film : character === null ? undefined : puppets[character];
  const open = state.connected === "open";
  const joined = isJoined(state);
  return h(
    "header",
    { key: "header" },
    h("span", { class: "brand" }, h("span", { class: "logo", "aria-hidden": "true" }), strings.name),
    !joined && server !== null && server.characters.length > 0 && choice<Face>(words.face, [["film", words.film], ["workshop", words.workshop]], state.face, chooseFace),
    server !== null &&
      shown !== null &&
      state.face === "workshop" &&
      h(
        "div",
        { class: "row", key: "character" },
        select(
          [
            ...server.characters.map(({ name, title }): [string, string] => [name, title || name]),
            ...(joined ? [] : [[ANOTHER, words.another] as const]),
          ],
          adding ? ANOTHER : shown.name,
          (name) => {
            if (name === ANOTHER) update({ adding: true });
            else show(name);
          },
          words.character,
        ),
        !joined && button(words.close, () => {
          void closeCharacter(shown.name);
        }, { quiet: true, label: `${words.close} ${shown.name}`, disabled: !open, name: "close" }),
      ),
    h("span", { class: "space" }),
    shown !== null && !adding && h("div", { class: "row drawers", key: "drawers" }, drawer(state, "left"), drawer(state, "right")),
    shown !== null &&
      !adding &&
      h(
        "div",
        { class: "row edits", key: "edits" },
        button(words.undo, undo, { quiet: true, disabled: !history?.past.length, hint: `${words.undo} (Ctrl+Z)` }),
        button(words.redo, redo, { quiet: true, name: "wide", disabled: !history?.future.length, hint: `${words.redo} (Ctrl+Shift+Z)` }),
        state.face === "workshop" && [
          h("span", { class: "saved wide" }, shown.saved ? words.saved : words.unsaved),
          button(words.save, () => {
            void save(shown.name);
          }, { disabled: !open, hint: `${words.save} (Ctrl+S)`, name: "save" }),
        ],
      ),
  );
}

/** In a narrow window, a side panel is opened and closed. */
function drawer(state: State, side: "left" | "right"): Node_ {
  const open = state.drawer === side;
  const words = strings.header[side];
  return button(words[state.face], () => {
    update({ drawer: open ? null : side });
  }, { pressed: open });
}
