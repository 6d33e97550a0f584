/** Messages: problems with their fixes, and the work in progress. */

import { cancel } from "../actions";
import { type Child, type Node_, h } from "../dom";
import { type State, update } from "../store";
import { strings } from "../strings";
import { button } from "./parts";

/** Time after which a message says how long something has taken, in seconds. */
const LEAST_SECONDS = 2;

/** Share that is done from which on the rest can be estimated. */
const LEAST_SHARE = 0.05;

interface Words {
  readonly level: string;
  readonly text: string;
  readonly fix: string;
  readonly dismiss: boolean;
}

function words({ connected, refusal, notice, server, greeting }: State): Words | null {
  const { banner } = strings;
  if (connected === "refused") {
    // a studio that was started again has new addresses: nothing is wrong
    if (greeting !== null) return { level: "info", text: banner.restarted, fix: banner.refusedFix, dismiss: false };
    return { level: "error", text: refusal || banner.refused, fix: banner.refusedFix, dismiss: false };
  }
  if (connected === "lost") return { level: "warning", text: banner.lost, fix: banner.lostFix, dismiss: false };
  if (notice !== null) return { ...notice, fix: "", dismiss: true };
  if (server === null || server.banner.level === "none") return null;
  const isSaid = server.characters.length === 0 && server.banner.level === "info"; // on the empty page itself
  if (!isSaid) return { ...server.banner, dismiss: false };
  return null;
}

export function banner(state: State): Node_ {
  const shown = words(state);
  const busy = state.busy.at(-1);
  const jobs = (state.server?.jobs ?? []).filter((job) => job.state === "running");
  return h(
    "div",
    { class: "messages", key: "messages" },
    h(
      "div",
      { role: shown?.level === "error" ? "alert" : "status", class: "slot" },
      shown !== null &&
        h(
          "div",
          { class: `banner ${shown.level}` },
          h("p", {}, h("strong", {}, shown.text), shown.fix !== "" && ` ${shown.fix}`),
          shown.dismiss &&
            button(strings.banner.dismiss, () => {
              update({ notice: null });
            }, { quiet: true }),
        ),
    ),
    h(
      "div",
      { role: "status", class: "slot" },
      jobs.length === 0 && busy !== undefined && h("div", { class: "banner busy" }, h("span", { class: "spinner", "aria-hidden": "true" }), h("p", {}, busy, waited(state, busy))),
      jobs.map(({ job, title, text, fraction }) => {
        const now = state.progress[job] ?? { text, fraction };
        return h(
          "div",
          { class: "banner busy", key: job },
          h("p", {}, title, waited(state, job, now.fraction), now.text !== "" && h("small", {}, now.text)),
          h("progress", { max: 1, value: now.fraction > 0 ? String(now.fraction) : null, "aria-label": title }),
          button(strings.takes.cancel, () => {
            void cancel(job);
          }, { quiet: true, label: `${strings.takes.cancel}: ${title}` }),
        );
      }),
    ),
  );
}

/** For how long something has been going on, and how long it still takes as far as its share that is done says so. */
function waited({ since }: State, key: string, fraction = 0): Child {
  const begun = since[key];
  const seconds = begun === undefined ? 0 : (performance.now() - begun) / 1000;
  if (seconds < LEAST_SECONDS) return null;
  const left = fraction > LEAST_SHARE ? (seconds * (1 - fraction)) / fraction : null;
  return h("small", { class: "waited" }, left === null ? strings.banner.waited(seconds) : strings.banner.left(left));
}
