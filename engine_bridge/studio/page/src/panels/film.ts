/** What covers the page: the count-in, the film that was made, and the question before something is installed. */

import { offer } from "../actions";
import { type Child, type Node_, h } from "../dom";
import { closeFilm, install, shareFilm } from "../film";
import { type State, update } from "../store";
import { strings } from "../strings";
import { button } from "./parts";

export function covers(state: State): Child {
  return [count(state), made(state), asked(state), help(state)];
}

function count({ count: left }: State): Child {
  if (left === null) return null;
  const words = left === 0 ? strings.film.action : String(left);
  return h("div", { class: "count", role: "status", key: "count" }, left === 0 && h("span", { class: "clapper", "aria-hidden": "true" }), h("span", { key: words }, words));
}

function made(state: State): Child {
  const { made: film } = state;
  const { film: words } = strings;
  if (film === null) return null;
  return dialog(
    words.yours,
    h("video", { src: film.url, controls: true, autoplay: true, playsinline: true, key: film.url }),
    film.notes.length > 0 && h("details", {}, h("summary", {}, strings.details), h("ul", {}, film.notes.map((note) => h("li", { class: "small" }, note)))),
    h(
      "div",
      { class: "row" },
      button(words.download, () => {
        void offer(film.file, film.name);
      }, { primary: true }),
      film.shared === null
        ? button(words.share, () => {
            void shareFilm();
          }, { disabled: state.busy.includes(strings.busy.share) })
        : button(words.poster, () => {
            if (film.shared !== null) void offer(film.shared.poster, film.shared.poster_name);
          }),
      button(words.close, closeFilm),
    ),
    film.shared !== null && h(
      "div",
      { class: "shared", role: "status", key: "shared" },
      h("img", { src: `data:image/svg+xml;base64,${film.shared.code}`, alt: words.qrCode }),
      h("p", {}, words.shared, h("a", { href: film.shared.address, target: "_blank", rel: "noopener" }, film.shared.address)),
    ),
  );
}

function asked({ asking }: State): Child {
  const { install: words } = strings;
  if (asking === null) return null;
  return dialog(
    words.title[asking],
    h("p", {}, words.text[asking]),
    h(
      "div",
      { class: "row" },
      button(words.yes, () => {
        void install(asking);
      }, { primary: true }),
      button(words.no, () => {
        update({ asking: null });
      }),
    ),
  );
}

/** The keys of the page. */
function help({ help: open }: State): Child {
  const { keys: words } = strings;
  if (!open) return null;
  return dialog(
    words.title,
    h("dl", { class: "keys" }, words.list.map(([key, what]) => [h("dt", {}, h("kbd", {}, key)), h("dd", {}, what)])),
    button(strings.film.close, () => {
      update({ help: false });
    }),
  );
}

function dialog(title: string, ...children: readonly Child[]): Node_ {
  return h("dialog", { class: "dialog stack", modal: true, "aria-label": title, key: title }, h("h2", {}, title), children);
}
