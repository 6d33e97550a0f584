/** Bones and handles drawn over the character, and which of them is under the pointer. */

import { type Part, type Puppet, handlesOf, jointsOf, limbsOf } from "../model/puppet";
import { type Joint, type Side, sideOf } from "../model/skeleton";
import { type Vector, toSegment } from "../model/vector";

/** Radius around a point of a limb or a handle in which the pointer selects it, in pixels. */
export const REACH = 12;

export interface Marks {
  readonly limbs: readonly { name: string; side: Side; points: readonly (Vector | null)[] }[];
  readonly handles: readonly { name: string; side: Side; point: Vector | null }[];
}

/** The positions of all limbs and handles on the screen: x, y in pixels, and depth. */
export function marksOf(puppet: Puppet, project: (part: Part, point: Vector) => Vector | null): Marks {
  return {
    limbs: limbsOf(puppet).map(({ name, points }) => ({
      name,
      side: sideOf(name),
      points: points.map((point, i) => project({ kind: "limb", name, point: i }, point)),
    })),
    handles: handlesOf(puppet).map(({ name, position }) => ({
      name,
      side: sideOf(name),
      point: project({ kind: "handle", name }, position),
    })),
  };
}

/** The part at a position on the screen: handles and points before bones, the nearest first. */
export function partAt(marks: Marks, x: number, y: number): Part | null {
  const place: Vector = [x, y, 0];
  const flat = ([px, py]: Vector): Vector => [px, py, 0];
  const best: { distance: number; part: Part | null } = { distance: REACH, part: null };
  const offer = (distance: number, part: Part): void => {
    if (distance <= best.distance) Object.assign(best, { distance, part });
  };
  for (const { name, points } of marks.limbs) {
    points.forEach((point, i) => {
      if (point !== null) offer(toSegment(place, flat(point), flat(point)).distance, { kind: "limb", name, point: i });
    });
  }
  for (const { name, point } of marks.handles) {
    if (point !== null) offer(toSegment(place, flat(point), flat(point)).distance, { kind: "handle", name });
  }
  if (best.part !== null) return best.part;
  for (const { name, points } of marks.limbs) {
    for (let i = 1; i < points.length; i++) {
      const [from, to] = [points[i - 1], points[i]];
      if (from && to) offer(toSegment(place, flat(from), flat(to)).distance, { kind: "limb", name });
    }
  }
  return best.part;
}

export interface Colours {
  readonly left: string;
  readonly right: string;
  readonly middle: string;
  readonly accent: string;
  readonly edge: string;
  readonly text: string;
  readonly panel: string;
  readonly stage: string;
}

export interface Emphasis {
  readonly selection: Part | null;
  readonly hover: Part | null;
  /** Names of limbs and handles that a joint moves. */
  readonly moved: ReadonlySet<string>;
  readonly drawn: readonly (Vector | null)[];
}

export function drawMarks(context: CanvasRenderingContext2D, marks: Marks, colours: Colours, emphasis: Emphasis): void {
  const { selection, hover, moved } = emphasis;
  for (const { name, side, points } of marks.limbs) {
    const chosen = selection?.kind === "limb" && selection.name === name;
    const strong = chosen || moved.has(name) || (hover?.kind === "limb" && hover.name === name);
    for (let i = 1; i < points.length; i++) {
      const [from, to] = [points[i - 1], points[i]];
      if (from && to) bone(context, from, to, strong ? 6 : 4, chosen ? colours.accent : colours[side], colours.edge);
    }
  }
  for (const { name, side, points } of marks.limbs) {
    const chosen = selection?.kind === "limb" && selection.name === name;
    points.forEach((point, i) => {
      if (point === null) return;
      const exactly = chosen && selection.point === i;
      const over = hover?.kind === "limb" && hover.name === name && hover.point === i;
      disc(context, point, exactly ? 7 : over ? 6 : 4.5, chosen ? colours.accent : colours[side], exactly ? colours.text : colours.edge);
    });
  }
  for (const { name, side, point } of marks.handles) {
    if (point === null) continue;
    const chosen = selection?.kind === "handle" && selection.name === name;
    const over = moved.has(name) || (hover?.kind === "handle" && hover.name === name);
    diamond(context, point, chosen || over ? 9 : 7, chosen ? colours.accent : colours[side], chosen ? colours.text : colours.edge);
  }
  emphasis.drawn.forEach((point, i) => {
    const before = emphasis.drawn[i - 1];
    if (point && before) bone(context, before, point, 4, colours.accent, colours.edge);
    if (point) disc(context, point, 5, colours.accent, colours.edge);
  });
  const label = hover ?? selection;
  const at = label === null ? null : placeOf(marks, label);
  if (label !== null && at !== null) tag(context, label.name, at, colours);
}

function placeOf(marks: Marks, part: Part): Vector | null {
  if (part.kind === "handle") return marks.handles.find(({ name }) => name === part.name)?.point ?? null;
  const points = marks.limbs.find(({ name }) => name === part.name)?.points ?? [];
  return points[part.point ?? Math.floor(points.length / 2)] ?? null;
}

/** A bone as a thin kite: broad near its root, pointed at its tip. */
function bone(context: CanvasRenderingContext2D, from: Vector, to: Vector, width: number, fill: string, edge: string): void {
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  const size = Math.hypot(dx, dy) || 1;
  const [nx, ny] = [(-dy / size) * width, (dx / size) * width];
  const [mx, my] = [from[0] + dx * 0.18, from[1] + dy * 0.18];
  context.beginPath();
  context.moveTo(from[0], from[1]);
  context.lineTo(mx + nx, my + ny);
  context.lineTo(to[0], to[1]);
  context.lineTo(mx - nx, my - ny);
  context.closePath();
  context.globalAlpha = 0.85;
  context.fillStyle = fill;
  context.fill();
  context.globalAlpha = 1;
  context.lineWidth = 1;
  context.strokeStyle = edge;
  context.stroke();
}

function disc(context: CanvasRenderingContext2D, [x, y]: Vector, radius: number, fill: string, edge: string): void {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  paint(context, fill, edge);
}

function diamond(context: CanvasRenderingContext2D, [x, y]: Vector, radius: number, fill: string, edge: string): void {
  context.beginPath();
  context.moveTo(x, y - radius);
  context.lineTo(x + radius, y);
  context.lineTo(x, y + radius);
  context.lineTo(x - radius, y);
  context.closePath();
  paint(context, fill, edge);
}

function paint(context: CanvasRenderingContext2D, fill: string, edge: string): void {
  context.fillStyle = fill;
  context.fill();
  context.lineWidth = 2;
  context.strokeStyle = edge;
  context.stroke();
}

function tag(context: CanvasRenderingContext2D, text: string, [x, y]: Vector, colours: Colours): void {
  context.font = "600 12px system-ui, sans-serif";
  const width = context.measureText(text).width + 12;
  context.fillStyle = colours.panel;
  context.beginPath();
  context.roundRect(x + 12, y - 24, width, 20, 4);
  context.fill();
  context.fillStyle = colours.text;
  context.textBaseline = "middle";
  context.fillText(text, x + 18, y - 14);
}

/** Names of the limbs and handles that a joint moves. */
export function movedBy(puppet: Puppet, joint: Joint | null): Set<string> {
  if (joint === null) return new Set();
  const parts: Part[] = [
    ...limbsOf(puppet).map(({ name }): Part => ({ kind: "limb", name })),
    ...handlesOf(puppet).map(({ name }): Part => ({ kind: "handle", name })),
  ];
  return new Set(parts.filter((part) => jointsOf(puppet, part).includes(joint)).map(({ name }) => name));
}
