/** The two faces of the page, of which this browser remembers the last. */

import { type Face, update } from "./store";

const KEY = "puppetline.face";

export const rememberedFace = (): Face => (localStorage.getItem(KEY) === "workshop" ? "workshop" : "film");

export function chooseFace(face: Face): void {
  localStorage.setItem(KEY, face);
  update({ face, drawer: null, selection: null, adding: false, atRest: false, tool: "select", drawn: [], ...(face === "film" ? { edited: "film" as const, choosing: false } : {}) });
}
