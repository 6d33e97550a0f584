/** The 3D view: characters that move as the stream says, bones and handles over them, and what the pointer does. */

import {
  AmbientLight,
  Color,
  DirectionalLight,
  GridHelper,
  Group,
  HemisphereLight,
  type Mesh,
  PerspectiveCamera,
  Raycaster,
  Scene as Stage,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import type { Joint } from "../model/skeleton";
import { type Part, type Puppet, axis, handlesOf, jointsOf, limbsOf, move } from "../model/puppet";
import { type Hit, type Ray, type Vector, add, cross, insideOf, meetPlane, meetTriangles, subtract } from "../model/vector";
import { type State, current, shownPuppet } from "../store";
import { carried, nearest, positionsOf } from "./blend";
import { makeMesh, pose } from "./character_mesh";
import { type Colours, type Marks, drawMarks, marksOf, partAt } from "./overlay";
import type { Scene } from "./stream";

/** Distance that the pointer moves before a click becomes a drag, in pixels. */
const SLOP = 4;

/** Distance that an arrow key moves a point, as a share of the character's diagonal. */
const NUDGE = 0.01;

interface Figure {
  readonly scene: Scene;
  readonly mesh: Mesh;
  readonly group: Group;
  readonly around: Map<string, number[]>;
  controls: Float32Array | null;
  shown: Float32Array | null | undefined;
}

export interface Callbacks {
  /** A part was clicked; null for none. */
  picked: (part: Part | null) => void;
  /** A part was dragged to another place. */
  moved: (puppet: Puppet) => void;
  /** A place was clicked with a tool: the point inside the body and the one on its surface. */
  placed: (inside: Vector, surface: Vector) => void;
  /** A drag has begun: edits are made on the rest pose. */
  resting: () => void;
}

export class Viewer {
  readonly canvas = document.createElement("canvas");
  private readonly overlay = document.createElement("canvas");
  private readonly renderer: WebGLRenderer;
  private readonly stage = new Stage();
  private readonly camera = new PerspectiveCamera(35, 1, 0.01, 200);
  private readonly orbit: OrbitControls;
  private readonly figures = new Map<string, Figure>();
  private readonly grid = new GridHelper(8, 16);
  private colours: Colours | null = null;
  private marks: Marks = { limbs: [], handles: [] };
  private hover: Part | null = null;
  private draft: Puppet | null = null;
  private puppets: State["puppets"] = {};
  private joint: Joint | null = null;
  private framed: string | null = null;
  private dirty = true;
  private frames = 0;
  /** Frames drawn in the last second. */
  drawnPerSecond = 0;

  constructor(
    private readonly parent: HTMLElement,
    private readonly callbacks: Callbacks,
  ) {
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.overlay.className = "overlay";
    this.overlay.tabIndex = 0;
    this.overlay.setAttribute("role", "application");
    parent.append(this.canvas, this.overlay);
    const sun = new DirectionalLight(0xffffff, 2.2);
    sun.position.set(2, 4, 3);
    const rim = new DirectionalLight(0xffffff, 0.8);
    rim.position.set(-3, 2, -3);
    this.stage.add(new AmbientLight(0xffffff, 0.5), new HemisphereLight(0xffffff, 0x8890a0, 0.9), sun, rim, this.grid);
    this.listen();
    this.orbit = new OrbitControls(this.camera, this.overlay);
    this.orbit.addEventListener("change", () => {
      this.dirty = true;
    });
    new ResizeObserver(() => {
      this.resize();
    }).observe(parent);
    this.theme();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.theme();
    });
    this.resize();
    this.renderer.setAnimationLoop(() => {
      this.draw();
    });
    setInterval(() => {
      this.drawnPerSecond = this.frames;
      this.frames = 0;
    }, 1000);
  }

  /** Show a scene of a character, or none. */
  setScene(name: string, scene: Scene | null): void {
    const old = this.figures.get(name);
    if (old !== undefined) {
      this.stage.remove(old.group);
      old.mesh.geometry.dispose();
      this.figures.delete(name);
    }
    if (scene !== null) {
      const group = standing(scene);
      const mesh = makeMesh(scene);
      group.add(mesh);
      this.stage.add(group);
      this.figures.set(name, {
        scene,
        mesh,
        group,
        around: old?.scene.revision === scene.revision ? old.around : new Map<string, number[]>(),
        controls: null,
        shown: undefined,
      });
      if (current().character === name && this.framed !== name) this.fit();
    }
    this.arrange();
    this.dirty = true;
  }

  setControls(name: string, controls: Float32Array): void {
    const figure = this.figures.get(name);
    if (figure === undefined) return;
    figure.controls = controls;
    this.dirty = true;
  }

  /** Forget characters that are not streamed any more. */
  keep(names: readonly string[]): void {
    for (const name of this.figures.keys()) if (!names.includes(name)) this.setScene(name, null);
  }

  has(name: string): boolean {
    return this.figures.has(name);
  }

  bounds(name: string): readonly [Vector, Vector] | null {
    return this.figures.get(name)?.scene.bounds ?? null;
  }

  /** Positions of a character's vertices as they are shown, in the mesh file's coordinates. */
  positions(name: string): Float32Array | null {
    const figure = this.figures.get(name);
    return figure === undefined ? null : positionsOf(figure.scene, this.controlsOf(figure));
  }

  label(text: string): void {
    this.overlay.setAttribute("aria-label", text);
  }

  /** Draw again after the state has changed. */
  refresh(state: State): void {
    if (state.puppets !== this.puppets) this.draft = null;
    this.puppets = state.puppets;
    this.dirty = true;
    this.overlay.classList.toggle("placing", state.tool !== "select");
    if (state.character !== null && state.character !== this.framed && this.figures.has(state.character)) this.fit();
  }

  /** Emphasise what a joint moves. */
  emphasise(joint: Joint | null): void {
    this.joint = joint;
    this.dirty = true;
  }

  /** Move the camera in front of the character that panels show. */
  fit(): void {
    const { character } = current();
    const figure = character === null ? undefined : this.figures.get(character);
    if (figure === undefined) return;
    this.arrange();
    this.framed = character;
    const box = corners(figure);
    const centre = box.low.clone().add(box.high).multiplyScalar(0.5);
    const size = box.high.clone().sub(box.low);
    const half = Math.tan((this.camera.fov * Math.PI) / 360);
    const across = Math.max(size.y, size.x / Math.max(this.camera.aspect, 0.1), (0.7 * size.z) / this.camera.aspect);
    const distance = (0.68 * across) / half + 0.5 * Math.max(size.x, size.z);
    centre.y -= 0.05 * size.y; // the toolbar is below
    this.orbit.target.copy(centre);
    this.camera.position.copy(centre).add(new Vector3(0.45, 0.18, 1).normalize().multiplyScalar(distance));
    this.camera.near = distance / 100;
    this.camera.far = distance * 50;
    this.camera.updateProjectionMatrix();
    this.orbit.update();
    const cell = 10 ** Math.round(Math.log10(size.length() / 4));
    this.grid.scale.setScalar(cell * 2);
    this.grid.position.copy(new Vector3(centre.x, box.low.y, centre.z));
    this.dirty = true;
  }

  private controlsOf(figure: Figure): Float32Array | null {
    return current().atRest ? null : figure.controls;
  }

  /** Put characters side by side, the one that panels show in front of the camera's first place. */
  private arrange(): void {
    let right = 0;
    for (const figure of this.figures.values()) {
      figure.group.position.set(0, 0, 0);
      const { low, high } = corners(figure);
      if (right !== 0) figure.group.position.x = right + 0.15 * (high.x - low.x) - low.x;
      right = corners(figure).high.x;
    }
  }

  private theme(): void {
    const style = getComputedStyle(document.documentElement);
    const of = (name: string): string => style.getPropertyValue(name).trim();
    this.colours = {
      left: of("--left"),
      right: of("--right"),
      middle: of("--middle"),
      accent: of("--accent"),
      edge: of("--mark-edge"),
      text: of("--text"),
      panel: of("--panel"),
    };
    this.stage.background = new Color(of("--stage"));
    const [main, fine] = [new Color(of("--grid-main")), new Color(of("--grid"))];
    const colours = this.grid.geometry.getAttribute("color");
    for (let i = 0; i < colours.count; i++) {
      const colour = Math.floor(i / 4) === 8 ? main : fine;
      colours.setXYZ(i, colour.r, colour.g, colour.b);
    }
    colours.needsUpdate = true;
    this.dirty = true;
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.parent;
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height, false);
    this.overlay.width = width * devicePixelRatio;
    this.overlay.height = height * devicePixelRatio;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.dirty = true;
  }

  private draw(): void {
    this.orbit.update();
    if (!this.dirty) return;
    this.dirty = false;
    this.frames++;
    const { character } = current();
    for (const [name, figure] of this.figures) {
      const controls = this.controlsOf(figure);
      if (controls !== figure.shown) {
        pose(figure.mesh, figure.scene, controls);
        figure.shown = controls;
      }
      figure.group.visible = name === character || this.figures.size === 1 || !current().atRest;
    }
    this.renderer.render(this.stage, this.camera);
    this.drawOverlay();
  }

  private drawOverlay(): void {
    const context = this.overlay.getContext("2d");
    if (context === null || this.colours === null) return;
    const state = current();
    const { character, selection, drawn } = state;
    const figure = character === null ? undefined : this.figures.get(character);
    const puppet = this.draft ?? shownPuppet(state);
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.clearRect(0, 0, this.overlay.width, this.overlay.height);
    this.marks = { limbs: [], handles: [] };
    if (figure === undefined || puppet === null || !state.bones) return;
    this.marks = marksOf(puppet, (part, point) => this.project(figure, this.posed(figure, part, point)));
    const joint = this.joint ?? state.joint;
    const parts: Part[] = [
      ...limbsOf(puppet).map(({ name }): Part => ({ kind: "limb", name })),
      ...handlesOf(puppet).map(({ name }): Part => ({ kind: "handle", name })),
    ];
    const moved = parts.filter((part) => joint !== null && jointsOf(puppet, part).includes(joint));
    drawMarks(context, this.marks, this.colours, {
      selection,
      hover: this.hover,
      moved: new Set(moved.map(({ name }) => name)),
      drawn: drawn.map((point) => this.project(figure, point)),
    });
  }

  /** A point of the rest pose as the surface around it has moved. */
  private posed(figure: Figure, part: Part, point: Vector): Vector {
    const controls = this.controlsOf(figure);
    if (controls === null) return point;
    const key = `${part.name} ${part.kind === "limb" ? (part.point ?? "") : "handle"} ${point.join()}`;
    let around = figure.around.get(key);
    if (around === undefined) {
      around = nearest(figure.scene, point);
      figure.around.set(key, around);
    }
    return carried(figure.scene, controls, around, point);
  }

  private project(figure: Figure, [x, y, z]: Vector): Vector | null {
    const point = figure.group.localToWorld(new Vector3(x, y, z)).project(this.camera);
    if (point.z > 1) return null;
    const { clientWidth: width, clientHeight: height } = this.parent;
    return [((point.x + 1) / 2) * width, ((1 - point.y) / 2) * height, point.z];
  }

  /** The ray through a place of the screen, in the mesh file's coordinates. */
  private ray(figure: Figure, x: number, y: number): Ray {
    const { clientWidth: width, clientHeight: height } = this.parent;
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2((2 * x) / width - 1, 1 - (2 * y) / height), this.camera);
    const origin = figure.group.worldToLocal(caster.ray.origin.clone());
    const through = figure.group.worldToLocal(caster.ray.origin.clone().add(caster.ray.direction));
    return { origin: [origin.x, origin.y, origin.z], direction: subtract([through.x, through.y, through.z], [origin.x, origin.y, origin.z]) };
  }

  private listen(): void {
    const { overlay } = this;
    overlay.addEventListener("pointerdown", (event) => {
      this.press(event);
    });
    overlay.addEventListener("pointermove", (event) => {
      if (event.buttons !== 0) return;
      const [x, y] = place(event);
      const hover = current().tool === "select" ? partAt(this.marks, x, y) : null;
      if (JSON.stringify(hover) === JSON.stringify(this.hover)) return;
      this.hover = hover;
      overlay.classList.toggle("over", hover !== null);
      this.dirty = true;
    });
    overlay.addEventListener("keydown", (event) => {
      this.key(event);
    });
  }

  private press(event: PointerEvent): void {
    const state = current();
    const figure = state.character === null ? undefined : this.figures.get(state.character);
    const puppet = shownPuppet(state);
    if (event.button !== 0 || figure === undefined || puppet === null) return;
    const [x, y] = place(event);
    const part = state.tool === "select" ? partAt(this.marks, x, y) : null;
    const grabbed = part !== null && (part.kind === "handle" || part.point !== undefined) ? part : null;
    if (grabbed !== null) {
      event.stopImmediatePropagation(); // the camera stays
      this.overlay.setPointerCapture(event.pointerId);
      this.overlay.focus();
    }
    let dragging = false;
    const from = grabbed === null ? null : pointOf(puppet, grabbed);
    const start = this.ray(figure, x, y);
    const onMove = (moved: PointerEvent): void => {
      const [nx, ny] = place(moved);
      if (!dragging && Math.hypot(nx - x, ny - y) > SLOP) {
        dragging = true;
        if (grabbed !== null) this.callbacks.resting();
      }
      if (!dragging || grabbed === null || from === null) return;
      const to = this.dragged(figure, grabbed, from, start, this.ray(figure, nx, ny));
      if (to === null) return;
      this.draft = move(puppet, grabbed, to);
      this.dirty = true;
    };
    const onUp = (): void => {
      this.overlay.removeEventListener("pointermove", onMove);
      this.overlay.removeEventListener("pointerup", onUp);
      this.overlay.removeEventListener("pointercancel", onUp);
      if (this.draft !== null && dragging) {
        if (grabbed !== null) this.callbacks.picked(grabbed);
        this.callbacks.moved(this.draft);
      } else if (!dragging) this.click(figure, part, x, y);
    };
    this.overlay.addEventListener("pointermove", onMove);
    this.overlay.addEventListener("pointerup", onUp);
    this.overlay.addEventListener("pointercancel", onUp);
  }

  private click(figure: Figure, part: Part | null, x: number, y: number): void {
    if (current().tool === "select") {
      this.callbacks.picked(part);
      return;
    }
    const hits = this.hits(figure, x, y);
    const inside = insideOf(hits);
    const surface = hits[0]?.point;
    if (inside === null || surface === undefined) return;
    this.callbacks.placed(inside, surface);
  }

  private hits(figure: Figure, x: number, y: number): Hit[] {
    return meetTriangles(this.ray(figure, x, y), positionsOf(figure.scene, this.controlsOf(figure)), figure.scene.triangles);
  }

  /** Where a dragged point is: moved in the plane of the view, or in the middle of or on the body under the pointer. */
  private dragged(figure: Figure, part: Part, from: Vector, start: Ray, now: Ray): Vector | null {
    if (current().dragging === "surface") {
      const hits = meetTriangles(now, figure.scene.positions, figure.scene.triangles);
      return part.kind === "handle" ? (hits[0]?.point ?? null) : insideOf(hits);
    }
    const normal = this.facing(figure);
    const [a, b] = [meetPlane(start, from, normal), meetPlane(now, from, normal)];
    return a === null || b === null ? null : add(from, subtract(b, a));
  }

  /** The direction of the view in the mesh file's coordinates. */
  private facing(figure: Figure): Vector {
    const d = this.camera.getWorldDirection(new Vector3());
    const turned = d.applyQuaternion(figure.group.quaternion.clone().invert());
    return [turned.x, turned.y, turned.z];
  }

  private key(event: KeyboardEvent): void {
    const state = current();
    const puppet = shownPuppet(state);
    const { selection, character } = state;
    const figure = character === null ? undefined : this.figures.get(character);
    const direction = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
    if (direction === undefined || selection === null || puppet === null || figure === undefined) return;
    const from = pointOf(puppet, selection);
    if (from === null) return;
    event.preventDefault();
    const step = NUDGE * figure.scene.diagonal * (event.shiftKey ? 5 : 1);
    const right = new Vector3(1, 0, 0).applyQuaternion(this.camera.quaternion);
    const up = new Vector3(0, 1, 0).applyQuaternion(this.camera.quaternion);
    const shift = right.multiplyScalar((direction[0] ?? 0) * step).add(up.multiplyScalar((direction[1] ?? 0) * step));
    shift.applyQuaternion(figure.group.quaternion.clone().invert());
    this.callbacks.resting();
    this.callbacks.moved(move(puppet, selection, add(from, [shift.x, shift.y, shift.z])));
  }
}

/** A group that stands the mesh file's coordinates upright, its front towards +z, in metres. */
function standing(scene: Scene): Group {
  const { up, front, metres_a_unit: unit } = scene as Scene & { up?: string; front?: string; metres_a_unit?: number };
  const [y, z] = [axis(up ?? "y"), axis(front ?? "z")];
  const x = cross(y, z);
  const group = new Group();
  group.matrix.set(x[0], x[1], x[2], 0, y[0], y[1], y[2], 0, z[0], z[1], z[2], 0, 0, 0, 0, 1);
  group.matrix.decompose(group.position, group.quaternion, group.scale);
  group.scale.setScalar(unit ?? 1);
  group.updateMatrixWorld();
  return group;
}

/** The corners of a character's box at rest, in the stage's coordinates. */
function corners({ scene, group }: Figure): { low: Vector3; high: Vector3 } {
  group.updateMatrixWorld();
  const [a, b] = scene.bounds.map(([x, y, z]) => group.localToWorld(new Vector3(x, y, z))) as [Vector3, Vector3];
  return { low: a.clone().min(b), high: a.clone().max(b) };
}

function pointOf(puppet: Puppet, part: Part): Vector | null {
  if (part.kind === "handle") return handlesOf(puppet).find(({ name }) => name === part.name)?.position ?? null;
  if (part.point === undefined) return null;
  return limbsOf(puppet).find(({ name }) => name === part.name)?.points[part.point] ?? null;
}

function place(event: PointerEvent): [number, number] {
  return [event.offsetX, event.offsetY];
}
