/** The two faces of the page, of which this browser remembers the last. */

import { remember, remembered } from "./storage";
import { type Face, update } from "./store";

const KEY = "puppetline.face";

export const rememberedFace = (): Face => (remembered(KEY) === "workshop" ? "workshop" : "film");

export function chooseFace(face: Face): void {
  remember(KEY, face);
  update({
    face,
    edited: face === "film" ? "film" : "puppet",
    drawer: null,
    selection: null,
    joint: null,
    channel: null,
    target: null,
    finding: null,
    clip: null,
    adding: false,
    choosing: false,
    looking: false,
    atRest: false,
    tool: "select",
    drawn: [],
  });
}
