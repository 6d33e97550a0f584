/** Settings of the filter of joints (docs/smoothing.md). */

import type { Puppet, Smoothing } from "./puppet";

export const STANDARD: Smoothing = { alpha: 0.6, gamma: 0.5, jitter_radius: 0.05, max_deviation: 0.02, prediction: 0 };

export const PRESETS: Readonly<Record<string, Smoothing>> = {
  standard: STANDARD,
  off: { alpha: 1, gamma: 0.5, jitter_radius: 0, max_deviation: 0.02, prediction: 0 },
  sdk: { alpha: 0.5, gamma: 0.5, jitter_radius: 0.05, max_deviation: 0.04, prediction: 0.5 },
  smooth: { alpha: 0.5, gamma: 0.1, jitter_radius: 0.1, max_deviation: 0.1, prediction: 0.5 },
  very: { alpha: 0.3, gamma: 0.3, jitter_radius: 1, max_deviation: 1, prediction: 1 },
};

export function smoothingOf(puppet: Puppet): Smoothing {
  return { ...STANDARD, ...puppet.smoothing };
}

/** The name of the preset that settings are, or "custom". */
export function presetOf(smoothing: Smoothing): string {
  const keys = Object.keys(STANDARD) as (keyof Smoothing)[];
  const found = Object.entries(PRESETS).find(([, preset]) => keys.every((key) => preset[key] === smoothing[key]));
  return found?.[0] ?? "custom";
}
