/** The line at the bottom: the status of the service. */

import { invite } from "../actions";
import { type Node_, h } from "../dom";
import { type State, shownCharacter, update } from "../store";
import { strings } from "../strings";
import { button } from "./parts";

export function status(state: State, drawn: number): Node_ {
  const { status: words, banner } = strings;
  const { server, connected } = state;
  const shown = shownCharacter(state);
  const service = server?.service;
  const running = connected === "open" && service?.running === true;
  const again = connected === "lost" && state.greeting !== null; // the page connects again by itself
  const starting = service?.starting === true || connected === "connecting" || again || (connected === "open" && server === null);
  const idle = connected === "open" && service?.problem === "" && server?.characters.length === 0;
  const text =
    connected === "connecting" ? banner.connecting
    : connected !== "open" ? words.away
    : idle ? words.service.idle
    : running ? words.service.running
    : starting ? words.service.starting
    : words.service.stopped;
  const numbers = running && server !== null && state.face === "workshop" ? server.status : null;
  return h(
    "footer",
    { "aria-label": words.label, key: "status" },
    h("span", { class: `lamp ${running || idle ? "on" : starting ? "starting" : "off"}`, "aria-hidden": "true" }),
    h("span", {}, text),
    numbers !== null && h(
      "details",
      { class: "numbers", key: "numbers" },
      h("summary", {}, strings.details),
      h("span", { key: "fps" }, words.fps(numbers.fps)),
      drawn > 0 && h("span", { key: "drawn" }, words.drawn(drawn)),
      numbers.latency_ms !== null && h("span", { key: "latency" }, words.latency(numbers.latency_ms)),
      h("span", { key: "clients" }, words.clients(numbers.clients)),
      h("span", { key: "drops" }, words.drops(numbers.drops)),
    ),
    h("span", { class: "space" }),
    shown !== null && shown.vertices > 0 && state.face === "workshop" && h("span", { key: "vertices", class: "vertices" }, words.vertices(shown.vertices)),
    button(words.keys, () => {
      update({ help: true });
    }, { quiet: true, key: "keys", name: "wide" }),
    connected === "open" &&
      button(words.invite, () => {
        void invite();
      }, { quiet: true, key: "invite" }),
  );
}
