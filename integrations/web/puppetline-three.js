// Characters of a Puppetline service in three.js: deformed on the graphics card, interpolated between frames.
//
//     const puppet = new Puppet(new Client("ws://127.0.0.1:7402/stream"), "dog");
//     scene.add(puppet);
//     renderer.setAnimationLoop(() => { puppet.update(); renderer.render(scene, camera); });
//
// WebGLRenderer only. docs/web.md describes it.

import {
  DataTexture,
  FloatType,
  Group,
  MeshDepthMaterial,
  MeshDistanceMaterial,
  RGBADepthPacking,
  RGBAFormat,
  Sphere,
  Vector3,
} from "three";
import { Character } from "./character.js";
import { TRANSFORM, evaluate } from "./evaluation.js";
import { IsolineBounds } from "./isoline-bounds.js";
import { JitterBuffer } from "./jitter-buffer.js";
import { MAX_FIELDS, deform } from "./shader.js";
import { meshesOf, partsOf } from "./meshes.js";
import { RestPose, between } from "./targets.js";

export { MAX_FIELDS, deform };

/** @import {Client} from "./client.js" */
/** @import {Scene, Message} from "./message.js" */
/** @import {Mesh, Object3D, Object3DEventMap} from "three" */
/** @import {Uniforms} from "./shader.js" */

/** A character that the graphics card deforms; `show` sets its pose. */
export class PuppetMesh extends Group {
  #bounds;
  #followRoot;
  #rest;
  /** Transforms of the shown pose. @type {Float32Array} */
  #controls;
  /** The same, on the graphics card. @type {DataTexture} */
  #texture;
  #sphere = new Sphere();

  /**
   * @param {Scene} scene of the service
   * @param {{source?: Object3D, followRoot?: boolean}} [options] `source` is what GLTFLoader has read of a file from
   * `puppetline shader-mesh`, with the character's materials and textures; `followRoot` whether the character walks with
   * its performer, or stays in place
   * @throws {RangeError} a character with more than 8 fields
   */
  constructor(scene, { source, followRoot = true } = {}) {
    super();
    if (scene.fields > MAX_FIELDS) throw new RangeError(`${scene.fields} fields, more than the maximum of ${MAX_FIELDS}.`);
    this.scene = scene;
    this.#followRoot = followRoot;
    this.#bounds = new IsolineBounds(scene);
    this.#rest = new RestPose(scene);
    const count = scene.fields * scene.isolines;
    this.#controls = new Float32Array(TRANSFORM * count);
    this.#texture = new DataTexture(this.#controls, 3, count, RGBAFormat, FloatType);
    const weights = Array.from({ length: MAX_FIELDS }, (_, field) => scene.weights[field] ?? 0);
    /** Uniforms of its materials; see `deform`. @type {Uniforms} */
    this.uniforms = {
      puppetControls: { value: this.#texture },
      puppetShift: { value: new Vector3() },
      puppetWeights: { value: weights },
      puppetFields: { value: scene.fields },
      puppetIsolines: { value: scene.isolines },
    };
    const meshes = source ? meshesOf(source, scene, this.#rest) : partsOf(scene, this.#rest);
    for (const mesh of meshes) this.#add(mesh);
    this.visible = false; // until there is a pose
  }

  /** The deforming meshes. @returns {Mesh[]} */
  get meshes() {
    return /** @type {Mesh[]} */ (this.children);
  }

  /**
   * Show the interpolation of two frames of `controls`.
   *
   * @param {Message} earlier
   * @param {Message} later
   * @param {number} share 0 for the earlier frame, 1 for the later one
   */
  show(earlier, later, share) {
    this.#rest.move(between(earlier.targets, later.targets, share));
    const shift = this.uniforms.puppetShift.value;
    if (!this.#followRoot) {
      shift.fromArray(earlier.header.root).lerp(new Vector3(...later.header.root), share).negate();
    }
    if (earlier.kind === "controls" && later.kind === "controls" && earlier.body.length === this.#controls.length) {
      this.#controls.set(between(earlier.body, later.body, share));
      this.#texture.needsUpdate = true;
    }
    this.#bounds.around(this.#controls).translate(shift).getBoundingSphere(this.#sphere);
    this.visible = true;
  }

  /**
   * Compute what is shown without the graphics card: positions and normals of the scene's vertices, in the coordinates of
   * this object. It takes milliseconds and is meant for tools.
   */
  evaluate() {
    const evaluated = evaluate(this.scene, this.#controls, this.#rest.positions);
    const shift = this.uniforms.puppetShift.value.toArray();
    for (let i = 0; i < evaluated.positions.length; i++) evaluated.positions[i] += shift[i % 3];
    return evaluated;
  }

  /** Free what the graphics card holds. */
  dispose() {
    this.#texture.dispose();
    for (const mesh of this.meshes) {
      mesh.geometry.dispose();
      for (const material of [mesh.material, mesh.customDepthMaterial, mesh.customDistanceMaterial].flat()) {
        material?.dispose();
      }
    }
  }

  /** @param {Mesh} mesh */
  #add(mesh) {
    const own = [mesh.material].flat().map((material) => deform(material, this.uniforms));
    mesh.material = own.length === 1 ? own[0] : own;
    mesh.customDepthMaterial = deform(new MeshDepthMaterial({ depthPacking: RGBADepthPacking }), this.uniforms);
    mesh.customDistanceMaterial = deform(new MeshDistanceMaterial(), this.uniforms);
    mesh.geometry.boundingSphere = this.#sphere; // of the pose, not of the rest pose
    this.add(mesh);
  }
}

/**
 * A character of a service. Add it to a scene, and call `update` before each image.
 *
 * `mesh` is null until the character has arrived, and replaced when it is reloaded. The event `rebuilt` follows.
 *
 * @extends {Group<Object3DEventMap & {rebuilt: {}}>}
 */
export class Puppet extends Group {
  #options;
  #buffer;
  /** Stays until the new mesh shows a pose. @type {PuppetMesh | null} */
  #previous = null;

  /**
   * @param {Client} client
   * @param {string} name of the character
   * @param {{delay?: number, source?: () => Object3D, followRoot?: boolean}} [options] `delay` is the time by which the
   * shown pose lags behind the received frames, in seconds; `source` makes an object as described at `PuppetMesh`
   */
  constructor(client, name, options = {}) {
    super();
    this.#options = options;
    this.#buffer = new JitterBuffer(options.delay);
    /** @type {PuppetMesh | null} */
    this.mesh = null;
    this.character = new Character(client, name);
    this.character.addEventListener("scene", () => this.#rebuild());
    this.character.addEventListener("frame", () => {
      if (this.character.frame) this.#buffer.push(this.character.frame, seconds());
    });
  }

  /** Show the pose of this moment. */
  update() {
    const { earlier, later } = this.#buffer.advance(seconds()) ? this.#buffer : { earlier: null, later: null };
    if (!this.mesh || !earlier || !later) return;
    this.mesh.show(earlier, later, this.#buffer.share);
    this.#discard(this.#previous);
    this.#previous = null;
  }

  /** Stop following the character, and free what the graphics card holds. */
  dispose() {
    this.character.close();
    this.#discard(this.mesh);
    this.#discard(this.#previous);
    this.mesh = this.#previous = null;
  }

  #rebuild() {
    if (!this.character.scene) return;
    if (this.mesh?.visible) this.#previous = this.mesh;
    else this.#discard(this.mesh);
    const { delay, source, followRoot } = this.#options;
    this.#buffer = new JitterBuffer(delay);
    this.mesh = new PuppetMesh(this.character.scene, { source: source?.(), followRoot });
    this.add(this.mesh);
    this.dispatchEvent({ type: "rebuilt" });
  }

  /** @param {PuppetMesh | null} mesh */
  #discard(mesh) {
    if (!mesh) return;
    this.remove(mesh);
    mesh.dispose();
  }
}

function seconds() {
  return performance.now() / 1000;
}
