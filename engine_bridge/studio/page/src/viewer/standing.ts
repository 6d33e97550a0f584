/** Where characters stand in the film: choosing one by a click, and dragging it over the floor. */

import { type Box3, Plane, type Ray, Vector3 } from "three";

import type { FilmCharacter } from "../messages";
import { FARTHEST } from "../model/scene";

export type Draft = { readonly name: string } & Partial<FilmCharacter>;

const FLOOR = new Plane(new Vector3(0, 1, 0), 0);

/** The character whose box a ray meets first. */
export function characterAt(ray: Ray, boxes: ReadonlyMap<string, Box3>): string | null {
  let [best, least] = [null as string | null, Infinity];
  for (const [name, box] of boxes) {
    const met = ray.intersectBox(box, new Vector3());
    if (met === null || met.distanceTo(ray.origin) >= least) continue;
    [best, least] = [name, met.distanceTo(ray.origin)];
  }
  return best;
}

/** The row of a character that is dragged over the floor from one ray to another; null where a ray does not meet it. */
export function dragged(row: FilmCharacter, from: Ray, to: Ray): Draft | null {
  const [a, b] = [from, to].map((ray) => ray.intersectPlane(FLOOR, new Vector3()));
  if (a == null || b == null) return null;
  const [x, z] = row.position ?? [0, 0];
  const round = (value: number): number => Math.round(100 * Math.min(Math.max(value, -FARTHEST), FARTHEST)) / 100;
  return { name: row.name, position: [round(x + b.x - a.x), round(z + b.z - a.z)] };
}
