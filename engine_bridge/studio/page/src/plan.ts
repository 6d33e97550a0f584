/** Keeps the plan of the film, which the server makes anew after every change of the film. */

import { position } from "./film";
import type { FilmPlan, Moment } from "./messages";
import { momentAt } from "./model/plan";
import { connection } from "./requests";
import { type State, current, isJoined, update } from "./store";

let asking = false;

/** What the plan depends on; empty while there is nothing to plan. */
function subjectOf({ server, greeting, face }: State): string {
  if (server === null || greeting?.joined !== false || face !== "film" || server.recording !== null) return "";
  const { takes, scene } = server.film;
  if (takes.every(({ mute }) => mute)) return "";
  return JSON.stringify([takes, { ...scene, music: null, sound: null, light: null, background: null }, server.characters.map(({ name, version, model }) => [name, version, model])]);
}

/** Ask for the plan if what it depends on has changed; of changes meanwhile, only the newest is asked for. */
export async function planFilm(): Promise<void> {
  if (asking) return;
  asking = true;
  for (let of = subjectOf(current()); of !== "" && of !== current().plan?.of; of = subjectOf(current())) {
    const film = await connection.request<FilmPlan>("plan_film").catch(() => null); // making the film says why
    update({ plan: { of, film } });
  }
  asking = false;
}

/** What the film shows now, while it plays in the page. */
export function shownMoment(state: State): Moment | null {
  const { server, face, plan } = state;
  if (isJoined(state) || face !== "film" || server?.timeline == null || server.recording !== null || plan?.film == null) return null;
  return momentAt(plan.film, position(state));
}
