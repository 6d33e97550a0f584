/** Moving pictures of characters: eight images of each, side by side, taken while it performs. */

import type { Figure } from "./figure";
import type { Stage } from "./stage";

const IMAGES = 8;

/** Width and height of an image, in pixels. */
const SIZE = [128, 112] as const;

/** Time from one image to the next, in milliseconds. */
const INTERVAL_MS = 250;

/** Time after a character has been drawn anew until its first image, in milliseconds: its materials arrive, and it eases into its motion. */
const DELAY_MS = 1500;

interface Portrait {
  readonly mesh: Figure["mesh"];
  readonly canvas: HTMLCanvasElement;
  images: number;
  due: number;
}

export class Portraits {
  private readonly portraits = new Map<string, Portrait>();

  constructor(
    private readonly stage: Stage,
    private readonly drawn: (name: string, picture: string) => void,
  ) {}

  /** Take the images that are due; return whether something was drawn over the view, which is then drawn again. */
  take(figures: ReadonlyMap<string, Figure>): boolean {
    const now = performance.now();
    let any = false;
    for (const [name, figure] of figures) {
      let portrait = this.portraits.get(name);
      if (portrait?.mesh !== figure.mesh) {
        const canvas = document.createElement("canvas");
        [canvas.width, canvas.height] = [IMAGES * SIZE[0], SIZE[1]];
        portrait = { mesh: figure.mesh, canvas, images: 0, due: now + DELAY_MS };
        this.portraits.set(name, portrait);
      }
      if (figure.mesh === null || portrait.images === IMAGES || now < portrait.due) continue;
      portrait.due = now + INTERVAL_MS;
      this.stage.portrait(figure, SIZE, portrait.canvas, portrait.images * SIZE[0]);
      any = true;
      if (++portrait.images === IMAGES) this.drawn(name, portrait.canvas.toDataURL("image/webp", 0.8));
    }
    for (const name of this.portraits.keys()) if (!figures.has(name)) this.portraits.delete(name);
    return any;
  }
}
