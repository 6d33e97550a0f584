/** The 3D view: characters that the stream moves, bones and handles over them, and the actions of the pointer. */

import { Box3, Vector3 } from "three";

import type { Client } from "../../../../../integrations/web/puppetline.js";
import type { FilmPlan, Moment } from "../messages";
import { type Part, type Puppet, move, pointOf } from "../model/puppet";
import type { Joint } from "../model/skeleton";
import { placeOf, rowOf } from "../model/scene";
import { type Hit, type Ray, type Vector, add, insideOf, meetPlane, meetTriangles, scale, subtract } from "../model/vector";
import { type State, current, isWorking, shownPuppet } from "../store";
import { Figure } from "./figure";
import { Ground } from "./ground";
import { type Marks, drawMarks, marksOf, movedBy, partAt } from "./overlay";
import { untilRelease } from "./pointer";
import { PlayingFilm } from "./playing_film";
import { Portraits } from "./portraits";
import { FRONT, SIDE, Stage } from "./stage";
import { type Draft, characterAt, dragged, stand } from "./standing";

/** Time between images while the machine makes a film without a graphics card, in milliseconds, unless the camera moves. */
const WORKING_MS = 4000;

/** Distance that the pointer moves before a click becomes a drag, in pixels. */
const SLOP = 4;

/** Distance that an arrow key moves a point, as a share of the character's diagonal. */
const NUDGE = 0.01;

const ARROWS: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

export interface Callbacks {
  /** A part was clicked; null for none. */
  picked: (part: Part | null) => void;
  /** A part was dragged to another position. */
  moved: (puppet: Puppet) => void;
  /** The body was clicked with a tool: the point inside the body and the one on its surface. */
  placed: (inside: Vector, surface: Vector) => void;
  /** A drag has begun: edits are made on the rest pose. */
  resting: () => void;
  /** A character was clicked. */
  chosen: (name: string) => void;
  /** A character is dragged over the floor, or with null no more; or it was dragged there. */
  standing: (draft: Draft | null) => void;
  stood: (draft: Draft) => void;
  /** A character's moving picture was drawn. */
  drawn: (name: string, picture: string) => void;
  /** A character's mesh has arrived. */
  arrived: () => void;
  download: (id: string) => Promise<Blob>;
}

export class Viewer {
  private readonly canvas = document.createElement("canvas");
  private readonly overlay = document.createElement("canvas");
  private readonly stage: Stage;
  private readonly figures = new Map<string, Figure>();
  private marks: Marks = { limbs: [], handles: [] };
  private hover: Part | null = null;
  /** Where a point is dragged to. */
  private drag: { readonly part: Part; readonly to: Vector } | null = null;
  private joint: Joint | null = null;
  /** What the camera was moved in front of: the face of the page, and the characters that are shown. */
  private framed = "";
  /** Places and sizes of the characters, as they stand now. */
  private standing = "";
  private readonly playing: PlayingFilm;
  private readonly ground = new Ground();
  private readonly portraits: Portraits;
  /** How far the framed characters had walked when the camera followed them last. */
  private walked = new Vector3();
  private dirty = true;
  private frames = 0;
  /** Frames drawn in the last second. */
  drawnPerSecond = 0;

  constructor(
    private readonly parent: HTMLElement,
    private readonly callbacks: Callbacks,
  ) {
    this.overlay.className = "overlay";
    this.overlay.tabIndex = 0;
    this.overlay.setAttribute("role", "application");
    parent.append(this.canvas, this.overlay);
    const changed = (): void => {
      this.dirty = true;
    };
    this.stage = new Stage(parent, this.canvas, changed);
    this.playing = new PlayingFilm(this.stage, this.overlay);
    this.portraits = new Portraits(this.stage, this.callbacks.drawn);
    this.stage.scene.add(this.ground.group);
    this.listen(); // before the camera's own listeners, to keep drags of points from it
    this.stage.control(this.overlay);
    new ResizeObserver(() => {
      this.resize();
    }).observe(parent);
    const theme = (): void => {
      this.stage.theme();
      this.ground.theme(this.stage.colours?.accent ?? "");
      this.dirty = true;
    };
    theme();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", theme);
    this.resize();
    this.stage.animate(() => {
      this.draw();
    });
    setInterval(() => {
      this.drawnPerSecond = this.frames;
      this.frames = 0;
    }, 1000);
  }

  /** Follow exactly these characters of a service: names and files with their materials. */
  follow(client: Client, characters: readonly { name: string; model: string }[]): void {
    for (const [name, figure] of this.figures) {
      if (characters.some((each) => each.name === name)) continue;
      figure.dispose();
      this.figures.delete(name);
      this.dirty = true;
    }
    for (const { name, model } of characters) {
      let figure = this.figures.get(name);
      if (figure === undefined) {
        figure = new Figure(client, name, this.callbacks.download, () => {
          this.arrived();
        });
        this.figures.set(name, figure);
        this.stage.scene.add(figure.group);
      }
      figure.dress(model).catch(() => undefined); // drawn with plain materials
    }
  }

  /** Whether characters stand still, since the machine is slow and works at something else, as at a film. */
  get rests(): boolean {
    return this.stage.isSlow && isWorking(current()) && current().server?.recording === null;
  }

  has(name: string): boolean {
    return this.figures.get(name)?.mesh != null;
  }

  bounds(name: string): readonly [Vector, Vector] | null {
    return this.figures.get(name)?.bounds() ?? null;
  }

  /** See `Figure.height`. */
  height(name: string): number | null {
    return this.figures.get(name)?.height ?? null;
  }

  /** The corners of each character's box at rest, in the view's coordinates. */
  boxes() {
    return Object.fromEntries([...this.figures].map(([name, figure]) => {
      const { min, max } = figure.box();
      return [name, [min, max]];
    }));
  }

  /** The boxes of characters where they are now. */
  private present(): Map<string, Box3> {
    const drawn = [...this.figures].filter(([, { mesh }]) => mesh !== null);
    return new Map(drawn.map(([name, figure]) => [name, figure.walkedBox()]));
  }

  /** Positions of a character's vertices as they are shown, in the mesh file's coordinates. */
  positions(name: string): Float32Array | null {
    return this.figures.get(name)?.positions() ?? null;
  }

  /** The frames between which a character's shown pose lies, and the positions of its vertices. */
  shown(name: string) {
    const figure = this.figures.get(name);
    return figure === undefined ? null : { moment: figure.moment, positions: [...figure.positions()] };
  }

  /** The frames between which a character's shown pose lies. */
  moment(name: string) {
    return this.figures.get(name)?.moment ?? null;
  }

  /** See `Figure.serviceTime`. */
  serviceTime(name: string, now: number): number | null {
    return this.figures.get(name)?.serviceTime(now) ?? null;
  }

  /** Where the parts of the shown puppet are on the screen, in pixels of the view. */
  places(): Marks {
    return this.marks;
  }

  label(text: string): void {
    this.overlay.setAttribute("aria-label", text);
  }

  /** Draw again after the state has changed. */
  refresh(state: State): void {
    this.dirty = true;
    const { rests } = this;
    for (const figure of this.figures.values()) figure.follow(!rests);
    this.overlay.classList.toggle("placing", state.tool !== "select");
    this.overlay.classList.toggle("film", state.face === "film");
    this.stage.show(state.face === "film" ? placeOf(state.film.present.scene) : null);
    this.stage.light(state.face === "film" ? (state.server?.film.light ?? null) : null);
    const moved = this.arrange(state);
    if (this.shownIn(state) !== this.framed) this.fit();
    else if (moved && state.face === "film" && state.draft === null && !this.playing.isShown && !this.isAllInView()) this.fit();
  }

  /** Show a moment of the film, whose picture has a size; with null, what the user looks at. */
  film(moment: Moment | null, size?: FilmPlan["size"]): void {
    if (!this.playing.show(moment, size)) return;
    this.dirty = true;
    if (moment !== null) return;
    this.standing = "";
    this.refresh(current());
  }

  /** What the camera should be in front of: in the film all characters, in the workshop the one that panels show. */
  private shownIn({ face, character }: State): string {
    const drawn = [...this.figures.values()].filter(({ mesh }) => mesh !== null).map(({ name }) => name);
    const shown = face === "film" ? drawn : drawn.filter((name) => name === character);
    return shown.length === 0 ? this.framed : `${face} ${shown.join(" ")}`;
  }

  /** Emphasise what a joint moves. */
  emphasise(joint: Joint | null): void {
    if (joint === this.joint) return;
    this.joint = joint;
    this.dirty = true;
  }

  /** Move the camera in front of what is shown. */
  fit(): void {
    const state = current();
    const { face } = state;
    const boxes = this.followed(face).map((figure) => figure.box());
    if (boxes.length === 0) return;
    this.framed = this.shownIn(state);
    const all = boxes.reduce((box, each) => box.union(each));
    if (face === "workshop") all.min.y -= 0.2 * (all.max.y - all.min.y); // the toolbar is below
    this.stage.frame(all, face === "film" && boxes.length > 1 ? FRONT : SIDE);
    this.walked = new Vector3();
    this.dirty = true;
  }

  /** The characters that the camera follows. */
  private followed(face: State["face"]): Figure[] {
    const chosen = this.chosen();
    const figures = face === "film" ? [...this.figures.values()] : chosen === undefined ? [] : [chosen];
    return figures.filter(({ mesh }) => mesh !== null);
  }

  private isAllInView(): boolean {
    const all = [...this.present().values()];
    return all.every((box) => this.stage.isInView(box));
  }

  private chosen(): Figure | undefined {
    const { character } = current();
    return character === null ? undefined : this.figures.get(character);
  }

  private arrived(): void {
    this.standing = "";
    this.refresh(current());
    this.callbacks.arrived();
  }

  /** Let characters stand as the film's scene says, and return whether that has changed. */
  private arrange({ film, draft, face }: State): boolean {
    const standing = JSON.stringify([face, film.present.scene.character, draft, [...this.figures.keys()]]);
    if (standing === this.standing) return false;
    this.standing = standing;
    stand(this.figures, film.present.scene, draft, face);
    return true;
  }

  private resize(): void {
    this.stage.resize();
    this.overlay.width = this.stage.width * devicePixelRatio;
    this.overlay.height = this.stage.height * devicePixelRatio;
    this.dirty = true;
  }

  private draw(): void {
    const { atRest, face, character } = current();
    for (const figure of this.figures.values()) if (figure.pose(atRest)) this.dirty = true;
    if (this.parent.offsetParent !== null && face === "film" && this.portraits.take(this.figures)) this.dirty = true;
    if (!this.dirty || this.parent.offsetParent === null) {
      this.stage.pause();
      return;
    }
    this.dirty = false;
    this.frames++;
    const { playing } = this;
    if (playing.isShown) playing.place(this.figures);
    else this.accompany();
    this.ground.lie(face === "film" ? this.present() : new Map(), playing.isShown ? null : character);
    if (playing.isShown) playing.draw();
    else {
      this.stage.render();
      this.drawOverlay();
    }
    this.stage.keepPace(isWorking(current()) ? WORKING_MS : 0);
  }

  private accompany(): void {
    const followed = this.followed(current().face);
    if (this.shownIn(current()) !== this.framed || followed.length === 0) return;
    const walked = followed.reduce((sum, figure) => sum.add(figure.walked()), new Vector3()).divideScalar(followed.length);
    this.stage.accompany(walked.clone().sub(this.walked));
    this.walked = walked;
  }

  private drawOverlay(): void {
    const context = this.overlay.getContext("2d");
    const { colours } = this.stage;
    if (context === null || colours === null) return;
    const state = current();
    const figure = this.chosen();
    const puppet = this.edited();
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.clearRect(0, 0, this.overlay.width, this.overlay.height);
    this.marks = { limbs: [], handles: [] };
    if (figure?.mesh == null || puppet === null || !state.bones || state.face === "film") return;
    this.marks = marksOf(puppet, (part, point) =>
      this.stage.project(figure, figure.carried(`${part.kind} ${part.name}`, point)),
    );
    drawMarks(context, this.marks, colours, {
      selection: state.selection,
      hover: this.hover,
      moved: movedBy(puppet, this.joint ?? state.joint),
      drawn: state.drawn.map((point) => this.stage.project(figure, point)),
    });
  }

  /** The shown puppet, with the point that is dragged where it would be put. */
  private edited(): Puppet | null {
    const puppet = shownPuppet(current());
    return puppet === null || this.drag === null ? puppet : move(puppet, this.drag.part, this.drag.to);
  }

  private listen(): void {
    const { overlay } = this;
    overlay.addEventListener("pointerdown", (event) => {
      if (current().face === "film") this.grasp(event);
      else this.press(event);
    });
    overlay.addEventListener("pointermove", (event) => {
      if (event.buttons !== 0) return;
      if (current().face === "film") {
        overlay.classList.toggle("over", characterAt(this.stage.through(event.offsetX, event.offsetY), this.present()) !== null);
        return;
      }
      const hover = current().tool === "select" ? partAt(this.marks, event.offsetX, event.offsetY) : null;
      if (JSON.stringify(hover) === JSON.stringify(this.hover)) return;
      this.hover = hover;
      overlay.classList.toggle("over", hover !== null);
      this.dirty = true;
    });
    overlay.addEventListener("keydown", (event) => {
      this.nudge(event);
    });
  }

  /** Choose a character by a click, or begin to drag it over the floor; a drag beside all characters moves the camera. */
  private grasp(event: PointerEvent): void {
    const { offsetX: x, offsetY: y } = event;
    const name = characterAt(this.stage.through(x, y), this.present());
    if (event.button !== 0 || name === null) return;
    event.stopImmediatePropagation(); // the camera stays
    this.overlay.setPointerCapture(event.pointerId);
    const row = rowOf(current().film.present.scene, name);
    const stands = this.figures.get(name)?.group.position ?? new Vector3();
    const foot = this.stage.onScreen(new Vector3(stands.x, 0, stands.z)); // it follows the pointer wherever it was grasped
    const from = foot === null ? null : this.stage.through(foot[0], foot[1]);
    let draft: Draft | null = null;
    const drag = (moved: PointerEvent): void => {
      if (this.playing.isShown || row === undefined || foot === null || from === null || (draft === null && Math.hypot(moved.offsetX - x, moved.offsetY - y) <= SLOP)) return;
      draft = dragged(row, from, this.stage.through(foot[0] + moved.offsetX - x, foot[1] + moved.offsetY - y)) ?? draft;
      if (draft !== null) this.callbacks.standing(draft);
    };
    untilRelease(this.overlay, drag, () => {
      if (draft === null) this.callbacks.chosen(name);
      else this.callbacks.stood(draft);
    }, () => {
      this.callbacks.standing(null);
    });
  }

  /** Begin a click, or the drag of a point; a drag beside all points moves the camera. */
  private press(event: PointerEvent): void {
    const figure = this.chosen();
    const puppet = shownPuppet(current());
    if (event.button !== 0 || figure?.mesh == null || puppet === null) return;
    const { offsetX: x, offsetY: y } = event;
    const part = current().tool === "select" ? partAt(this.marks, x, y) : null;
    const from = part === null ? null : pointOf(puppet, part);
    if (from !== null) {
      event.stopImmediatePropagation(); // the camera stays
      this.overlay.setPointerCapture(event.pointerId);
      this.overlay.focus();
    }
    const start = this.stage.ray(figure, x, y);
    let dragging = false;
    const stop = (): void => {
      this.drag = null;
      this.dirty = true;
    };
    const drag = (moved: PointerEvent): void => {
      if (!dragging && Math.hypot(moved.offsetX - x, moved.offsetY - y) > SLOP) {
        dragging = true;
        if (from !== null) this.callbacks.resting();
      }
      if (!dragging || part === null || from === null) return;
      const to = this.dragged(figure, part, from, start, this.stage.ray(figure, moved.offsetX, moved.offsetY));
      if (to === null) return;
      this.drag = { part, to };
      this.dirty = true;
    };
    untilRelease(this.overlay, drag, () => {
      const edited = this.edited();
      if (!dragging) this.click(figure, part, x, y);
      else if (this.drag !== null && edited !== null) {
        this.callbacks.moved(edited);
        this.callbacks.picked(part);
      }
      stop();
    }, stop);
  }

  private click(figure: Figure, part: Part | null, x: number, y: number): void {
    if (current().tool === "select") {
      this.callbacks.picked(part);
      return;
    }
    const hits = this.hits(figure, this.stage.ray(figure, x, y));
    const inside = insideOf(hits);
    const surface = hits[0]?.point;
    if (inside !== null && surface !== undefined) this.callbacks.placed(inside, surface);
  }

  private hits(figure: Figure, ray: Ray): Hit[] {
    return figure.scene === null ? [] : meetTriangles(ray, figure.positions(), figure.scene.triangles);
  }

  /** Where a dragged point is: moved in the plane of the view, or in the middle of or on the body under the pointer. */
  private dragged(figure: Figure, part: Part, from: Vector, start: Ray, now: Ray): Vector | null {
    if (current().dragging === "surface") {
      const hits = this.hits(figure, now);
      return part.kind === "handle" ? (hits[0]?.point ?? null) : insideOf(hits);
    }
    const { forward } = this.stage.axes(figure);
    const [a, b] = [meetPlane(start, from, forward), meetPlane(now, from, forward)];
    return a === null || b === null ? null : add(from, subtract(b, a));
  }

  private nudge(event: KeyboardEvent): void {
    const { selection } = current();
    const puppet = shownPuppet(current());
    const figure = this.chosen();
    const way = ARROWS[event.key];
    if (way === undefined || selection === null || puppet === null || figure?.scene == null) return;
    const from = pointOf(puppet, selection);
    if (from === null) return;
    event.preventDefault();
    const step = NUDGE * figure.scene.description.diagonal * (event.shiftKey ? 5 : 1);
    const { right, up } = this.stage.axes(figure);
    this.callbacks.resting();
    this.callbacks.moved(move(puppet, selection, add(from, add(scale(right, way[0] * step), scale(up, way[1] * step)))));
  }
}
