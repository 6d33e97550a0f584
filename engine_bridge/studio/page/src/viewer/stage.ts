/** The 3D scene in which characters are shown: camera, light, floor, and colours of the theme. */

import {
  AmbientLight,
  type Box3,
  Color,
  DirectionalLight,
  GridHelper,
  HemisphereLight,
  type Light,
  PerspectiveCamera,
  type Ray as Line,
  Raycaster,
  Scene,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

import type { Lighting, ShownView } from "../messages";
import { type Ray, type Vector, subtract } from "../model/vector";
import { Backdrop, RADIUS } from "./backdrop";
import type { Figure } from "./figure";
import type { Colours } from "./overlay";

const CELLS = 16;

/** Number of images over which the time between them is measured. */
const MEASURED_IMAGES = 12;

/** Time between images above which fewer pixels are drawn, in milliseconds. */
const SLOW_MS = 70;

/** Greatest time after an image in which nothing is drawn, in milliseconds. */
const GREATEST_IDLE_MS = 200;

/** Least number of drawn pixels per pixel of the page, along each side. */
const LEAST_RATIO = 0.6;

/** Half of the height of the view, and of a portrait, in sizes of what it shows. */
const ROOM = 0.62;
const PORTRAIT_ROOM = 0.58;

/** Distance of the nearest point that a camera of the film sees, as a share of that of its target. */
const NEAR_SHARE = 0.02;

/** Directions from which the camera looks at one character, and at all. */
export const SIDE = new Vector3(0.45, 0.18, 1);
export const FRONT = new Vector3(0.2, 0.14, 1);

export class Stage {
  readonly scene = new Scene();
  readonly camera = new PerspectiveCamera(35, 1, 0.01, 200);
  colours: Colours | null = null;
  private readonly backdrop = new Backdrop(this.scene, () => {
    this.theme();
    this.changed();
  });
  private readonly renderer: WebGLRenderer;
  private readonly grid = new GridHelper(CELLS / 2, CELLS);
  private readonly ambient = new AmbientLight(0xffffff, 0.5);
  private readonly around = new HemisphereLight();
  private readonly sun = new DirectionalLight();
  private readonly rim = new DirectionalLight(0xffffff, 0.8);
  /** The film's camera while the film is shown. */
  private filmed: PerspectiveCamera | null = null;
  private orbit: OrbitControls | null = null;
  private ratio = Math.min(devicePixelRatio, 2);
  private images = 0;
  private measuredFrom = 0;
  /** Time after each image in which nothing is drawn, and after the present one, in milliseconds. */
  private idle = 0;
  private rest = 0;
  /** The end of such a time, and what ends it earlier. */
  private resting: ReturnType<typeof setTimeout> | undefined;
  private wake = (): void => undefined;

  constructor(
    private readonly parent: HTMLElement,
    canvas: HTMLCanvasElement,
    private readonly changed: () => void = () => undefined,
    /** Whether the characters stand on a transparent ground without a grid. */
    bare = false,
  ) {
    this.renderer = new WebGLRenderer({ canvas, alpha: bare, antialias: !isSoftware() });
    this.renderer.setPixelRatio(this.ratio);
    this.rim.position.set(-3, 2, -3);
    this.scene.add(this.ambient, this.around, this.sun, this.rim);
    this.light(null);
    if (!bare) this.scene.add(this.grid);
  }

  /** Whether images follow each other slowly, as without a graphics card; see `keepPace`. */
  get isSlow(): boolean {
    return this.idle > 0;
  }

  get width(): number {
    return this.parent.clientWidth;
  }

  get height(): number {
    return this.parent.clientHeight;
  }

  /** Let the pointer over an element move the camera. */
  control(element: HTMLElement): void {
    this.orbit = new OrbitControls(this.camera, element);
    this.orbit.addEventListener("change", () => {
      this.wake();
      this.changed();
    });
  }

  /** Show a place around the characters, see `Backdrop.show`. */
  show(picture: string | null): void {
    this.backdrop.show(picture);
  }

  /** Light everything as the film does; with null, so that all sides are seen well. */
  light(film: Lighting | null): void {
    this.ambient.visible = this.rim.visible = film === null;
    this.sun.position.set(...(film?.direction ?? [2, 4, 3]));
    const lit = (light: Light, colour: Color, [r, g, b]: Lighting["key"]): void => {
      colour.setRGB(r, g, b);
      light.intensity = Math.PI; // a matt surface reflects its colour in all directions
    };
    if (film === null) {
      this.around.copy(new HemisphereLight(0xffffff, 0x8890a0, 0.9));
      [this.sun.color, this.sun.intensity] = [new Color(0xffffff), 2.2];
    } else {
      lit(this.sun, this.sun.color, film.key);
      lit(this.around, this.around.color, film.sky);
      lit(this.around, this.around.groundColor, film.ground);
    }
  }

  /** Look through a camera of the film, whose picture is as large as fits into the view; with null, as the user does. */
  film(view: ShownView | null, ratio = 1): void {
    if (view === null) {
      this.filmed = null;
      return;
    }
    const camera = (this.filmed ??= new PerspectiveCamera());
    const [eye, target] = [new Vector3(...view.eye), new Vector3(...view.target)];
    const distance = eye.distanceTo(target);
    const slope = Math.tan((view.field_of_view * Math.PI) / 360);
    camera.aspect = this.width / this.height;
    camera.fov = (360 / Math.PI) * Math.atan(slope * Math.max(1, ratio / camera.aspect));
    camera.near = NEAR_SHARE * distance;
    camera.far = farOf(distance);
    camera.position.copy(eye);
    camera.lookAt(target);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
  }

  /** Whether the film is shown. */
  get isFilm(): boolean {
    return this.filmed !== null;
  }

  /** The camera through which the view is seen. */
  private get eye(): PerspectiveCamera {
    return this.filmed ?? this.camera;
  }

  /** Draw images, one after another. */
  animate(draw: () => void): void {
    const image = (): void => {
      this.orbit?.update();
      draw();
      const rest = this.rest;
      this.rest = 0;
      // a page that asks for its next image is composed 60 times a second, even if nothing is drawn
      if (rest > 0) this.resting = setTimeout(this.wake, rest);
      else requestAnimationFrame(image);
    };
    this.wake = () => {
      if (this.resting === undefined) return;
      clearTimeout(this.resting);
      this.resting = undefined;
      requestAnimationFrame(image);
    };
    requestAnimationFrame(image);
  }

  render(): void {
    this.renderer.render(this.scene, this.eye);
  }

  /** Draw what is seen now over another canvas. */
  copyTo(context: CanvasRenderingContext2D, opacity: number): void {
    const { width, height } = context.canvas;
    context.globalAlpha = opacity;
    context.drawImage(this.renderer.domElement, 0, 0, width, height);
    context.globalAlpha = 1;
  }

  /** Begin to measure again, after a time in which nothing was drawn. */
  pause(): void {
    this.images = 0;
  }

  /**
   * Draw fewer pixels, and then fewer images, if they follow each other slowly, as without a graphics card. While such a
   * machine works at something else, as at a film, images follow each other after at least `working` milliseconds.
   */
  keepPace(working: number): void {
    const now = performance.now();
    this.rest = this.isSlow ? Math.max(working, this.idle) : 0;
    if (this.images === 0) this.measuredFrom = now;
    if (this.images++ < MEASURED_IMAGES) return;
    const interval = (now - this.measuredFrom) / MEASURED_IMAGES;
    this.images = 0;
    if (interval <= SLOW_MS || this.isSlow) return;
    if (this.ratio <= LEAST_RATIO) this.idle = Math.min(interval, GREATEST_IDLE_MS);
    this.ratio = Math.max(LEAST_RATIO, 0.8 * this.ratio);
    this.renderer.setPixelRatio(this.ratio);
    this.resize();
  }

  resize(): void {
    if (this.width === 0 || this.height === 0) return;
    this.renderer.setSize(this.width, this.height, false);
    this.wake(); // it is empty now
    this.camera.aspect = this.width / this.height;
    this.camera.updateProjectionMatrix();
  }

  /** Take the colours of the style sheet. */
  theme(): void {
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
      stage: of("--stage"),
    };
    this.grid.visible = !this.backdrop.isShown;
    if (this.grid.visible) this.scene.background = new Color(of("--stage"));
    const [main, fine] = [new Color(of("--grid-main")), new Color(of("--grid"))];
    const colours = this.grid.geometry.getAttribute("color");
    for (let i = 0; i < colours.count; i++) {
      const { r, g, b } = Math.floor(i / 4) === CELLS / 2 ? main : fine;
      colours.setXYZ(i, r, g, b);
    }
    colours.needsUpdate = true;
  }

  /** Move the camera in front of a box, looking from a direction. */
  frame(box: Box3, from: Vector3): void {
    const size = box.getSize(new Vector3());
    const centre = aim(this.camera, box, from, ROOM);
    this.orbit?.target.copy(centre);
    this.orbit?.update();
    this.grid.scale.setScalar(2 * 10 ** Math.round(Math.log10(size.length() / 4)));
    this.grid.position.set(centre.x, box.min.y, centre.z);
  }

  /** Whether all of a box is in the view. */
  isInView(box: Box3): boolean {
    return cornersOf(box).every((corner) => {
      const { x, y, z } = corner.project(this.camera);
      return Math.abs(x) <= 1 && Math.abs(y) <= 1 && z <= 1;
    });
  }

  /** Draw a character alone, as it is now, into a canvas at a place from the left; the view must be drawn again. */
  portrait(figure: Figure, [width, height]: readonly [number, number], canvas: HTMLCanvasElement, left: number): void {
    const ratio = this.renderer.getPixelRatio();
    const [wide, tall] = [Math.min(width, this.width), Math.min(height, this.height)];
    const camera = new PerspectiveCamera(35, width / height);
    aim(camera, figure.walkedBox(), FRONT, PORTRAIT_ROOM);
    const { background } = this.scene;
    this.scene.background = new Color(this.colours?.stage);
    const others = this.scene.children.filter((each) => each !== figure.group && each.visible && !("isLight" in each));
    for (const each of others) each.visible = false;
    this.renderer.setViewport(0, 0, wide, tall);
    this.renderer.setScissor(0, 0, wide, tall);
    this.renderer.setScissorTest(true);
    this.renderer.render(this.scene, camera);
    this.renderer.setScissorTest(false);
    this.renderer.setViewport(0, 0, this.width, this.height);
    for (const each of others) each.visible = true;
    this.scene.background = background;
    const { domElement } = this.renderer;
    canvas.getContext("2d")?.drawImage(domElement, 0, domElement.height - tall * ratio, wide * ratio, tall * ratio, left, 0, width, height);
  }

  /** Move the camera along the floor with a character that walks. */
  accompany({ x, z }: Vector3): void {
    if (this.orbit === null) return;
    for (const each of [this.camera.position, this.orbit.target]) {
      each.x += x;
      each.z += z;
    }
    this.orbit.update();
  }

  /** Where a point of a character's file is on the screen: x, y in pixels, and depth; null behind the camera. */
  project(figure: Figure, [x, y, z]: Vector): Vector | null {
    return this.onScreen(figure.group.localToWorld(new Vector3(x, y, z)));
  }

  /** Where a point of the view is on the screen: x, y in pixels, and depth; null behind the camera. */
  onScreen(of: Vector3): Vector | null {
    const point = of.clone().project(this.eye);
    return point.z > 1 ? null : [((point.x + 1) / 2) * this.width, ((1 - point.y) / 2) * this.height, point.z];
  }

  /** The ray through a position on the screen, in the view's coordinates. */
  through(x: number, y: number): Line {
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2((2 * x) / this.width - 1, 1 - (2 * y) / this.height), this.eye);
    return caster.ray;
  }

  /** The ray through a position on the screen, in the coordinates of a character's file. */
  ray(figure: Figure, x: number, y: number): Ray {
    const { origin: from, direction } = this.through(x, y);
    const far = figure.group.worldToLocal(from.clone().add(direction));
    const near = figure.group.worldToLocal(from.clone());
    const origin: Vector = [near.x, near.y, near.z];
    return { origin, direction: subtract([far.x, far.y, far.z], origin) };
  }

  /** The direction of the screen's right, up and depth, in the coordinates of a character's file. */
  axes(figure: Figure): { right: Vector; up: Vector; forward: Vector } {
    const turn = figure.group.quaternion.clone().invert().multiply(this.camera.quaternion);
    const of = (x: number, y: number, z: number): Vector => {
      const v = new Vector3(x, y, z).applyQuaternion(turn);
      return [v.x, v.y, v.z];
    };
    return { right: of(1, 0, 0), up: of(0, 1, 0), forward: of(0, 0, -1) };
  }
}

/** Move a camera in front of a box, looking from a direction, and return the point that it looks at. */
export function aim(camera: PerspectiveCamera, box: Box3, from: Vector3, room: number): Vector3 {
  const size = box.getSize(new Vector3());
  const centre = box.getCenter(new Vector3());
  const { aspect, fov } = camera;
  const across = Math.max(size.y, size.x / Math.max(aspect, 0.1), (0.7 * size.z) / aspect);
  const distance = (room * across) / Math.tan((fov * Math.PI) / 360) + 0.5 * Math.max(size.x, size.z);
  camera.position.copy(centre).add(from.clone().normalize().multiplyScalar(distance));
  camera.lookAt(centre);
  camera.near = distance / 100;
  camera.far = farOf(distance);
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
  return centre;
}

/** The distance to the farthest point that a camera sees; the picture of the place stays in sight. */
const farOf = (distance: number): number => Math.max(50 * distance, 2.5 * RADIUS);

function cornersOf({ min, max }: Box3): Vector3[] {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((i) => new Vector3(i & 1 ? min.x : max.x, i & 2 ? min.y : max.y, i & 4 ? min.z : max.z));
}

/** Whether images are drawn without a graphics card; smooth edges cost too much there. */
function isSoftware(): boolean {
  const gl = document.createElement("canvas").getContext("webgl2");
  const facts = gl?.getExtension("WEBGL_debug_renderer_info");
  if (gl == null || facts == null) return false;
  return /swiftshader|llvmpipe|software/i.test(String(gl.getParameter(facts.UNMASKED_RENDERER_WEBGL)));
}
