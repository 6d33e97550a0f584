/** The film in the 3D view while it plays: characters stand where its plan says, and are seen through its cameras. */

import type { FilmPlan, Moment } from "../messages";
import type { Figure } from "./figure";
import type { Stage } from "./stage";

export class PlayingFilm {
  private moment: Moment | null = null;
  private size: FilmPlan["size"] = [1, 1];

  constructor(
    private readonly stage: Stage,
    /** A canvas over the view, for the shot that goes during a cross-fade. */
    private readonly overlay: HTMLCanvasElement,
  ) {}

  get isShown(): boolean {
    return this.moment !== null;
  }

  /** Show a moment, or with null end the film; return whether anything changes. */
  show(moment: Moment | null, size = this.size): boolean {
    if (moment === null && this.moment === null) return false;
    [this.moment, this.size] = [moment, size];
    if (moment === null) this.stage.film(null);
    return true;
  }

  /** Let characters stand at their places. */
  place(figures: ReadonlyMap<string, Figure>): void {
    for (const [name, place] of Object.entries(this.moment?.places ?? {})) figures.get(name)?.place(place);
  }

  draw(): void {
    const context = this.overlay.getContext("2d");
    const views = this.moment?.views ?? [];
    const [width, height] = this.size;
    context?.clearRect(0, 0, this.overlay.width, this.overlay.height);
    views.forEach((view, i) => {
      this.stage.film(view, width / height);
      this.stage.render();
      if (i < views.length - 1 && context !== null) this.stage.copyTo(context, view.share);
    });
  }
}
