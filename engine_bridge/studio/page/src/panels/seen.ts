/** What the sensor sees: its image with the joints drawn over it, and the problems if no performer is found. */

import { type Child, type Node_, h } from "../dom";
import type { LookReply, SeenPerformer } from "../messages";
import { BONES, JOINTS, sideOf } from "../model/skeleton";
import type { State } from "../store";
import { strings } from "../strings";

export function seen({ look }: State): Node_ {
  const { performer: words } = strings;
  if (look === null) return h("p", { class: "small", key: "seen", role: "status" }, words.lookWait);
  return h(
    "div",
    { class: "look", key: "seen", reveal: true },
    look.picture === "" ? h("p", { class: "small" }, words.noPicture) : picture(look),
    look.problems.map(({ text, fix }) => h("p", { class: "small" }, h("strong", {}, text), fix === "" ? "" : ` ${fix}`)),
    look.performers.map(({ text }) => h("p", { class: "small" }, text)),
    look.problems.length === 0 && h("p", { class: "small" }, words.lookFine),
  );
}

function picture({ picture: jpeg, width, height, performers }: LookReply): Node_ {
  return h(
    "div",
    { class: "sensor", key: "sensor" },
    h("img", { src: `data:image/jpeg;base64,${jpeg}`, alt: strings.performer.picture, width, height }),
    h(
      "svg",
      { viewBox: `0 0 ${width} ${height}`, "aria-hidden": "true" },
      performers.map((each) => skeleton(each, width, height)),
    ),
  );
}

function skeleton({ user, joints }: SeenPerformer, width: number, height: number): Child {
  if (joints === null) return null;
  const places = joints.map((place) => (place === null ? null : ([place[0] * width, place[1] * height] as const)));
  return h(
    "g",
    { key: `user${user}` },
    BONES.map(([from, to]) => {
      const [a, b] = [places[from] ?? null, places[to] ?? null];
      if (a === null || b === null) return null;
      return h("line", { x1: a[0], y1: a[1], x2: b[0], y2: b[1], class: `bone ${sideOf(JOINTS[to] ?? "")}` });
    }),
    places.map((place, i) => place !== null && h("circle", { cx: place[0], cy: place[1], r: height / 90, class: sideOf(JOINTS[i] ?? "") })),
  );
}
