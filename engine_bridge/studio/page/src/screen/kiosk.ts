/** What the visitors' screen says over the character: one instruction at a time, as a picture and a few words. */

import { type Child, type Node_, h } from "../dom";
import type { KioskScreen } from "../messages";
import type { Phase } from "./phase";
import * as pictures from "./pictures";
import { TEXTS, type Texts } from "./texts";

export interface Shown {
  readonly phase: Phase;
  /** Code of the newest film, which a corner shows. */
  readonly film: string | null;
  /** Whether a film is being made. */
  readonly making: boolean;
  /** Time for which a recording has lasted, in seconds. */
  readonly recorded: number;
  /** Whether the service answers. */
  readonly connected: boolean;
}

export function kiosk(settings: KioskScreen, shown: Shown): readonly Child[] {
  const { phase } = shown;
  return [
    brand(settings),
    phase.kind === "attract" && settings.files.includes("film") && sample(),
    phase.kind === "recording" && h("div", { class: "frame", key: "frame" }),
    phase.kind === "film" ? film(settings, phase.code) : h("main", { class: phase.kind, key: "main" }, instruction(settings, shown)),
    phase.kind !== "film" && shown.film !== null && corner(settings, shown.film),
    (!shown.connected || (shown.making && phase.kind !== "making")) && h("div", { class: "waiting", key: "waiting" }, pictures.making()),
  ];
}

function brand({ title, files }: KioskScreen): Child {
  return h(
    "header",
    { key: "brand" },
    files.includes("logo") && h("img", { src: "/screen/files/logo", alt: "" }),
    title !== "" && h("h1", {}, title),
  );
}

const sample = (): Node_ =>
  h("video", { class: "sample", key: "sample", src: "/screen/files/film", autoplay: true, loop: true, muted: true, playsinline: true });

function instruction(settings: KioskScreen, { phase, recorded }: Shown): Child {
  switch (phase.kind) {
    case "attract":
      return [pictures.invite(), words(settings, "invite")];
    case "stand":
      return [pictures.stand(), words(settings, "stand")];
    case "raise":
      return [pictures.raise(), words(settings, "raise_hands")];
    case "count":
      return [h("div", { class: "number", key: `${phase.seconds}` }, `${phase.seconds}`), words(settings, "count")];
    case "recording":
      return [
        pictures.recording(),
        h(
          "div",
          { class: "said", key: "recorded" },
          words(settings, "recording"),
          h("div", { class: "time", style: `--share: ${Math.min(1, recorded / settings.longest)}` }, clock(recorded)),
        ),
      ];
    default:
      return [pictures.making(), words(settings, "making")];
  }
}

function film(settings: KioskScreen, code: string): Node_ {
  const { phones } = settings;
  return h(
    "main",
    { class: "film", key: `film-${code}` },
    h("video", { src: `/${code}.mp4`, poster: `/${code}.jpg`, autoplay: true, loop: true, muted: true, playsinline: true }),
    h(
      "div",
      { class: "take" },
      words(settings, "film"),
      phones !== null && [
        h("img", { class: "code", src: `/screen/codes/${code}.svg`, alt: code }),
        h("p", { class: "address" }, phones.replace(/^https?:\/\//, ""), h("b", {}, code)),
        words(settings, "minutes"),
      ],
    ),
  );
}

/** The last visitor's film, while the next visitor plays. */
function corner({ phones }: KioskScreen, code: string): Child {
  if (phones === null) return false;
  return h(
    "aside",
    { key: `corner-${code}` },
    h("img", { class: "poster", src: `/${code}.jpg`, alt: "" }),
    h("img", { class: "code", src: `/screen/codes/${code}.svg`, alt: code }),
  );
}

function words({ languages, texts, minutes }: KioskScreen, key: keyof Texts): Node_ {
  const lines = languages.map((language, k) => {
    const own: Partial<Texts> = texts[language] ?? {};
    const text = own[key] ?? TEXTS[language]?.[key] ?? "";
    return h("p", { lang: language, class: k === 0 ? "first" : "" }, text.replace("{n}", `${Math.round(minutes)}`));
  });
  return h("div", { class: `words ${key}`, key }, ...lines);
}

const clock = (seconds: number): string =>
  `${Math.floor(seconds / 60)}:${String(Math.floor(seconds) % 60).padStart(2, "0")}`;
