/** The puppet file as the server sends it, and its edits: every function returns a new puppet. */

import type { Bend, Direction, Handle, Limb, Puppet } from "../messages";
import { type Joint, type JointChoice, chainOf, sideOf, spread } from "./skeleton";
import { type Vector, cross, dot, length, meetPlane, reflect, subtract } from "./vector";

export type { Bend, Handle, Limb, Morph, Puppet, Range, Retarget, Root, Smoothing } from "../messages";

/** Name of the limb that `addJaw` adds. */
export const JAW = "jaw";

/** A limb, one of its points, or a handle. */
export type Part =
  | { readonly kind: "limb"; readonly name: string; readonly point?: number }
  | { readonly kind: "handle"; readonly name: string };

export const limbsOf = (puppet: Puppet): readonly Limb[] => puppet.limb ?? [];
export const handlesOf = (puppet: Puppet): readonly Handle[] => puppet.handle ?? [];
export const limbNamed = (puppet: Puppet, name: string): Limb | undefined => limbsOf(puppet).find((l) => l.name === name);
export const handleNamed = (puppet: Puppet, name: string): Handle | undefined =>
  handlesOf(puppet).find((h) => h.name === name);

/** Whether a part is in a puppet. */
export function has(puppet: Puppet, part: Part): boolean {
  if (part.kind === "handle") return handleNamed(puppet, part.name) !== undefined;
  return (limbNamed(puppet, part.name)?.points.length ?? 0) > (part.point ?? 0);
}

/** The joints of a handle; none if it stays in place. */
export function handleJoints(handle: Handle): readonly Joint[] {
  return handle.joints ?? (handle.joint == null ? [] : [handle.joint]);
}

/** The joints of a limb's point. */
export function pointJoints(choice: JointChoice): readonly Joint[] {
  return typeof choice === "string" ? [choice] : choice;
}

/** All joints that a part follows. */
export function jointsOf(puppet: Puppet, part: Part): readonly Joint[] {
  if (part.kind === "handle") {
    const handle = handleNamed(puppet, part.name);
    return handle === undefined ? [] : handleJoints(handle);
  }
  const joints = limbNamed(puppet, part.name)?.joints ?? [];
  if (part.point === undefined) return joints.flatMap(pointJoints);
  const choice = joints[part.point];
  return choice === undefined ? [] : pointJoints(choice);
}

/** Change a limb. New points are not at the joints of the file's skeleton. */
export function withLimb(puppet: Puppet, name: string, change: (limb: Limb) => Limb): Puppet {
  return {
    ...puppet,
    limb: limbsOf(puppet).map((limb) => {
      const changed = limb.name === name ? change(limb) : limb;
      return changed.points === limb.points ? changed : without(changed, "nodes");
    }),
  };
}

export function withHandle(puppet: Puppet, name: string, change: (handle: Handle) => Handle): Puppet {
  return { ...puppet, handle: handlesOf(puppet).map((handle) => (handle.name === name ? change(handle) : handle)) };
}

/** Move a point of a limb, or a handle. */
export function move(puppet: Puppet, part: Part, to: Vector): Puppet {
  return part.kind === "handle"
    ? withHandle(puppet, part.name, (handle) => ({ ...handle, position: to }))
    : withLimb(puppet, part.name, (limb) => ({
        ...limb,
        points: limb.points.map((point, i) => (i === part.point ? to : point)),
      }));
}

/** Let a part follow a joint: a handle or point that joint, a whole limb the performer's limb that it belongs to. */
export function follow(puppet: Puppet, part: Part, joint: Joint): Puppet {
  if (part.kind === "handle") return withHandleJoints(puppet, part.name, [joint]);
  return withLimb(puppet, part.name, (limb) => ({
    ...limb,
    joints:
      part.point === undefined
        ? spread(chainOf(joint), limb.points.length)
        : limb.joints.map((old, i) => (i === part.point ? joint : old)),
  }));
}

/** Set the joints whose mean a handle follows; none keeps it in place. */
export function withHandleJoints(puppet: Puppet, name: string, joints: readonly Joint[]): Puppet {
  return withHandle(puppet, name, (handle) => {
    const rest = without(without(handle, "joint"), "joints");
    const [first] = joints;
    return joints.length > 1 ? { ...rest, joints } : first === undefined ? rest : { ...rest, joint: first };
  });
}

/** A name that is free among others: "left wing 2" if there is a "left wing". */
export function freeName(wanted: string, taken: readonly string[]): string {
  let name = wanted;
  for (let number = 2; taken.includes(name); number++) name = `${wanted} ${number}`;
  return name;
}

export function addHandle(puppet: Puppet, name: string, position: Vector): Puppet {
  return { ...puppet, handle: [...handlesOf(puppet), { name, position }] };
}

/** Add a limb that follows the performer's arm, leg or trunk that its name suggests. */
export function addLimb(puppet: Puppet, name: string, points: readonly Vector[]): Puppet {
  const side = sideOf(name) === "right" ? "right" : "left";
  const chain = chainOf(/leg|foot|hind/.test(name) ? `hip_${side}` : /trunk|neck|head|tail/.test(name) ? "head" : `hand_${side}`);
  const limb: Limb = { name, points, joints: spread(chain, points.length), follow: "turn" };
  return { ...puppet, limb: [...limbsOf(puppet), limb] };
}

/** Angle by which a channel bends a limb, such as a jaw, until it is changed. */
export const BEND_DEGREES = 20;

/** Add a jaw that opens with the voice and is otherwise rigid with the head, or replace the one that there is. */
export function addJaw(puppet: Puppet, hinge: Vector, tip: Vector): Puppet {
  const parent = limbNamed(puppet, "head") === undefined ? {} : { parent: "head" };
  const bend = { channel: "voice", degrees: BEND_DEGREES, axis: sidewaysAxis(puppet) };
  const jaw: Limb = { name: JAW, points: [hinge, tip], joints: ["shoulder_center", "head"], follow: "turn", gain: 0, ...parent, bend };
  return { ...puppet, limb: put(limbsOf(puppet), jaw) };
}

/** Least cosine of the angle between a click's ray and the body's left at which the ray meets the plane of symmetry. */
const SIDEWAYS = 0.3;

/** The point of a jaw that is clicked: in the plane of symmetry, or inside the body if the click is from the front. */
export function jawPoint(puppet: Puppet, bounds: readonly [Vector, Vector], inside: Vector, surface: Vector): Vector {
  const [direction, left] = [subtract(inside, surface), leftOf(puppet)];
  if (Math.abs(dot(direction, left)) < SIDEWAYS * length(direction)) return inside;
  return meetPlane({ origin: surface, direction }, symmetryPoint(puppet, bounds), left) ?? inside;
}

/** Insert a point in the middle of the bone after a point, or lengthen the limb by a bone after its last one. */
export function addPoint(puppet: Puppet, name: string, after: number): Puppet {
  return withLimb(puppet, name, (limb) => {
    const [from, to] = [limb.points[after], limb.points[after + 1]];
    const joint = limb.joints[after];
    if (from === undefined || joint === undefined) return limb;
    const before = limb.points[after - 1] ?? from;
    const point: Vector =
      to === undefined
        ? [2 * from[0] - before[0], 2 * from[1] - before[1], 2 * from[2] - before[2]]
        : [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2, (from[2] + to[2]) / 2];
    const next = limb.joints[after + 1];
    const both = [...new Set([...pointJoints(joint), ...(next === undefined ? [] : pointJoints(next))])];
    return {
      ...limb,
      points: limb.points.toSpliced(after + 1, 0, point),
      joints: limb.joints.toSpliced(after + 1, 0, both.length === 1 ? joint : both),
    };
  });
}

/** Remove a part. A limb keeps at least two points; limbs that were attached to a removed one are then attached to the trunk. */
export function remove(puppet: Puppet, part: Part): Puppet {
  if (part.kind === "handle") return { ...puppet, handle: handlesOf(puppet).filter((h) => h.name !== part.name) };
  const { point } = part;
  if (point !== undefined && (limbNamed(puppet, part.name)?.points.length ?? 0) > 2) {
    return withLimb(puppet, part.name, (limb) => ({
      ...limb,
      points: limb.points.toSpliced(point, 1),
      joints: limb.joints.toSpliced(point, 1),
    }));
  }
  const rest = limbsOf(puppet).filter((limb) => limb.name !== part.name);
  return { ...puppet, limb: rest.map((limb) => (limb.parent === part.name ? without(limb, "parent") : limb)) };
}

/** Rename a part; limbs that are attached to it stay attached. */
export function rename(puppet: Puppet, part: Part, name: string): Puppet {
  if (part.kind === "handle") return withHandle(puppet, part.name, (handle) => ({ ...handle, name }));
  return {
    ...puppet,
    limb: limbsOf(puppet).map((limb) => ({
      ...limb,
      name: limb.name === part.name ? name : limb.name,
      ...(limb.parent === part.name ? { parent: name } : {}),
    })),
  };
}

/** A name on the other side: "left wing" becomes "right wing"; null if the name has no side. */
export function otherSide(name: string): string | null {
  const swapped = name.replace(/(^|[^a-z])(left|right|l|r)(?=[^a-z]|$)/gi, (_all, before: string, side: string) => {
    const other = { left: "right", right: "left", l: "r", r: "l" }[side.toLowerCase()] ?? side;
    const first = side.charAt(0);
    return before + (first === first.toLowerCase() ? other : other.charAt(0).toUpperCase() + other.slice(1));
  });
  return swapped === name ? null : swapped;
}

const AXES: Record<string, Vector> = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };

/** The direction of an axis such as "-y". */
export function axis(name: string): Vector {
  const [x, y, z] = AXES[name.replace("-", "")] ?? [0, 1, 0];
  return name.startsWith("-") ? [-x, -y, -z] : [x, y, z];
}

/** A direction at a right angle to an axis, turned about it by degrees. */
export function turned(direction: Vector, about: Vector, degrees: number): Vector {
  if (degrees === 0) return direction;
  const [cos, sin] = [Math.cos((degrees * Math.PI) / 180), Math.sin((degrees * Math.PI) / 180)];
  return direction.map((value, at) => cos * value + sin * (cross(about, direction)[at] ?? 0)) as unknown as Vector;
}

/** The direction of the character's left, in the mesh file's coordinates. */
export function leftOf(puppet: Puppet): Vector {
  const { up = "y", front = "z", turn = 0 } = puppet.character;
  return cross(axis(up), turned(axis(front), axis(up), turn));
}

/** The name of the mesh file's axis to the character's left, about which jaws and claws open. */
export function sidewaysAxis(puppet: Puppet): Direction {
  const left = leftOf(puppet);
  const number = left.map(Math.abs).indexOf(Math.max(...left.map(Math.abs)));
  return `${(left[number] ?? 0) > 0 ? "" : "-"}${"xyz".charAt(number)}` as Direction;
}

/**
 * Copy a part to the other side of the body, and replace the part there if there is one.
 *
 * @param through A point of the plane of symmetry.
 * @returns null if the part's name states no side.
 */
export function mirror(puppet: Puppet, part: Part, through: Vector): { puppet: Puppet; part: Part } | null {
  const name = otherSide(part.name);
  if (name === null) return null;
  const across = (point: Vector): Vector => reflect(point, through, leftOf(puppet));
  const swapped = (joint: Joint): Joint => (otherSide(joint) ?? joint) as Joint;
  if (part.kind === "handle") {
    const handle = handleNamed(puppet, part.name);
    if (handle === undefined) return null;
    const joints = handleJoints(handle).map(swapped);
    const rest = without(without(handle, "joint"), "joints");
    const channel = handle.channel == null ? handle.channel : (otherSide(handle.channel) ?? handle.channel);
    const moves = reflect(handle.moves ?? [0, 0, 0], [0, 0, 0], leftOf(puppet));
    const copy: Handle = { ...rest, name, position: across(handle.position), ...(channel == null ? {} : { channel, moves }) };
    const added = { ...puppet, handle: put(handlesOf(puppet), copy) };
    return { puppet: withHandleJoints(added, name, joints), part: { kind: "handle", name } };
  }
  const limb = limbNamed(puppet, part.name);
  if (limb === undefined) return null;
  const parent = limb.parent == null ? null : otherSide(limb.parent);
  const copy: Limb = {
    ...without(limb, "nodes"),
    name,
    points: limb.points.map(across),
    joints: limb.joints.map((choice) => (typeof choice === "string" ? swapped(choice) : choice.map(swapped))),
    ...(parent !== null && limbNamed(puppet, parent) !== undefined ? { parent } : {}),
    ...(limb.bend == null ? {} : { bend: mirroredBend(puppet, limb.bend) }),
  };
  return { puppet: { ...puppet, limb: put(limbsOf(puppet), copy) }, part: { kind: "limb", name } };
}

/** A bend by the channel of the other side; about any axis but that to the side, it turns the other way. */
function mirroredBend(puppet: Puppet, bend: Bend): Bend {
  const { channel, axis: about = "x" } = bend;
  const opposite = about.startsWith("-") ? about.slice(1) : `-${about}`;
  const sideways = Math.abs(dot(axis(about), leftOf(puppet))) > 0.5;
  return { ...bend, channel: otherSide(channel) ?? channel, axis: sideways ? about : (opposite as Direction) };
}

/** A point of the plane of symmetry: the mean of the points of the limb "trunk", or the middle of the box without one. */
export function symmetryPoint(puppet: Puppet, bounds: readonly [Vector, Vector]): Vector {
  const trunk = limbsOf(puppet).find((limb) => limb.name === "trunk")?.points;
  const points = trunk ?? bounds;
  const mean = (k: 0 | 1 | 2): number => points.reduce((sum, point) => sum + point[k], 0) / points.length;
  return [mean(0), mean(1), mean(2)];
}

function put<T extends { name: string }>(parts: readonly T[], part: T): T[] {
  const index = parts.findIndex((old) => old.name === part.name);
  return index < 0 ? [...parts, part] : parts.with(index, part);
}

function without<T extends object, K extends keyof T>(value: T, key: K): Omit<T, K> {
  const rest: Partial<T> = { ...value };
  Reflect.deleteProperty(rest, key);
  return rest as Omit<T, K>;
}

/** The place of a point or handle; null for a whole limb. */
export function pointOf(puppet: Puppet, part: Part): Vector | null {
  if (part.kind === "handle") return handleNamed(puppet, part.name)?.position ?? null;
  return part.point === undefined ? null : (limbNamed(puppet, part.name)?.points[part.point] ?? null);
}
