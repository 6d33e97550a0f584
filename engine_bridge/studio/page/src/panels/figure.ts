/** The performer as a skeleton figure whose joints can be chosen. */

import { pickJoint } from "../actions";
import { type Node_, h } from "../dom";
import { type Joint, BONES, JOINTS, sideOf } from "../model/skeleton";
import { handlesOf, jointsOf, limbsOf, type Puppet } from "../model/puppet";
import { type State, shownPuppet } from "../store";
import { strings } from "../strings";

const WIDTH = 240;
const HEIGHT = 300;

/** A standing body seen from the front, the performer's left on the right: x and y in metres from the hips. */
const STANDING: Readonly<Record<Joint, readonly [number, number]>> = {
  hip_center: [0, 0],
  spine: [0, 0.2],
  shoulder_center: [0, 0.5],
  head: [0, 0.74],
  shoulder_left: [0.18, 0.46],
  elbow_left: [0.34, 0.26],
  wrist_left: [0.44, 0.04],
  hand_left: [0.5, -0.08],
  shoulder_right: [-0.18, 0.46],
  elbow_right: [-0.34, 0.26],
  wrist_right: [-0.44, 0.04],
  hand_right: [-0.5, -0.08],
  hip_left: [0.1, -0.06],
  knee_left: [0.15, -0.46],
  ankle_left: [0.17, -0.84],
  foot_left: [0.25, -0.93],
  hip_right: [-0.1, -0.06],
  knee_right: [-0.15, -0.46],
  ankle_right: [-0.17, -0.84],
  foot_right: [-0.25, -0.93],
};

/** Positions of the joints in the figure: those of a frame (x, y, z, confidence of each), or of a standing body. */
export function places(joints: Float32Array | null): (readonly [number, number])[] {
  const hips = joints === null ? Number.NaN : (joints[0] ?? Number.NaN);
  const scale = 150;
  return JOINTS.map((joint, i) => {
    let [x, y] = STANDING[joint];
    if (joints !== null && Number.isFinite(hips)) {
      const [px, py] = [joints[4 * i] ?? Number.NaN, joints[4 * i + 1] ?? Number.NaN];
      if (Number.isFinite(px) && Number.isFinite(py)) [x, y] = [hips - px, py - (joints[1] ?? 0)];
    }
    const clamp = (value: number, most: number): number => Math.min(most - 12, Math.max(12, value));
    return [clamp(WIDTH / 2 + scale * x, WIDTH), clamp(136 - scale * y, HEIGHT)] as const;
  });
}

/** The joint next to another in a direction of the arrow keys. */
function beside(at: readonly (readonly [number, number])[], from: number, dx: number, dy: number): number {
  const [x, y] = at[from] ?? [0, 0];
  let [best, least] = [from, Infinity];
  at.forEach(([px, py], i) => {
    const along = (px - x) * dx + (py - y) * dy;
    const across = Math.abs((px - x) * dy - (py - y) * dx);
    if (i !== from && along > 2 && along + 2 * across < least) [best, least] = [i, along + 2 * across];
  });
  return best;
}

function movedBy(puppet: Puppet | null, joint: Joint): string[] {
  if (puppet === null) return [];
  const limbs = limbsOf(puppet).filter(({ name }) => jointsOf(puppet, { kind: "limb", name }).includes(joint));
  const handles = handlesOf(puppet).filter(({ name }) => jointsOf(puppet, { kind: "handle", name }).includes(joint));
  return [...limbs, ...handles].map(({ name }) => name);
}

let focus = 3;

export function figure(state: State, joints: Float32Array | null, emphasise: (joint: Joint | null) => void): Node_ {
  const puppet = shownPuppet(state);
  const at = places(joints);
  const chosen = puppet !== null && state.selection !== null ? jointsOf(puppet, state.selection) : [];
  const lost = (i: number): boolean => joints !== null && (joints[4 * i + 3] ?? 0) === 0;
  return h(
    "svg",
    { class: "figure", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "group", "aria-label": strings.performer.figure, key: "figure" },
    BONES.map(([from, to], i) => {
      const [[x1, y1], [x2, y2]] = [at[from] ?? [0, 0], at[to] ?? [0, 0]];
      return h("line", { key: `bone${i}`, x1, y1, x2, y2, class: `bone ${sideOf(JOINTS[to] ?? "")}` });
    }),
    JOINTS.map((joint, i) => {
      const [x, y] = at[i] ?? [0, 0];
      const classes = ["joint", sideOf(joint), chosen.includes(joint) && "moves", state.joint === joint && "waits", lost(i) && "lost"];
      const label = strings.performer.joint(joint, movedBy(puppet, joint));
      return h(
        "g",
        {
          key: joint,
          id: `joint-${joint}`,
          class: classes.filter(Boolean).join(" "),
          role: "button",
          tabindex: i === focus ? 0 : -1,
          "aria-label": label,
          "aria-pressed": String(chosen.includes(joint) || state.joint === joint),
          transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})`,
          onclick: () => {
            focus = i;
            pickJoint(joint);
          },
          onpointerenter: () => {
            emphasise(joint);
          },
          onpointerleave: () => {
            emphasise(null);
          },
          onfocus: () => {
            emphasise(joint);
          },
          onblur: () => {
            emphasise(null);
          },
          onkeydown: (event: KeyboardEvent) => {
            const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
            if (event.key === "Enter" || event.key === " ") pickJoint(joint);
            else if (way === undefined) return;
            else {
              focus = beside(at, i, way[0] ?? 0, way[1] ?? 0);
              const next = JOINTS[focus];
              const target = next === undefined ? null : document.getElementById(`joint-${next}`);
              target?.setAttribute("tabindex", "0");
              target?.focus();
            }
            event.preventDefault();
          },
        },
        h("title", {}, label),
        h("circle", { r: 12, class: "reach" }),
        h("circle", { r: joint === "head" ? 9 : 5.5, class: "dot" }),
      );
    }),
  );
}
