// Recognises the bones of a humanoid by their names in other programs: VRM, VRoid, Mixamo, Unreal, Rigify, Godot, Character
// Creator, SMPL and others, and common English names, with a side in any spelling.

/** Names of VRM's bones in the middle of the body, as words without spaces. @type {Record<string, string[]>} */
const MIDDLE = {
  hips: ["hips", "pelvis", "hip"],
  spine: ["spine", "spine01", "abdomen", "ab", "waist"],
  chest: ["chest", "spine1", "spine02", "torso", "spine001"],
  upperChest: ["upperchest", "spine2", "spine03", "spine002"],
  neck: ["neck", "neck01", "neck1", "necktwist01", "spine004"],
  head: ["head", "spine006"],
};

/** Those of a side. @type {Record<string, string[]>} */
const SIDED = {
  Shoulder: ["shoulder", "clavicle", "collar", "scapula", "shoulder1"],
  UpperArm: ["upperarm", "arm", "armupper", "uparm", "shldr"],
  LowerArm: ["lowerarm", "forearm", "armlower", "lowarm", "elbow"],
  Hand: ["hand", "wrist"],
  UpperLeg: ["upperleg", "upleg", "thigh", "legupper", "hip"],
  LowerLeg: ["lowerleg", "leg", "shin", "calf", "leglower", "lowleg", "knee"],
  Foot: ["foot", "ankle"],
  Toes: ["toes", "toebase", "toe", "toe0", "ball"],
};

/** A finger's joint, by its part or by its number from the palm. */
const FINGER = /^(?:hand|f)?(thumb|index|middle|ring|little|pink[a-z]+)(?:finger)?(?:0*([123])|(metacarpal|proximal|intermediate|distal))$/;

const SIDES = new Map([
  ["left", "left"],
  ["l", "left"],
  ["right", "right"],
  ["r", "right"],
]);

/** Words that programs put before or after a bone's own name. */
const DECORATION = new Set(
  ["def", "org", "mixamorig", "bip01", "bip001", "j", "bip", "c", "m", "cc", "base", "joint", "valvebiped"],
);

/**
 * Return VRM's name for the name of a bone; null if it is unknown.
 *
 * @param {string} bone
 */
export function meaningOf(bone) {
  const own = bone.split(/[:|]/).at(-1) ?? "";
  const words = own.match(/[A-Z]?[a-z0-9]+|[A-Z0-9]+/g) ?? [];
  const known = words.map((word) => word.toLowerCase()).filter((word) => !DECORATION.has(word));
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
 * Return the number of the bone for each joint that is recognised: one of the same name, or of the same meaning. Where
 * programs call an upper arm "shoulder", a collar bone is before it.
 *
 * @param {string[]} joints
 * @param {string[]} bones
 * @returns {Map<string, number>}
 */
export function recognised(joints, bones) {
  const found = new Map();
  const meanings = bones.map(meaningOf);
  for (const joint of joints) {
    const shoulder = meanings.lastIndexOf(joint.replace("UpperArm", "Shoulder"));
    const chosen = [bones.indexOf(joint), meanings.indexOf(joint), shoulder].find((bone) => bone >= 0) ?? -1;
    if (chosen >= 0 && ![...found.values()].includes(chosen)) found.set(joint, chosen);
  }
  return found;
}
