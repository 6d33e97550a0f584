/** The film's scene: its place and light, music, titles, speech bubbles and shots, each a row of the scene file. */

import { type Node_, h } from "../dom";
import { chooseMedia } from "../files";
import { editScene, position } from "../film";
import type { FilmBubble, FilmCamera, FilmMusic, FilmTitle } from "../messages";
import { keyOf, withItem } from "../model/rows";
import { pictureOfSet, placeOf, titleOf } from "../model/scene";
import { type State, current } from "../store";
import { strings } from "../strings";
import { button, checkbox, entry, field, number, section, select, slider } from "./parts";

const SETS = Object.keys(strings.scene.sets);

/** Loudness of the music when none was chosen, in decibels. */
const MUSIC_GAIN = -14;

/** Loudness of the quietest music, in decibels. */
const QUIETEST = -40;

export function scene(state: State): Node_ {
  return h("div", { class: "stack", key: "scene" }, titles(state), place(state), music(state), shots(state), bubbles(state));
}

const now = (): number => Math.round(10 * position(current())) / 10;

function place({ film }: State): Node_ {
  const { scene: words } = strings;
  const { background, light } = film.present.scene;
  const chosen = placeOf(film.present.scene);
  return section(
    words.place,
    h(
      "div",
      { class: "tiles" },
      SETS.map((name) =>
        h(
          "button",
          {
            type: "button",
            class: "tile",
            "aria-pressed": String(pictureOfSet(name) === chosen),
            onclick: () => {
              editScene({ background: { set: name as NonNullable<typeof background.set> } });
            },
          },
          h("span", { class: "set", style: `background-image: url(${pictureOfSet(name)})` }),
          words.sets[name] ?? name,
        ),
      ),
    ),
    h(
      "div",
      { class: "row" },
      button(words.ownPicture, () => {
        chooseMedia("picture", (picture) => {
          editScene({ background: { picture } });
        });
      }, { pressed: background.picture != null }),
    ),
    field(
      words.light,
      select([["", words.lightOfPlace], ...Object.entries(words.moods)], light.mood ?? "", (mood) => {
        editScene({ light: { mood: mood === "" ? null : (mood as NonNullable<typeof light.mood>) } });
      }),
    ),
  );
}

function music({ film }: State): Node_ {
  const { scene: words } = strings;
  const { music: chosen } = film.present.scene;
  const change = (values: FilmMusic): void => {
    editScene({ music: values });
  };
  const none = chosen.loop == null && chosen.file == null;
  return section(
    words.music,
    h(
      "div",
      { class: "row" },
      button(words.noMusic, () => {
        change({});
      }, { pressed: none }),
      Object.entries(words.loops).map(([loop, title]) =>
        button(title, () => {
          change({ ...chosen, file: null, loop: loop as NonNullable<FilmMusic["loop"]> });
        }, { pressed: chosen.loop === loop }),
      ),
      button(words.ownMusic, () => {
        chooseMedia("sound", (file) => {
          change({ ...chosen, loop: null, file });
        });
      }, { pressed: chosen.file != null }),
    ),
    !none &&
      slider(words.loudness, chosen.gain ?? MUSIC_GAIN, { min: QUIETEST, max: 0, step: 1 }, (gain) => {
        change({ ...chosen, gain });
      }, undefined, words.percent(1 - (chosen.gain ?? MUSIC_GAIN) / QUIETEST)),
  );
}

function titles({ film }: State): Node_ {
  const { scene: words } = strings;
  const { title: rows, film: format } = film.present.scene;
  const change = (index: number, row: FilmTitle | null): void => {
    editScene({ title: withItem(rows, index, row) });
  };
  const black = (format.fade_in ?? 0) > 0 || (format.fade_out ?? 0) > 0;
  return section(
    words.titles,
    rows.map((row, i) =>
      item(words.title(i + 1), row, (next) => {
        change(i, next);
      }, [
        entry(words.title(i + 1), row.text, (text) => {
          change(i, text === "" ? null : { ...row, text });
        }),
        h(
          "div",
          { class: "pair" },
          field(words.where, select(Object.entries(words.places), row.place ?? "middle", (where) => {
            change(i, { ...row, place: where as NonNullable<FilmTitle["place"]> });
          })),
          field(words.letters, select(Object.entries(words.typefaces), row.font ?? "plain", (font) => {
            change(i, { ...row, font });
          })),
        ),
      ]),
    ),
    entry(rows.length === 0 ? words.firstTitle : words.newTitle, "", (text) => {
      if (text !== "") change(rows.length, { text, at: rows.length === 0 ? 0 : now(), place: "top" }); // above the faces
    }),
    checkbox(words.black, black, (on) => {
      editScene({ film: { ...format, fade_in: on ? 1 : 0, fade_out: on ? 1 : 0 } });
    }),
  );
}

function bubbles(state: State): Node_ {
  const { scene: words } = strings;
  const { bubble: rows } = state.film.present.scene;
  const who = state.character ?? "";
  const change = (index: number, row: FilmBubble | null): void => {
    editScene({ bubble: withItem(rows, index, row) });
  };
  return section(
    words.bubbles,
    rows.map((row, i) =>
      row.kind !== "name" &&
      item(words.bubble(name(state, row.character)), row, (next) => {
        change(i, next);
      }, [
        entry(words.bubble(name(state, row.character)), row.text ?? "", (text) => {
          change(i, text === "" ? null : { ...row, text });
        }),
        field(words.kind, select(Object.entries(words.kinds), row.kind ?? "speech", (kind) => {
          change(i, { ...row, kind: kind as NonNullable<FilmBubble["kind"]> });
        })),
      ]),
    ),
    who !== "" && entry(words.newBubble(name(state, who)), "", (text) => {
      if (text !== "") change(rows.length, { character: who, text, at: now() });
    }),
  );
}

function shots(state: State): Node_ {
  const { scene: words } = strings;
  const { camera: rows } = state.film.present.scene;
  const change = (index: number, row: FilmCamera | null): void => {
    editScene({ camera: withItem(rows, index, row) });
  };
  const names = (state.server?.characters ?? []).map((each) => [each.name, titleOf(each.name, each.title)] as const);
  return section(
    words.camera,
    rows.length === 0 && h("p", { class: "small" }, words.noShots),
    rows.map((row, i) =>
      item(words.shot(i + 1), row, (next) => {
        change(i, next);
      }, [
        h(
          "div",
          { class: "pair" },
          field(words.kind, select(Object.entries(words.shots), row.shot ?? "wide", (shot) => {
            change(i, { ...row, shot: shot as NonNullable<FilmCamera["shot"]> });
          })),
          field(words.shows, select([["", words.everybody], ...names], row.show?.[0] ?? "", (shown) => {
            change(i, { ...row, show: shown === "" ? [] : [shown] });
          })),
        ),
        i > 0 && checkbox(words.softly, (row.fade ?? 0) > 0, (on) => {
          change(i, { ...row, fade: on ? 0.5 : 0 });
        }),
      ]),
    ),
    button(words.addShot, () => {
      let at = rows.length === 0 ? 0 : now();
      while (rows.some((row) => (row.at ?? 0) === at)) at++; // a second after one that is there
      change(rows.length, { at, ...(at === 0 ? {} : { shot: "follow" as const, show: state.character === null ? [] : [state.character] }) });
    }),
  );
}

const name = ({ server }: State, character: string): string =>
  titleOf(character, server?.characters.find((each) => each.name === character)?.title ?? "");

/** A row with the second at which it begins and perhaps how long it is shown, and a button that deletes it. */
function item<T extends { readonly at?: number; readonly seconds?: number }>(title: string, row: T, change: (row: T | null) => void, controls: readonly (Node_ | false)[]): Node_ {
  const { scene: words } = strings;
  return h(
    "div",
    { class: "entry", role: "group", "aria-label": title, key: keyOf(row) },
    controls,
    h(
      "div",
      { class: "pair" },
      field(words.from, number(row.at ?? 0, (at) => {
        change({ ...row, at });
      }, { min: 0, step: 0.5 })),
      row.seconds !== undefined && field(words.long, number(row.seconds, (seconds) => {
        change({ ...row, seconds });
      }, { min: 0.5, step: 0.5 })),
    ),
    button(words.remove, () => {
      change(null);
    }, { quiet: true, label: `${words.remove}: ${title}` }),
  );
}
