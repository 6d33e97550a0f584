/** What a visitor's screen shows, as a function of what the service reports. */

import type { ServiceReport } from "../messages";

export type Phase =
  | { readonly kind: "attract" | "stand" | "raise" }
  | { readonly kind: "count"; readonly seconds: number }
  | { readonly kind: "recording" }
  | { readonly kind: "making" }
  | { readonly kind: "film"; readonly code: string };

/** Time for which the screen says that a film is being made; afterwards, a corner says so, in milliseconds. */
export const MAKING_MS = 30_000;

/** Time for which a new film has the whole screen while a visitor stands there, in milliseconds. */
export const FILM_MS = 45_000;

/** Time for which it has the screen if the next visitor moves the character meanwhile, in milliseconds. */
export const SHORT_FILM_MS = 20_000;

/** What a screen has seen last of films: a code, whether it is made, since when, and who moved the character then. */
export interface Seen {
  readonly code: string;
  readonly made: boolean;
  readonly since: number;
  readonly users: readonly number[];
}

type Report = Pick<ServiceReport, "stages" | "clips">;

/** Remember when the newest film began to be made, or when a film was offered first; `now` is in milliseconds. */
export function noticed(report: Report, before: Report | null, seen: Seen | null, now: number): Seen | null {
  const known = new Map(before?.clips.map(({ code, seconds_left }) => [code, seconds_left !== null]));
  const changed = report.clips.findLast(({ code, seconds_left }) => known.get(code) !== (seconds_left !== null));
  if (changed === undefined) return seen;
  return { code: changed.code, made: changed.seconds_left !== null, since: now, users: performing(report) };
}

export function phaseOf(report: Report, seen: Seen | null, now: number): Phase {
  const count = Math.max(0, ...report.stages.map((stage) => stage.count_in));
  if (count > 0) return { kind: "count", seconds: count };
  if (report.stages.some((stage) => stage.recording !== null)) return { kind: "recording" };
  const users = performing(report);
  if (seen !== null && report.clips.some(({ code }) => code === seen.code)) {
    const others = users.some((user) => !seen.users.includes(user));
    const lasts = !seen.made ? MAKING_MS : others ? SHORT_FILM_MS : FILM_MS;
    if (now - seen.since < lasts) return seen.made ? { kind: "film", code: seen.code } : { kind: "making" };
  }
  if (users.length > 0) return { kind: "raise" };
  return { kind: report.stages.some((stage) => stage.users.length > 0) ? "stand" : "attract" };
}

/** The code of the newest film that is there, which a corner of the screen shows. */
export function newest({ clips }: Pick<Report, "clips">): string | null {
  return clips.findLast((each) => each.seconds_left !== null)?.code ?? null;
}

function performing({ stages }: Report): number[] {
  return stages.flatMap((stage) => stage.users.filter((user) => user.state === "performing").map((user) => user.user));
}
