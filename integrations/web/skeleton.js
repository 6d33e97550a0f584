// Any skinned mesh of three.js, driven by the joints of a character of a Puppetline service.
//
//     const driver = new PuppetSkeleton(new Client("ws://127.0.0.1:7402/stream"), "human", hero);
//     renderer.setAnimationLoop(() => { mixer.update(delta); driver.update(); renderer.render(scene, camera); });
//
// Rotations do not depend on rest poses: those of a humanoid count from the T-pose, which is found for the driven
// skeleton by the directions of its arms and legs. Other joints turn as they have turned since rest.

import { Bone, Matrix4, Object3D, Quaternion, Vector3 } from "three";
import { Character } from "./character.js";
import { JitterBuffer } from "./jitter-buffer.js";
import { recognised } from "./bone-names.js";
import { TargetInfluences, between as mixed } from "./targets.js";

/** @import {Client} from "./client.js" */
/** @import {Bone as Joint} from "./message.js" */

/** Direction of each limb's bones in a T-pose, on the left. @type {Record<string, Vector3>} */
const DIRECTIONS = {
  UpperArm: new Vector3(1, 0, 0),
  LowerArm: new Vector3(1, 0, 0),
  UpperLeg: new Vector3(0, -1, 0),
  LowerLeg: new Vector3(0, -1, 0),
};

/** Next joint of each limb. @type {Record<string, string>} */
const NEXT = { UpperArm: "LowerArm", LowerArm: "Hand", UpperLeg: "LowerLeg", LowerLeg: "Foot", Foot: "Toes" };

/** Joint above, whose rotation from the T-pose a joint without a direction has. @type {Record<string, string>} */
const ABOVE = { LowerArm: "UpperArm", Hand: "LowerArm", LowerLeg: "UpperLeg", Toes: "Foot" };

/** Minimum horizontal length of a foot's unit direction for the foot to have a heading. */
const MIN_HEADING = 0.1;

/** @type {Record<string, Vector3>} */
const AXES = {
  x: new Vector3(1, 0, 0),
  y: new Vector3(0, 1, 0),
  z: new Vector3(0, 0, 1),
  "-x": new Vector3(-1, 0, 0),
  "-y": new Vector3(0, -1, 0),
  "-z": new Vector3(0, 0, -1),
};

/** The joints of a character, and the rotations and positions of a frame. */
class Joints {
  /** @param {Joint[]} table */
  constructor(table) {
    this.table = table;
    this.names = table.map(({ name }) => name);
    /** Global rotations and positions at rest, file coordinates. @type {Quaternion[]} */
    this.rest = [];
    /** @type {Vector3[]} */
    this.places = [];
    for (const { parent, position, rotation } of table) {
      const [turn, place] = [new Quaternion(...rotation), new Vector3(...position)];
      this.rest.push(parent < 0 ? turn : turn.premultiply(this.rest[parent]));
      this.places.push(parent < 0 ? place : place.applyQuaternion(this.rest[parent]).add(this.places[parent]));
    }
  }

  /** Number of floats of a frame. */
  get size() {
    return 4 * this.table.length + 3 * this.table.filter(({ travels }) => travels).length;
  }

  /**
   * Return the rotations of all joints since rest, between two frames.
   *
   * @param {Float32Array} earlier
   * @param {Float32Array} later
   * @param {number} share
   */
  motions(earlier, later, share) {
    /** @type {Quaternion[]} */
    const turned = [];
    return this.table.map(({ parent }, joint) => {
      const own = new Quaternion().fromArray(earlier, 4 * joint).slerp(new Quaternion().fromArray(later, 4 * joint), share);
      turned.push(parent < 0 ? own : own.premultiply(turned[parent]));
      return turned[joint].clone().multiply(this.rest[joint].clone().invert());
    });
  }

  /**
   * Return the displacement of the first joint since rest, between two frames.
   *
   * @param {Float32Array} earlier
   * @param {Float32Array} later
   * @param {number} share
   */
  displacement(earlier, later, share) {
    if (!this.table[0].travels) return new Vector3();
    const start = 4 * this.table.length;
    const place = new Vector3().fromArray(earlier, start).lerp(new Vector3().fromArray(later, start), share);
    return place.sub(this.places[0]);
  }
}

/** Poses the bones of a skeleton by the joints of a character. */
export class SkeletonPose {
  /** Bone of each driven joint, parents first. @type {Map<number, Object3D>} */
  bones = new Map();
  /** Rotation of each driven bone from the T-pose to rest, character axes. @type {Map<number, Quaternion>} */
  #toRest = new Map();
  /** Global rotation and position of each driven bone at rest. @type {Map<Object3D, {turn: Quaternion, place: Vector3}>} */
  #rest = new Map();
  #ratio = 1;

  /**
   * @param {{bones?: Joint[] | null, up: string, front: string, turn?: number}} description of the character's scene
   * @param {Object3D} root of the driven model, in its rest pose
   * @param {Record<string, string>} [map] names of bones for names of joints that are not recognised
   * @throws {RangeError} a character without joints
   */
  constructor(description, root, map = {}) {
    if (!description.bones?.length) throw new RangeError("The character has no joints. Its puppet file needs a [[limb]].");
    this.joints = new Joints(description.bones);
    this.root = root;
    const up = AXES[description.up];
    const front = AXES[description.front].clone().applyAxisAngle(up, ((description.turn ?? 0) * Math.PI) / 180);
    this.fromCharacter = basis(up.clone().cross(front), up, front).invert();
    /** @type {Object3D[]} */
    const all = [];
    root.traverse((each) => each instanceof Bone && all.push(each));
    const named = recognised(this.joints.names, all.map(({ name }) => name));
    for (const [joint, bone] of Object.entries(map)) named.set(joint, all.findIndex(({ name }) => name === bone));
    const depth = new Map(all.map((bone, number) => [number, number]));
    for (const [joint, bone] of [...named].sort(([, a], [, b]) => (depth.get(a) ?? 0) - (depth.get(b) ?? 0))) {
      const number = this.joints.names.indexOf(joint);
      if (number < 0 || bone < 0) continue;
      this.bones.set(number, all[bone]);
      this.#rest.set(all[bone], this.#global(all[bone]));
    }
    this.toSkeleton = this.#axes();
    for (const number of this.bones.keys()) {
      if (description.bones[number].from_t_pose) this.#toRest.set(number, this.#fromTPose(this.joints.names[number]));
    }
    const own = legLength((joint) => this.joints.places[this.joints.names.indexOf(joint)]);
    const driven = legLength((joint) => this.#place(joint));
    if (own && driven) this.#ratio = driven / own;
  }

  /**
   * Pose the bones.
   *
   * @param {Float32Array} earlier payload of a frame of kind "bones"
   * @param {Float32Array} [later]
   * @param {number} [share] position between both, 0 to 1
   */
  apply(earlier, later = earlier, share = 0) {
    if (earlier.length !== this.joints.size || later.length !== this.joints.size) return;
    if (![earlier, later].every((values) => values.every(Number.isFinite))) return;
    const motions = this.joints.motions(earlier, later, share);
    for (const [joint, bone] of this.bones) {
      const turn = between(motions[joint], this.fromCharacter);
      const toRest = this.#toRest.get(joint);
      if (toRest) {
        const own = new Quaternion(.../** @type {[number, number, number, number]} */ (this.joints.table[joint].from_t_pose));
        turn.multiply(between(own, this.fromCharacter)).multiply(toRest.clone().invert());
      }
      const rest = /** @type {{turn: Quaternion, place: Vector3}} */ (this.#rest.get(bone));
      const wanted = between(turn, this.toSkeleton).multiply(rest.turn);
      const above = this.#global(/** @type {Object3D} */ (bone.parent));
      bone.quaternion.copy(above.turn.clone().invert().multiply(wanted));
      if (this.joints.names[joint] === "hips") {
        const moved = this.joints.displacement(earlier, later, share);
        moved.applyQuaternion(this.fromCharacter).applyQuaternion(this.toSkeleton).multiplyScalar(this.#ratio);
        bone.position.copy(rest.place).add(moved).applyMatrix4(above.matrix.invert());
      }
    }
  }

  /**
   * Return the transform of an object relative to the root.
   *
   * @param {Object3D} object
   */
  #global(object) {
    const matrix = new Matrix4();
    for (let each = object; each !== this.root && each.parent; each = each.parent) {
      each.updateMatrix();
      matrix.premultiply(each.matrix);
    }
    const [place, turn] = [new Vector3(), new Quaternion()];
    matrix.decompose(place, turn, new Vector3());
    return { place, turn, matrix };
  }

  /**
   * Return the place of a joint's bone at rest.
   *
   * @param {string} joint
   */
  #place(joint) {
    const bone = this.bones.get(this.joints.names.indexOf(joint));
    return bone && this.#rest.get(bone)?.place;
  }

  /** Return the axes of the driven skeleton nearest to its left, up and front: by its legs or arms, and its head. */
  #axes() {
    const [low, high] = [this.#place("hips"), this.#place("head") ?? this.#place("neck") ?? this.#place("spine")];
    const pairs = ["UpperLeg", "UpperArm"].map((part) => [this.#place(`left${part}`), this.#place(`right${part}`)]);
    const [left, right] = pairs.find(([a, b]) => a && b) ?? [];
    if (!low || !high || !left || !right) return new Quaternion();
    const up = nearestAxis(high.clone().sub(low));
    const across = left.clone().sub(right);
    const side = nearestAxis(across.sub(up.clone().multiplyScalar(across.dot(up))));
    return basis(side, up, side.clone().cross(up));
  }

  /**
   * Return the least rotation, relative to that of the bone above, from the T-pose to rest, in character axes.
   *
   * @param {string} joint
   * @returns {Quaternion}
   */
  #fromTPose(joint) {
    const [, side, part] = /^(left|right)(.+)$/.exec(joint) ?? [];
    if (!side) return new Quaternion();
    const above = ABOVE[part] && this.#place(side + ABOVE[part]) ? this.#fromTPose(side + ABOVE[part]) : new Quaternion();
    const [start, end] = [this.#place(joint), this.#place(side + NEXT[part])];
    if (!start || !end) return above;
    const aim = end.clone().sub(start).normalize().applyQuaternion(this.toSkeleton.clone().invert());
    if (part === "Foot") {
      const heading = Math.hypot(aim.x, aim.z) > MIN_HEADING ? Math.atan2(aim.x, aim.z) : 0;
      return new Quaternion().setFromAxisAngle(AXES.y, heading);
    }
    if (!DIRECTIONS[part]) return above;
    const straight = DIRECTIONS[part].clone();
    if (part.endsWith("Arm") && side === "right") straight.negate();
    return new Quaternion().setFromUnitVectors(straight.applyQuaternion(above), aim).multiply(above);
  }
}

/** Follows a character of a service with a rigged model; `update` poses it. */
export class PuppetSkeleton {
  /** @type {SkeletonPose | null} */
  pose = null;
  /** @type {TargetInfluences | null} */
  #targets = null;
  #buffer;

  /**
   * @param {Client} client
   * @param {string} name of the character
   * @param {Object3D} model with a skeleton in its rest pose
   * @param {{map?: Record<string, string>, delay?: number}} [options]
   */
  constructor(client, name, model, { map = {}, delay = 0.05 } = {}) {
    this.character = new Character(client, name, "bones");
    this.#buffer = new JitterBuffer(delay);
    this.character.addEventListener("scene", () => {
      const description = this.character.scene?.description;
      this.pose = description?.bones?.length ? new SkeletonPose(description, model, map) : null;
      this.#targets ??= new TargetInfluences(model);
      this.#buffer = new JitterBuffer(delay);
    });
    this.character.addEventListener("frame", () => {
      if (this.character.frame) this.#buffer.push(this.character.frame, performance.now() / 1000);
    });
  }

  /** Pose the model. Call it before each image, after other animations. */
  update() {
    if (!this.pose || !this.#buffer.advance(performance.now() / 1000)) return;
    const { earlier, later, share } = this.#buffer;
    if (earlier?.kind !== "bones" || later?.kind !== "bones") return;
    this.pose.apply(earlier.body, later.body, share);
    const names = this.character.scene?.description.targets ?? [];
    this.#targets?.show(names, mixed(earlier.targets, later.targets, share));
  }

  /** Stop following. */
  close() {
    this.character.close();
  }
}

/**
 * Return the rotation whose columns are three axes.
 *
 * @param {Vector3} x
 * @param {Vector3} y
 * @param {Vector3} z
 */
function basis(x, y, z) {
  return new Quaternion().setFromRotationMatrix(new Matrix4().makeBasis(x, y, z));
}

/**
 * Return a rotation in other axes.
 *
 * @param {Quaternion} turn
 * @param {Quaternion} axes
 */
function between(turn, axes) {
  return axes.clone().multiply(turn).multiply(axes.clone().invert());
}

/** @param {Vector3} direction */
function nearestAxis(direction) {
  const values = direction.toArray();
  const largest = values.map(Math.abs).indexOf(Math.max(...values.map(Math.abs)));
  return new Vector3().setComponent(largest, Math.sign(values[largest]));
}

/**
 * Return the length of the left leg; 0 if it is unknown.
 *
 * @param {(joint: string) => Vector3 | undefined} place
 */
function legLength(place) {
  const [hip, knee, ankle] = ["leftUpperLeg", "leftLowerLeg", "leftFoot"].map(place);
  return hip && knee && ankle ? hip.distanceTo(knee) + knee.distanceTo(ankle) : 0;
}
