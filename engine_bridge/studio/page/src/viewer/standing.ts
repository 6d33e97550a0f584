/** Where characters stand in the film: putting them there, choosing one by a click, and dragging it over the floor. */

import { type Box3, Plane, type Ray, Vector3 } from "three";

import type { FilmCharacter } from "../messages";
import { FARTHEST, rowOf } from "../model/scene";
import type { State } from "../store";
import type { Figure } from "./figure";

export type Draft = { readonly name: string } & Partial<FilmCharacter>;

const FLOOR = new Plane(new Vector3(0, 1, 0), 0);

/** Let characters stand as a scene says, and one as it is dragged; those without a place in the scene stand side by side. */
export function stand(
  figures: ReadonlyMap<string, Figure>,
  scene: State["film"]["present"]["scene"],
  draft: Draft | null,
  face: State["face"],
): void {
  let right: number | null = null;
  for (const [name, figure] of figures) {
    if (figure.mesh === null) continue;
    const row = rowOf(scene, name);
    figure.stand({ ...row, ...(draft?.name === name ? draft : {}) });
    figure.tint(face === "film" ? (row?.color ?? null) : null);
    if (row?.position != null) continue;
    const { min, max } = figure.box();
    if (right !== null) figure.group.position.x = right + 0.15 * (max.x - min.x) - min.x;
    right = figure.box().max.x;
  }
}

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
