/** Characters of a service, large, on a ground without an interface. */

import { Box3, Vector3 } from "three";

import type { Client } from "../../../../../integrations/web/puppetline.js";
import { Figure } from "../viewer/figure";
import { Stage } from "../viewer/stage";
import { reloadIfLost, reloadSoon } from "./awake";
import { fetched } from "./key";

/** Share of the picture's height that the tallest character fills, and of its width that all of them fill. */
const FILLED = 0.92;

/** Distance between characters, as a share of the mean of their widths. */
const GAP = 0.25;

/** Share of the way that the camera goes per second, to follow a character that walks. */
const FOLLOWING = 2;

/** Time between images while the machine makes a film without a graphics card, in milliseconds. */
const WORKING_MS = 1000;

export class Characters {
  private readonly stage: Stage;
  private readonly figures = new Map<string, Figure>();
  private readonly target = new Vector3();
  private size = new Vector3(1, 1, 1);
  private last = performance.now();
  /** Images drawn so far with every character. */
  images = 0;
  /** Whether the machine makes a film, so that fewer images are drawn without a graphics card. */
  working = false;

  constructor(
    parent: HTMLElement,
    private readonly client: Client,
    private readonly key: string,
    private readonly only: string | null,
    private readonly paced: boolean,
  ) {
    const canvas = document.createElement("canvas");
    parent.append(canvas);
    this.stage = stageOn(parent, canvas);
    reloadIfLost(canvas);
    new ResizeObserver(() => {
      this.stage.resize();
      this.frame();
    }).observe(parent);
    this.stage.resize();
    client.subscribe("service/characters", ({ body }) => {
      this.follow((body as { name: string }[]).map(({ name }) => name));
    });
    this.stage.animate(() => {
      this.draw();
    });
  }

  /** Whether every character's mesh has arrived. */
  private get complete(): boolean {
    return this.figures.size > 0 && [...this.figures.values()].every(({ mesh }) => mesh !== null);
  }

  /** Draw characters with the materials that are there. */
  dress(models: readonly string[]): void {
    for (const name of models) {
      this.figures.get(name)?.dress(name).catch(() => undefined);
    }
  }

  /** The number of the newest frame that is shown of each character. */
  get shown(): readonly (number | null)[] {
    return [...this.figures.values()].map(({ moment }) => moment?.later ?? null);
  }

  private follow(names: readonly string[]): void {
    const wanted = this.only === null ? names : names.filter((name) => name === this.only);
    for (const [name, figure] of this.figures) {
      if (wanted.includes(name)) continue;
      figure.dispose();
      this.figures.delete(name);
    }
    for (const name of wanted) {
      if (this.figures.has(name)) continue;
      const download = async (model: string) => (await fetched(`/screen/models/${model}.glb`, this.key)).blob();
      const figure = new Figure(this.client, name, download, () => {
        this.arrange();
      });
      this.figures.set(name, figure);
      this.stage.scene.add(figure.group);
    }
    this.arrange();
  }

  /** Put characters side by side, and the camera in front of all of them. */
  private arrange(): void {
    const shown = [...this.figures.values()].filter(({ mesh }) => mesh !== null);
    const boxes = shown.map((figure) => {
      figure.stand({});
      return boxOf(figure);
    });
    if (boxes.length === 0) return;
    const gap = (GAP * boxes.reduce((sum, { min, max }) => sum + max.x - min.x, 0)) / boxes.length;
    let right = 0;
    boxes.forEach(({ min, max }, k) => {
      shown[k]?.group.position.setX(right - min.x);
      right += max.x - min.x + gap;
    });
    const tallest = Math.max(...boxes.map(({ min, max }) => max.y - min.y));
    const deepest = Math.max(...boxes.map(({ min, max }) => max.z - min.z));
    this.size.set(right - gap, tallest, deepest);
    this.target.copy(this.middle());
    this.frame();
  }

  private middle(): Vector3 {
    const walked = [...this.figures.values()].map((figure) => figure.walked());
    const mean = walked.reduce((sum, each) => sum.add(each), new Vector3()).divideScalar(Math.max(walked.length, 1));
    return new Vector3(this.size.x / 2 + mean.x, this.size.y / 2, mean.z);
  }

  private frame(): void {
    const { camera } = this.stage;
    const across = Math.max(this.size.y * 1.1, this.size.x / Math.max(camera.aspect, 0.1));
    const distance = across / FILLED / 2 / Math.tan((camera.fov * Math.PI) / 360) + this.size.z / 2;
    camera.position.copy(this.target).add(new Vector3(0.12, 0.1, 1).normalize().multiplyScalar(distance));
    camera.lookAt(this.target);
    camera.near = distance / 100;
    camera.far = distance * 50;
    camera.updateProjectionMatrix();
  }

  private draw(): void {
    const now = performance.now();
    const seconds = (now - this.last) / 1000;
    this.last = now;
    for (const figure of this.figures.values()) figure.pose(false);
    this.target.lerp(this.middle(), 1 - Math.exp(-FOLLOWING * seconds));
    this.frame();
    this.stage.render();
    if (this.complete) this.images++;
    if (this.paced) this.stage.keepPace(this.working ? WORKING_MS : 0);
  }
}

/** The 3D scene; where the browser has no 3D now, as after its process for graphics has failed, load the page again. */
function stageOn(parent: HTMLElement, canvas: HTMLCanvasElement): Stage {
  try {
    return new Stage(parent, canvas, undefined, true);
  } catch (error) {
    reloadSoon();
    throw error;
  }
}

/** The box of a character at rest, in the picture's coordinates. */
function boxOf(figure: Figure): Box3 {
  const [low, high] = figure.bounds() ?? [[0, 0, 0], [1, 1, 1]];
  return new Box3(new Vector3(...low), new Vector3(...high)).applyMatrix4(figure.group.matrixWorld);
}
