/** The plan of the film, which the server makes: what it shows at a second. */

import type { FilmPlan, Moment } from "../messages";

/** What is shown at a second of the film: between two moments, cameras, bubbles and characters are on their way. */
export function momentAt({ moments, step }: FilmPlan, seconds: number): Moment | null {
  const at = Math.min(Math.max(seconds / step, 0), moments.length - 1);
  const [before, after] = [moments[Math.floor(at)], moments[Math.ceil(at)]];
  if (before === undefined || after === undefined) return null;
  const share = at - Math.floor(at);
  const between = <T extends readonly number[]>(from: T, to: T | undefined): T =>
    (to === undefined ? from : from.map((value, i) => value + share * ((to[i] ?? value) - value))) as unknown as T;
  return {
    ...before,
    views: before.views.map((view) => {
      const next = after.views.find(({ shot }) => shot === view.shot); // a cut has nothing in between
      return {
        ...view,
        eye: between(view.eye, next?.eye),
        target: between(view.target, next?.target),
        bubbles: view.bubbles.map((bubble) => {
          const moved = next?.bubbles.find(({ number }) => number === bubble.number);
          return { ...bubble, middle: between(bubble.middle, moved?.middle), tip: between(bubble.tip, moved?.tip) };
        }),
      };
    }),
    places: Object.fromEntries(Object.entries(before.places).map(([name, place]) => [name, between(place, after.places[name])])),
  };
}
