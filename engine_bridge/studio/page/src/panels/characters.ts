/** The left panel of the film: the characters, each with its moving picture, and who moves them. */

import { look, show } from "../actions";
import { type Child, type Node_, h } from "../dom";
import type { CharacterState } from "../messages";
import { titleOf } from "../model/scene";
import { type State, isJoined, shownCharacter, update } from "../store";
import { strings } from "../strings";
import { button } from "./parts";
import { performers } from "./performer";
import { seen } from "./seen";
import { chosenSource, examples, recordings, you } from "./sources";

export function characters(state: State): Node_ {
  const { characters: words } = strings;
  const { server } = state;
  const live = server?.source.kind === "live";
  return h(
    "aside",
    { class: "left characters", "aria-label": words.title, key: "characters" },
    h("h2", {}, words.title),
    h("ul", { class: "cards" }, (server?.characters ?? []).map((each) => card(state, each))),
    !isJoined(state) && [
      button(words.add, () => {
        update({ adding: true });
      }, { key: "add" }),
      h("h2", {}, words.who),
      h("p", { class: "source" }, h("span", {}, chosenSource(state))),
      live && [
        performers(server.performers, shownCharacter(state)),
        button(state.looking ? words.lookHide : words.look, () => {
          void look(!state.looking);
        }, { pressed: state.looking, key: "look" }),
        state.looking && seen(state),
      ],
      you(state),
      examples(state),
      recordings(state),
    ],
  );
}

function card(state: State, { name, title }: CharacterState): Node_ {
  const { characters: words } = strings;
  const takes = state.film.present.takes.filter(({ character }) => character === name).length;
  return h(
    "li",
    { key: name },
    h(
      "button",
      {
        type: "button",
        class: "card",
        "aria-pressed": String(name === state.character),
        onclick: () => {
          show(name);
        },
      },
      portrait(state, name),
      h("span", { class: "name" }, titleOf(name, title)),
      h("small", {}, words.takes(takes)),
    ),
  );
}

/** A character's moving picture; an empty one until the character has been drawn. */
export function portrait({ portraits }: State, name: string): Child {
  const url = portraits[name];
  return h("span", { class: "moving", style: url === undefined ? "" : `background-image: url(${url})`, key: "picture" });
}
