// Recognises the bones of a humanoid by their names in other programs: VRM, Mixamo, Unreal, Rigify, Godot, and common
// English names, with a side in any spelling.

/** Names of VRM's bones in the middle of the body, as words without spaces. @type {Record<string, string[]>} */
const MIDDLE = {
  hips: ["hips", "pelvis", "hip"],
  spine: ["spine", "spine01", "abdomen"],
  chest: ["chest", "spine1", "spine02", "torso", "spine001"],
  upperChest: ["upperchest", "spine2", "spine03", "spine002"],
  neck: ["neck", "neck01", "spine004"],
  head: ["head", "spine006"],
};

/** Those of a side. @type {Record<string, string[]>} */
const SIDED = {
  Shoulder: ["shoulder", "clavicle", "collar"],
  UpperArm: ["upperarm", "arm"],
  LowerArm: ["lowerarm", "forearm"],
  Hand: ["hand", "wrist"],
  UpperLeg: ["upperleg", "upleg", "thigh"],
  LowerLeg: ["lowerleg", "leg", "shin", "calf"],
  Foot: ["foot", "ankle"],
  Toes: ["toes", "toebase", "toe", "ball"],
};

/** A finger's joint, by its part or by its number from the palm. */
const FINGER = /^(?:jbip)?(?:hand|f)?(thumb|index|middle|ring|little|pink[a-z]+)(?:finger)?(?:0*([123])|(metacarpal|proximal|intermediate|distal))$/;

const SIDES = new Map([
  ["left", "left"],
  ["l", "left"],
  ["right", "right"],
  ["r", "right"],
]);

const PREFIXES = new Set(["def", "org", "mixamorig", "bip01", "bip001"]);

/**
 * Return VRM's name for the name of a bone; null if it is unknown.
 *
 * @param {string} bone
 */
export function meaningOf(bone) {
  const own = bone.split(/[:|]/).at(-1) ?? "";
  const words = own.match(/[A-Z]?[a-z0-9]+|[A-Z0-9]+/g) ?? [];
  const known = words.map((word) => word.toLowerCase()).filter((word) => !PREFIXES.has(word));
  const side = known.map((word) => SIDES.get(word)).find((found) => found !== undefined);
  const rest = known.filter((word) => !SIDES.has(word)).join("");
  const table = Object.entries(side === undefined ? MIDDLE : SIDED);
  const found = table.find(([, names]) => names.includes(rest));
  if (found) return (side ?? "") + found[0];
  return side === undefined ? null : fingerOf(side, rest);
}

/**
 * @param {string} side
 * @param {string} text
 */
function fingerOf(side, text) {
  const [, finger, number, part] = FINGER.exec(text) ?? [];
  if (finger === undefined) return null;
  const parts = finger === "thumb" ? ["metacarpal", "proximal", "distal"] : ["proximal", "intermediate", "distal"];
  const words = [finger.startsWith("pink") ? "little" : finger, part ?? parts[Number(number) - 1]];
  return side + words.map((word) => word.charAt(0).toUpperCase() + word.slice(1)).join("");
}

/**
 * Return the number of the bone for each joint that is recognised: one of the same name, or of the same meaning.
 *
 * @param {string[]} joints
 * @param {string[]} bones
 * @returns {Map<string, number>}
 */
export function recognised(joints, bones) {
  const found = new Map();
  for (const joint of joints) {
    const same = bones.indexOf(joint);
    const alike = bones.findIndex((bone) => meaningOf(bone) === joint);
    const chosen = same >= 0 ? same : alike;
    if (chosen >= 0 && ![...found.values()].includes(chosen)) found.set(joint, chosen);
  }
  return found;
}
