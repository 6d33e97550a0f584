// Recognises the bones of a humanoid by their names in other programs, as capture/bone_names.py does.

import { TABLE } from "./bone-table.js";

/**
 * Return the keys of a table by the words that they stand for.
 *
 * @param {Record<string, string>} table
 */
const byWord = (table) =>
  new Map(Object.entries(table).flatMap(([key, words]) => words.split(" ").map((word) => [word, key])));

const [WORDS, FINGERS] = [byWord(TABLE.words), byWord(TABLE.fingers)];
const [DECORATION, CONTROLS] = [TABLE.decoration, TABLE.controls].map((words) => new Set(words.split(" ")));
const [MIDDLE, SIDED] = [TABLE.middle, TABLE.sides].map((parts) => parts.split(" "));
const SIDES = new Map([["l", "left"], ["left", "left"], ["r", "right"], ["right", "right"]]);
const PHALANGES = ["metacarpal", "proximal", "intermediate", "distal"];

/** Parts by the names of each convention, an asterisk before those of a side, and how many names a skeleton must have. */
const CONVENTIONS = TABLE.conventions.map(({ middle, sides, least }) => ({
  parts: new Map([
    ...middle.split(" ").map((name, k) => /** @type {[string, string]} */ ([name, MIDDLE[k]])),
    ...sides.split(" ").map((name, k) => /** @type {[string, string]} */ ([`*${name}`, SIDED[k]])),
  ]),
  least,
}));

const WORD = /[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[0-9]+|[^ -~]+/g;
const GLUED = [/^(?<side>left|right|l|r)(?<own>.+)$/, /^(?<own>.+?)(?<side>left|right|l|r)$/];
const FINGER = new RegExp(
  `^(?:hand|finger|f)?(${[...FINGERS.keys()].join("|")})(?:finger)?(?:[.]?([0-9]*)|(${PHALANGES.join("|")}))$`,
);

/**
 * A side, empty for none, and the other words of a joint's name.
 * @typedef {{side: string, words: string[]}} Name
 */

/** @param {string} text */
const capitalised = (text) => text.charAt(0).toUpperCase() + text.slice(1);

/** @param {string} key */
const withoutDigits = (key) => key.replace(/[.0-9]/g, "");

/** @param {string} key */
const isKnown = (key) => WORDS.has(withoutDigits(key)) || FINGER.test(key);

/** @param {Name} name */
const keyOf = ({ side, words }) => (side ? "*" : "") + words.join("");

/**
 * Return the words of a name in lower case, without its namespace; a point is before each number.
 *
 * @param {string} name
 */
function wordsOf(name) {
  if (name.startsWith("__")) return [];
  const own = (name.split(/[:|]/).at(-1) ?? "").normalize("NFKC");
  const words = own.replace("左", " left ").replace("右", " right ").match(WORD) ?? [];
  return words.map((word) => (/[0-9]/.test(word) ? `.${word}` : word.toLowerCase()));
}

/**
 * Return the words of names without those before and after them that (nearly) all joints share, and no part is.
 *
 * @param {string[][]} split
 * @returns {string[][]}
 */
function withoutSharedWords(split) {
  const least = TABLE.sharedWordShare * Math.max(split.filter((words) => words.length).length, TABLE.minSharingJoints);
  for (const end of [0, -1]) {
    const ends = split.map((words) => words.at(end));
    const shared = ends.find((word) => word && ends.filter((other) => other === word).length >= least);
    if (shared && !WORDS.has(shared) && !SIDES.has(shared)) {
      const rest = end ? [0, -1] : [1];
      return withoutSharedWords(split.map((words) => (words.at(end) === shared ? words.slice(...rest) : words)));
    }
  }
  return split;
}

/**
 * Return the side in words, and the other words; a side may be at the beginning or end of a word.
 *
 * @param {string[]} words
 * @returns {Name}
 */
function withoutSide(words) {
  const side = words.map((word) => SIDES.get(word)).find((found) => found !== undefined);
  if (side) return { side, words: words.filter((word) => !SIDES.has(word)) };
  const key = words.join("");
  const glued = isKnown(key) ? [] : GLUED.map((pattern) => pattern.exec(key)?.groups);
  const found = glued.find((groups) => groups && isKnown(groups.own));
  return found ? { side: SIDES.get(found.side) ?? "", words: [found.own] } : { side: "", words };
}

/**
 * Return the parts by names of the convention that explains most joints; none if a skeleton has few names of it.
 *
 * @param {Name[]} names
 */
function conventionOf(names) {
  let [best, most] = [/** @type {Map<string, string>} */ (new Map()), 0];
  for (const { parts, least } of CONVENTIONS) {
    const explained = new Set(names.filter((name) => parts.has(keyOf(name))).map((name) => name.side + keyOf(name))).size;
    if (explained > most && explained >= least) [best, most] = [parts, explained];
  }
  return best;
}

/**
 * Return the part of a joint, and the number of a finger's joint from the palm; null if the name is unknown.
 *
 * @param {Name} name
 * @param {Map<string, string>} convention
 */
function meaningOf(name, convention) {
  const key = name.words.join("");
  const known = convention.get(keyOf(name)) ?? WORDS.get(withoutDigits(key));
  if (known) return { part: known };
  if (name.words.some((word) => CONTROLS.has(word)) || !name.side) return null;
  const [, word, digits, phalanx] = FINGER.exec(key) ?? [];
  const part = FINGERS.get(word) ?? "";
  if (!part || (!digits && !phalanx && !/[0-9]$/.test(word)) || (phalanx === "metacarpal" && part !== "thumb")) return null;
  return { part, order: phalanx ? PHALANGES.indexOf(phalanx) : Number(digits) };
}

/**
 * Return which joint of a skeleton is which bone of VRM's humanoid.
 *
 * @param {string[]} names parents before their children
 * @returns {Map<string, number>} indices of names by names of bones
 */
export function findBones(names) {
  const split = withoutSharedWords(names.map(wordsOf));
  const own = split.map((words) => withoutSide(words.filter((word) => !DECORATION.has(word))));
  const convention = conventionOf(own);
  /** @type {Map<string, number[]>} */
  const joints = new Map();
  /** @type {Map<string, [number, number][]>} */
  const fingers = new Map();
  own.forEach((name, index) => {
    const meaning = meaningOf(name, convention);
    if (!meaning) return;
    const key = `${name.side} ${meaning.part}`;
    if (meaning.order === undefined) joints.set(key, [...(joints.get(key) ?? []), index]);
    else fingers.set(key, [...(fingers.get(key) ?? []), [meaning.order, index]]);
  });
  /** @type {Map<string, number>} */
  const found = new Map();
  for (const side of ["", "left", "right"]) {
    /** @param {string} part */
    const of = (part) => joints.get(`${side} ${part}`) ?? [];
    if (of("lowerArm").length && !of("upperArm").length) joints.set(`${side} upperArm`, of("shoulder").splice(-1));
    const parts = side ? SIDED : MIDDLE;
    const first = parts.map((part) => of(part).shift());
    parts.forEach((part, k) => {
      const other = (TABLE.substitutes[part] ?? "").split(" ").find((each) => of(each).length) ?? "";
      const index = first[k] ?? of(other).shift();
      if (index !== undefined) found.set(side ? side + capitalised(part) : part, index);
    });
  }
  for (const [key, chain] of fingers) {
    const [side, finger] = key.split(" ");
    const names = PHALANGES.filter((name) => name !== (finger === "thumb" ? "intermediate" : "metacarpal"));
    chain.sort(([a, i], [b, j]) => a - b || i - j);
    names.forEach((name, k) => k < chain.length && found.set(side + capitalised(finger) + capitalised(name), chain[k][1]));
  }
  return found;
}

/**
 * Return the number of the bone for each joint that is recognised: one of the same meaning, or of the same name.
 *
 * @param {string[]} joints
 * @param {string[]} bones
 * @returns {Map<string, number>}
 */
export function recognised(joints, bones) {
  const found = new Map([...findBones(bones)].filter(([joint]) => joints.includes(joint)));
  for (const joint of joints) {
    const bone = bones.indexOf(joint);
    if (bone >= 0 && !found.has(joint) && ![...found.values()].includes(bone)) found.set(joint, bone);
  }
  return found;
}
