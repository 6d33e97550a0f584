/** Starts the page, or shows why it cannot start. */

import { draw, h } from "./dom";
import { strings } from "./strings";

if (document.createElement("canvas").getContext("webgl2") === null) {
  const words = strings.noGraphics;
  draw(document.body, [
    h("main", { class: "empty" }, h("div", { class: "welcome", role: "alert" }, h("h1", {}, words.title), h("p", {}, words.text))),
  ]);
} else await import("./main");
