/** What the view shows while a take is recorded: a red frame, and a clock that runs. */

import { type Child, h } from "../dom";
import type { State } from "../store";
import { strings } from "../strings";

export function recording({ server, count }: State): Child {
  if (server?.recording == null || count !== null) return null;
  return h(
    "div",
    { class: "recording-frame", key: "recording", role: "status" },
    h("p", {}, strings.film.recording, h("span", { class: "recorded", "aria-hidden": "true", raw: true })),
  );
}

/** A clock: `1:05`. */
export function clock(seconds: number): string {
  return `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
}
