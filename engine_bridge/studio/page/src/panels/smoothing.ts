/** Smoothing: presets, sliders, and a plot of their effect on a joint. */

import { plot as choosePlot, edit, preview } from "../actions";
import { type Node_, h } from "../dom";
import type { Puppet, Smoothing } from "../model/puppet";
import { path, range } from "../model/plot";
import { JOINTS, type Joint } from "../model/skeleton";
import { PRESETS, presetOf, smoothingOf } from "../model/smoothing";
import type { SmoothingReply } from "../messages";
import type { State } from "../store";
import { strings } from "../strings";
import { field, section, select, slider } from "./parts";

const FRAME = { width: 264, height: 90 };

const LIMITS = {
  alpha: { min: 0.05, max: 1, step: 0.05 },
  gamma: { min: 0, max: 1, step: 0.05 },
  jitter_radius: { min: 0, max: 1, step: 0.01 },
  max_deviation: { min: 0.01, max: 1, step: 0.01 },
  prediction: { min: 0, max: 3, step: 0.1 },
} as const;

let asked = "";

export function smoothing(state: State, puppet: Puppet): Node_ {
  const { motion: words } = strings;
  const values = smoothingOf(puppet);
  show(values);
  const change = (next: Smoothing): void => {
    edit({ ...puppet, smoothing: next });
  };
  const names = Object.keys(words.presetNames).map((name) => [name, words.presetNames[name] ?? name] as const);
  const preset = presetOf(values);
  return section(
    words.smoothing,
    field(
      words.presets,
      select(names.filter(([name]) => name !== "custom" || preset === "custom"), preset, (name) => {
        const chosen = PRESETS[name];
        if (chosen !== undefined) change(chosen);
      }),
    ),
    h(
      "details",
      { key: "smoothing" },
      h("summary", {}, strings.details),
      (Object.keys(LIMITS) as (keyof typeof LIMITS)[]).map((key) =>
        slider(
          words[key],
          values[key] ?? LIMITS[key].max,
          LIMITS[key],
          (value) => {
            change({ ...values, [key]: value });
          },
          (value) => {
            show({ ...values, [key]: value });
          },
        ),
      ),
      field(
        words.plotted,
        select(
          [["", words.test], ...JOINTS.map((joint) => [joint, words.live(joint)] as const)],
          state.plotted ?? "",
          (joint) => {
            void choosePlot(joint === "" ? null : joint);
          },
        ),
      ),
      state.preview !== null && plot(state.preview, state.plotted),
      state.preview === null && state.plotted !== null && h("p", { class: "small", role: "status" }, words.noJoint),
    ),
  );
}

/** Request the effect of settings, once. */
function show(values: Smoothing): void {
  const key = JSON.stringify(values);
  if (key === asked) return;
  asked = key;
  void preview(values);
}

function plot({ times, measured, smoothed, measured_mm, jitter_mm, lag_ms }: SmoothingReply, joint: Joint | null): Node_ {
  const { motion: words } = strings;
  const across = range(times);
  const up = range(measured, smoothed);
  const line = (values: readonly number[]): string => path(times, values, across, up, FRAME);
  return h(
    "figure",
    { key: "plot" },
    h(
      "svg",
      { class: "plot", viewBox: `-2 -4 ${FRAME.width + 4} ${FRAME.height + 8}`, role: "img", "aria-label": words.plot(joint, jitter_mm, lag_ms) },
      h("path", { class: "measured", d: line(measured) }),
      h("path", { class: "smoothed", d: line(smoothed) }),
    ),
    h(
      "figcaption",
      {},
      h("span", { class: "key measured" }, words.measured),
      h("span", { class: "key smoothed" }, words.smoothed),
      h("span", {}, words.jitter(jitter_mm, measured_mm)),
      h("span", {}, lag_ms === null ? words.still : words.lag(lag_ms)),
    ),
  );
}
