/** The page before there is a character: what to do, in one sentence, and where. */

import { type Node_, h } from "../dom";
import { chooseFiles, openExample } from "../files";
import { type State, isJoined, update } from "../store";
import { strings } from "../strings";
import { button } from "./parts";

const FALLBACK = [".glb", ".gltf", ".obj", ".off", ".ply", ".stl"];

export function meshSuffixes({ greeting }: State): readonly string[] {
  return greeting?.suffixes.character ?? FALLBACK;
}

export function empty(state: State): Node_ {
  const { empty: words, examples } = strings;
  const suffixes = meshSuffixes(state);
  const working = state.busy.length > 0;
  if (isJoined(state)) {
    return h("main", { class: "empty", key: "empty" }, h("div", { class: "welcome" }, h("h1", {}, words.joined), h("p", {}, words.joinedText)));
  }
  return h(
    "main",
    { class: "empty", key: "empty" },
    h(
      "div",
      { class: "welcome" },
      h("h1", {}, words.title),
      h("p", {}, words.text),
      h(
        "div",
        { class: "row examples" },
        Object.entries(examples).map(([name, title]) =>
          button([h("span", { class: "moving", style: `background-image: url(/assets/${name}.webp)` }), title], () => {
            void openExample(name);
          }, { disabled: working || state.connected !== "open" }),
        ),
      ),
      h("p", { class: "or" }, words.own),
      button(words.choose, () => {
        chooseFiles([...suffixes, ".toml"]);
      }, { disabled: working || state.connected !== "open" }),
      h("p", { class: "small" }, words.formats(suffixes)),
      state.adding &&
        button(words.cancel, () => {
          update({ adding: false });
        }, { quiet: true }),
    ),
  );
}
