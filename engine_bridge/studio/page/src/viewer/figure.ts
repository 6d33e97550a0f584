/** One streamed character in the 3D view: its mesh, its present pose, and its materials. */

import { Box3, Color, Group, type Material, Matrix4, Mesh, type Object3D, Quaternion, Vector3 } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

import { Character, type Client, JitterBuffer } from "../../../../../integrations/web/puppetline.js";
import { PuppetMesh } from "../../../../../integrations/web/puppetline-three.js";
import type { FilmCharacter, Moment } from "../messages";
import { axis, turned } from "../model/puppet";
import { type Vector, cross, dot } from "../model/vector";
import { carried, nearest } from "./blend";

export type Scene = NonNullable<Character["scene"]>;
type Frame = NonNullable<Character["frame"]>;

/** Time by which poses lag behind the stream so that they can be interpolated, in seconds: one image at 60 Hz. */
const DELAY = 1 / 60;

export class Figure {
  /** Stands the character upright on the floor, its front towards +z, in metres. */
  readonly group = new Group();
  mesh: PuppetMesh | null = null;
  private buffer = new JitterBuffer(DELAY);
  private readonly character: Character;
  private readonly around = new Map<string, number[]>();
  private upright = new Quaternion();
  private rest: Frame | null = null;
  private shown: readonly unknown[] = [];
  /** When the buffer was asked last, in seconds of the page. */
  private posed = 0;
  private model = "";
  private source: Object3D | null = null;

  constructor(
    client: Client,
    readonly name: string,
    private readonly download: (id: string) => Promise<Blob>,
    private readonly changed: () => void,
  ) {
    this.character = new Character(client, name);
    this.character.addEventListener("scene", () => {
      this.rebuild();
    });
    this.character.addEventListener("frame", () => {
      if (this.character.frame !== null) this.buffer.push(this.character.frame, performance.now() / 1000);
    });
  }

  get scene(): Scene | null {
    return this.character.scene;
  }

  /** Receive poses, or let the character stand still as it is. */
  follow(receives: boolean): void {
    if (receives) this.character.resume();
    else this.character.pause();
  }

  dispose(): void {
    this.character.close();
    this.mesh?.dispose();
    this.group.removeFromParent();
  }

  /** Load the materials and textures of a file of the server, and draw with them; an empty id loads none. */
  async dress(model: string): Promise<void> {
    if (model === this.model) return;
    this.model = model;
    if (model === "") return;
    const data = await (await this.download(model)).arrayBuffer();
    const { scene } = await new GLTFLoader().parseAsync(data, "");
    if (this.model !== model) return;
    this.source = scene;
    this.rebuild();
  }

  /** Show the present pose, or the rest pose; return whether it differs from the one shown before. */
  pose(atRest: boolean): boolean {
    if (this.mesh === null) return false;
    this.posed = performance.now() / 1000;
    const moving = this.buffer.advance(this.posed) && !atRest;
    const earlier = moving ? this.buffer.earlier : this.rest;
    const later = moving ? this.buffer.later : this.rest;
    if (earlier === null || later === null) return false;
    const share = moving ? this.buffer.share : 0;
    const now = [earlier, later, share];
    if (now.every((each, i) => each === this.shown[i])) return false;
    this.shown = now;
    this.mesh.show(earlier, later, share);
    return true;
  }

  /** Positions of all vertices as they are shown, three numbers each, in the mesh file's coordinates. */
  positions(): Float32Array {
    return this.mesh === null ? new Float32Array() : this.mesh.evaluate().positions;
  }

  /** The numbers of the two frames between which the shown pose lies, and its share of the way between them. */
  get moment(): { earlier: number; later: number; share: number } | null {
    const [earlier, later, share] = this.shown as [Frame?, Frame?, number?];
    if (earlier === undefined || later === undefined || earlier === this.rest) return null;
    return { earlier: earlier.header.sequence, later: later.header.sequence, share: share ?? 0 };
  }

  /** The time that is shown at a moment of the page, both in seconds; of the service's monotonic clock, or null. */
  serviceTime(now: number): number | null {
    const { earlier, time } = this.buffer;
    return earlier === null ? null : time + now - this.posed + Number(earlier.header.received) / 1e9 - earlier.header.time;
  }

  /** Displacement of the whole character by walking, in the view's coordinates. */
  walked(): Vector3 {
    const [earlier, later, share] = this.shown as [Frame?, Frame?, number?];
    if (earlier === undefined || later === undefined) return new Vector3();
    const root = new Vector3(...earlier.header.root).lerp(new Vector3(...later.header.root), share ?? 0);
    return root.applyQuaternion(this.group.quaternion).multiply(this.group.scale);
  }

  /** Where a point of the rest pose is now: it moves as the surface around it. */
  carried(part: string, point: Vector): Vector {
    const [earlier, later, share] = this.shown as [Frame?, Frame?, number?];
    if (this.scene === null || earlier?.kind !== "controls" || later?.kind !== "controls" || earlier === this.rest) return point;
    const key = `${part} ${point.join(" ")}`;
    let vertices = this.around.get(key);
    if (vertices === undefined) {
      vertices = nearest(this.scene, point);
      this.around.set(key, vertices);
    }
    const [from, to] = [carried(this.scene, earlier.body, vertices, point), carried(this.scene, later.body, vertices, point)];
    const mix = (k: 0 | 1 | 2): number => from[k] + (share ?? 0) * (to[k] - from[k]);
    return [mix(0), mix(1), mix(2)];
  }

  /** The box at rest, in the view's coordinates. */
  box(): Box3 {
    this.group.updateMatrixWorld();
    const [low, high] = this.bounds() ?? [[0, 0, 0], [1, 1, 1]];
    return new Box3(new Vector3(...low), new Vector3(...high)).applyMatrix4(this.group.matrixWorld);
  }

  /** The box as far as the character has walked. */
  walkedBox(): Box3 {
    return this.box().translate(this.walked().setY(0));
  }

  /** How tall it is without a height of its own in the film, in metres. */
  get height(): number | null {
    const extent = this.upwards();
    return extent === null || this.scene === null ? null : (extent[1] - extent[0]) * this.scene.description.metres_a_unit;
  }

  /** Stand on the floor where a row of the scene says, and as tall. */
  stand({ position, turn = 0, height = null }: Partial<FilmCharacter>): void {
    const [x, z] = position ?? [0, 0];
    const extent = this.upwards();
    if (this.scene === null || extent === null) return;
    const [low, high] = extent;
    const scale = height === null ? this.scene.description.metres_a_unit : height / Math.max(high - low, 1e-12);
    this.group.scale.setScalar(scale);
    this.group.position.set(x, -low * scale, z);
    this.turn(turn);
  }

  /** Stand at a place of the film's plan: a position, and a turn in degrees. */
  place([x, y, z, turn]: Moment["places"][string]): void {
    this.group.position.set(x, y, z);
    this.turn(turn);
  }

  private turn(degrees: number): void {
    this.group.quaternion.setFromAxisAngle(new Vector3(0, 1, 0), (degrees * Math.PI) / 180).multiply(this.upright);
    this.group.updateMatrixWorld();
  }

  /** Multiply the colours of its materials by a colour; with null, they are the file's. */
  tint(colour: string | null): void {
    this.mesh?.traverse((part) => {
      if (!(part instanceof Mesh)) return;
      for (const material of [part.material as Material | Material[]].flat()) {
        if (!("color" in material && material.color instanceof Color)) continue;
        const own = (material.userData.own ??= material.color.clone()) as Color;
        material.color.copy(own).multiply(new Color(colour ?? "white"));
      }
    });
  }

  /** The lowest and the highest vertex, along the mesh's direction of up. */
  private upwards(): readonly [number, number] | null {
    const bounds = this.bounds();
    if (bounds === null || this.scene === null) return null;
    const [a, b] = bounds.map((corner) => dot(corner, axis(this.scene?.description.up ?? "y")));
    return [Math.min(a ?? 0, b ?? 0), Math.max(a ?? 0, b ?? 0)];
  }

  /** The corners of the box at rest, in the mesh file's coordinates. */
  bounds(): readonly [Vector, Vector] | null {
    return (this.scene?.description.bounds ?? null) as readonly [Vector, Vector] | null;
  }

  private rebuild(): void {
    const { scene } = this;
    if (scene === null) return;
    if (this.mesh !== null) {
      this.mesh.removeFromParent();
      this.mesh.dispose();
    }
    this.mesh = meshOf(scene, this.source);
    this.group.add(this.mesh);
    this.upright = uprightOf(scene);
    this.stand({});
    this.buffer = new JitterBuffer(DELAY);
    this.around.clear();
    this.rest = restOf(scene);
    this.shown = [];
    this.changed();
  }
}

/** The mesh with the file's materials, or with plain ones while the file does not fit the scene. */
function meshOf(scene: Scene, source: Object3D | null): PuppetMesh {
  if (source !== null) {
    try {
      return new PuppetMesh(scene, { source });
    } catch (error) {
      if (!(error instanceof RangeError)) throw error;
    }
  }
  return new PuppetMesh(scene);
}

/** A frame of controls that leave every vertex where it is. */
function restOf({ fields, isolines }: Scene): Frame {
  const body = new Float32Array(12 * fields * isolines);
  for (let at = 0; at < body.length; at += 12) body[at] = body[at + 5] = body[at + 10] = 1;
  return { topic: "", kind: "controls", body, targets: new Float32Array(), header: { root: [0, 0, 0] } } as unknown as Frame;
}

/** The rotation that stands a mesh upright, its front towards +z. */
function uprightOf({ description: { up, front, turn = 0 } }: Scene): Quaternion {
  const y = axis(up);
  const z = turned(axis(front), y, turn);
  const x = cross(y, z);
  return new Quaternion().setFromRotationMatrix(new Matrix4().set(x[0], x[1], x[2], 0, y[0], y[1], y[2], 0, z[0], z[1], z[2], 0, 0, 0, 0, 1));
}
