/** The performer: the source, the figure, and what the sensor sees. */

import { calibrate, chooseSource, chooseUser, look, perform } from "../actions";
import { type Child, type Node_, h } from "../dom";
import type { CharacterState, PerformerState } from "../messages";
import { type State, isJoined, shownCharacter } from "../store";
import { strings } from "../strings";
import { button } from "./parts";
import { seen } from "./seen";
import { chosenSource, sources } from "./sources";

export function performer(state: State): Node_ {
  const { performer: words } = strings;
  const { server, choosing } = state;
  return h(
    "aside",
    { class: "left", "aria-label": words.title, key: "performer" },
    h("h2", {}, choosing ? strings.sources.title : words.title),
    choosing ? sources(state) : [sourceLine(state), server?.source.kind === "none" ? start() : body(state)],
  );
}

function sourceLine(state: State): Node_ {
  const { performer: words } = strings;
  const text = chosenSource(state);
  return h(
    "div",
    { class: "source", key: "source" },
    h("span", { title: text }, text),
    !isJoined(state) && button(words.change, () => {
      void chooseSource();
    }),
  );
}

/** The first step for a character without a performer. */
function start(): Node_ {
  return h(
    "div",
    { class: "stack", key: "start" },
    h("p", { class: "small" }, strings.performer.waiting),
    button(strings.sources.use(strings.performances.walk ?? "walk"), () => {
      void perform({ kind: "example", name: "walk" });
    }, { primary: true }),
  );
}

function body(state: State): Node_ {
  const { performer: words } = strings;
  const { selection, joint, server } = state;
  const shown = shownCharacter(state);
  const hint =
    joint !== null ? strings.viewer.mapHint(joint)
    : selection !== null ? words.hintPart(selection.name)
    : words.hint;
  return h(
    "div",
    { class: "stack", key: "body" },
    h("div", { class: "figure-box", raw: true, key: "figure" }),
    h("p", { class: `hint ${joint === null ? "" : "strong"}`, "aria-live": "polite" }, hint),
    performers(server?.performers ?? [], shown),
    shown !== null &&
      button(words.calibrate, () => {
        void calibrate(shown.name);
      }, { hint: words.calibrateHint }),
    button(state.looking ? words.lookHide : words.look, () => {
      void look(!state.looking);
    }, { pressed: state.looking }),
    state.looking && seen(state),
    h("div", { class: "meters-box", raw: true, key: "meters" }),
  );
}

/** The performers in view, and which of them drives the shown character; with the first choice, the service decides. */
export function performers(all: readonly PerformerState[], shown: CharacterState | null): Child {
  const { performer: words } = strings;
  const here = all.filter(({ stage }) => stage === shown?.stage);
  return [
    here.map(({ user, state: doing, character }) =>
      h(
        "div",
        { class: "row", key: `user${user}` },
        h("p", { class: "small" }, words.user(user, words.states[doing] ?? doing)),
        shown !== null &&
          character !== shown.name &&
          button(words.choose(user), () => {
            void chooseUser(shown.name, user);
          }, { quiet: true }),
      ),
    ),
    shown !== null &&
      here.length > 1 &&
      button(words.automatic, () => {
        void chooseUser(shown.name, null);
      }, { quiet: true, key: "automatic" }),
  ];
}
