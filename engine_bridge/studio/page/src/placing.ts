/** What a click on the body does with the chosen tool. */

import { edit, select } from "./actions";
import { JAW, addHandle, addJaw, freeName, handlesOf, jawPoint } from "./model/puppet";
import type { Vector } from "./model/vector";
import { current, shownPuppet, update } from "./store";
import { strings } from "./strings";

/** Put a point of a limb, a jaw or a handle at a click: the point inside the body, and the one on its surface. */
export function put(inside: Vector, surface: Vector, bounds: readonly [Vector, Vector] | null): void {
  const { tool, drawn } = current();
  const puppet = shownPuppet(current());
  if (puppet === null) return;
  if (tool === "limb") {
    update({ drawn: [...drawn, inside] });
    return;
  }
  if (tool === "jaw") {
    const point = bounds === null ? inside : jawPoint(puppet, bounds, inside, surface);
    const [hinge] = drawn;
    if (hinge === undefined) {
      update({ drawn: [point] });
      return;
    }
    edit(addJaw(puppet, hinge, point));
    select({ kind: "limb", name: JAW });
    update({ tool: "select", drawn: [] });
    return;
  }
  const name = freeName(strings.limbs.newHandle, handlesOf(puppet).map((handle) => handle.name));
  edit(addHandle(puppet, name, surface));
  select({ kind: "handle", name });
  update({ tool: "select" });
}
