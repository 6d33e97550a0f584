/** The performer's 20 joints, in the order of the protocol, and how they are connected. */

export const CHAINS = {
  trunk: ["hip_center", "spine", "shoulder_center", "head"],
  "left arm": ["shoulder_left", "elbow_left", "wrist_left", "hand_left"],
  "right arm": ["shoulder_right", "elbow_right", "wrist_right", "hand_right"],
  "left leg": ["hip_left", "knee_left", "ankle_left", "foot_left"],
  "right leg": ["hip_right", "knee_right", "ankle_right", "foot_right"],
} as const;

export type Joint = (typeof CHAINS)[keyof typeof CHAINS][number];

export const JOINTS: readonly Joint[] = Object.values(CHAINS).flat();

const ROOTS: Partial<Record<Joint, Joint>> = {
  shoulder_left: "shoulder_center",
  shoulder_right: "shoulder_center",
  hip_left: "hip_center",
  hip_right: "hip_center",
};

/** Pairs of indices into `JOINTS`: the skeleton's 19 bones, from the hips outwards. */
export const BONES: readonly (readonly [number, number])[] = Object.values(CHAINS).flatMap((chain) =>
  chain.flatMap((joint, i): [number, number][] => {
    const parent = i === 0 ? ROOTS[joint] : chain[i - 1];
    return parent === undefined ? [] : [[JOINTS.indexOf(parent), JOINTS.indexOf(joint)]];
  }),
);

export type Side = "left" | "right" | "middle";

/** The side of the body that a name of a joint, limb or handle states. */
export function sideOf(name: string): Side {
  const words = name.toLowerCase().split(/[^a-z]+/);
  return words.includes("left") || words.includes("l")
    ? "left"
    : words.includes("right") || words.includes("r")
      ? "right"
      : "middle";
}

/** A joint's name for people: "left hand". */
export function spoken(joint: string): string {
  const match = /^(.*)_(left|right)$/.exec(joint);
  if (match?.[1] !== undefined && match[2] !== undefined) return `${match[2]} ${match[1].replaceAll("_", " ")}`;
  return joint === "hip_center" ? "hips" : joint === "shoulder_center" ? "shoulders" : joint.replaceAll("_", " ");
}

/** The chain that a joint belongs to, from its root to its tip. */
export function chainOf(joint: Joint): readonly Joint[] {
  return Object.values(CHAINS).find((chain) => (chain as readonly Joint[]).includes(joint)) ?? CHAINS.trunk;
}

/** Spread a chain of joints over `count` points: a subset with both ends, or averages of neighbours in between. */
export function spread(chain: readonly Joint[], count: number): JointChoice[] {
  const places = chain.length - 1;
  if (count <= chain.length) {
    return Array.from({ length: count }, (_, i) => at(chain, Math.round((i * places) / Math.max(count - 1, 1))));
  }
  const extra = count - chain.length;
  const chosen: JointChoice[] = [];
  for (let i = 0; i <= places; i++) {
    chosen.push(at(chain, i));
    const between = i < places && i >= places - extra;
    if (between) chosen.push([at(chain, i), at(chain, i + 1)]);
  }
  while (chosen.length < count) chosen.push(at(chain, places));
  return chosen;
}

/** What moves a point of a limb: a joint, or the mean of several. */
export type JointChoice = Joint | readonly Joint[];

function at(chain: readonly Joint[], index: number): Joint {
  const joint = chain[index];
  if (joint === undefined) throw new RangeError(`no joint ${index} in a chain of ${chain.length}`);
  return joint;
}
