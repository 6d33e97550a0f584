/** The strip of takes along the bottom: record, play, and cut the film. */

import { record, show } from "../actions";
import { type Child, type Node_, h } from "../dom";
import { editTakes, makeFilm, pictureOf, play, recordedSeconds, recordingAt, seek, stopPlaying, switchMicrophone } from "../film";
import type { FilmTake, ServerState } from "../messages";
import { beginOf, endOf, move, mute, nameOf, remove, secondsOf, takeOf, trimStart, trimStop } from "../model/film";
import { keyOf } from "../model/rows";
import { titleOf } from "../model/scene";
import { type State, current, isJoined, update } from "../store";
import { strings } from "../strings";
import { button } from "./parts";
import { clock } from "./recording";

/** Shortest film that the strip has room for, in seconds. */
const SHORTEST_STRIP = 12;

export function strip(state: State): Node_ {
  const { film: words } = strings;
  const { server, film, clip } = state;
  const { takes } = film.present;
  const joined = isJoined(state);
  const busy = server?.recording != null || state.count !== null;
  const paused = server?.timeline == null || server.timeline.paused;
  return h(
    "section",
    { class: "strip", "aria-label": words.title, key: "strip" },
    h(
      "div",
      { class: "row" },
      recordButton(state),
      !joined && [
        button(words.microphone, () => {
          void switchMicrophone();
        }, { pressed: server?.microphone === true, disabled: busy, hint: words.microphoneHint, name: "microphone" }),
        button(paused ? words.play : words.pause, () => {
          void play();
        }, { disabled: takes.length === 0 || busy, hint: words.playHint, name: paused ? "play" : "pause" }),
        server?.timeline != null && server.recording === null && button(words.stop, () => {
          void stopPlaying();
        }, { quiet: true, key: "stop-playing" }),
        chosen(takes, takeOf(takes, clip)),
        h("span", { class: "space" }),
        h("span", { class: "time", raw: true }),
        button(words.make, () => {
          void makeFilm();
        }, { primary: true, disabled: busy || takes.every((take) => take.mute) || state.busy.includes(strings.busy.make), name: "make" }),
      ],
    ),
    !joined && server !== null && (takes.length === 0 && server.film.problem === "" && !busy ? h("p", { class: "small" }, words.none) : lanes(state, server)),
    server !== null && server.film.problem !== "" && h("p", { class: "small", role: "alert" }, server.film.problem),
  );
}

function recordButton({ server, connected, character, count }: State): Node_ {
  const { film: words } = strings;
  const open = connected === "open";
  if ((server?.recording ?? null) !== null || count !== null) {
    return button(words.stopRecording, () => {
      void record(false);
    }, { primary: true, danger: true, disabled: !open, key: "stop", name: "stop" });
  }
  const nobody = server?.source.kind === "none" || character === null;
  return button(words.record, () => {
    void record(true);
  }, { danger: true, disabled: !open || nobody, key: "record", hint: words.recordHint, name: "record" });
}

function chosen(takes: readonly FilmTake[], take: FilmTake | undefined): Child {
  const { film: words } = strings;
  if (take === undefined) return null;
  return [
    button(take.mute ? words.unmute : words.mute, () => {
      editTakes(mute(takes, keyOf(take)));
    }, { key: "mute" }),
    button(words.remove, () => {
      editTakes(remove(takes, keyOf(take)), { clip: null });
    }, { key: "remove" }),
  ];
}

/** Seconds that the strip shows; a take that is being recorded grows in it. */
const widthOf = (state: State): number =>
  Math.max(SHORTEST_STRIP, endOf(state.film.present.takes) + 2, state.server?.recording == null ? 0 : recordingAt(state) + recordedSeconds(state) + 2);

function lanes(state: State, server: ServerState): Node_ {
  const { film: words } = strings;
  const { takes } = state.film.present;
  const named = (name: string): string => titleOf(name, server.characters.find((each) => each.name === name)?.title ?? "");
  const names = [...new Set([...server.characters.map(({ name }) => name), ...takes.map(({ character }) => character)])];
  return h(
    "div",
    { class: "lanes" },
    names.map((name) =>
      h(
        "div",
        { class: "lane", key: name },
        button(named(name), () => {
          show(name);
        }, { pressed: name === state.character, disabled: !server.characters.some((each) => each.name === name) }),
        h(
          "div",
          {
            class: "track",
            "data-character": name,
            onpointerdown: (event: PointerEvent) => {
              const box = (event.currentTarget as Element).getBoundingClientRect();
              if (event.target === event.currentTarget) update({ clip: null });
              if (event.target === event.currentTarget) void seek(((event.clientX - box.left) / box.width) * widthOf(current()));
            },
          },
          takes.map((take) => take.character === name && clip(state, server, take, named(name))),
          server.recording !== null && name === state.character && h("div", { class: "clip growing", raw: true, key: "growing" }),
          !takes.some((take) => take.character === name) && !(server.recording !== null && name === state.character) &&
            h("p", { class: "small without", key: "without" }, words.without(named(name))),
        ),
      ),
    ),
    h("div", { class: "playhead", "aria-hidden": "true", raw: true }),
  );
}

function clip(state: State, server: ServerState, take: FilmTake, character: string): Node_ {
  const { film: words } = strings;
  const key = keyOf(take);
  const recorded = server.takes.find(({ name }) => name === nameOf(take));
  const width = widthOf(state);
  const percent = (seconds: number): string => `${(100 * seconds) / width}%`;
  const picture = pictureOf(recorded?.picture ?? "");
  const wave = pictureOf(recorded?.wave ?? "");
  const whole = recorded?.seconds ?? secondsOf(take);
  const title = words.take(nameOf(take), secondsOf(take));
  return h(
    "div",
    { class: `clip ${take.mute ? "mute" : ""}`, style: `left: ${percent(beginOf(take))}; width: ${percent(secondsOf(take))}`, key },
    wave !== "" && h("span", { class: "wave", style: waveStyle(wave, take, whole), key: "wave" }),
    h(
      "button",
      {
        type: "button",
        class: "clip-button",
        "aria-pressed": String(state.clip === key),
        "aria-label": words.clip(title, character, beginOf(take), take.mute),
        title,
        onclick: () => {
          update({ clip: key });
        },
        onkeydown: (event: KeyboardEvent) => {
          takeKeys(event, key);
        },
        onpointerdown: drag(key, (takes, by, character) => move(takes, key, by, character)),
      },
      picture !== "" && h("span", { class: "moving", style: `background-image: url(${picture})`, key: "picture" }),
      h("span", { class: "name" }, title),
    ),
    h("span", { class: "edge start", title: words.trim, onpointerdown: drag(key, (takes, by) => trimStart(takes, key, by)) }),
    h("span", { class: "edge end", title: words.trim, onpointerdown: drag(key, (takes, by) => trimStop(takes, key, by, whole)) }),
  );
}

/** The part of the wave form that is heard. */
function waveStyle(url: string, { start }: FilmTake, whole: number): string {
  const shown = (seconds: number): string => `${(100 * seconds) / whole}%`;
  return `--wave: url(${url}); --whole: ${shown(whole)}; --start: ${shown(start)}`;
}

/** Move a take or its edge with the arrow keys by a tenth of a second, and delete it. */
export function takeKeys(event: KeyboardEvent, key: string): void {
  const { takes } = current().film.present;
  const by = event.key === "ArrowRight" ? 0.1 : event.key === "ArrowLeft" ? -0.1 : 0;
  if (by !== 0) editTakes(move(takes, key, by));
  else if (event.key === "Delete" || event.key === "Backspace") editTakes(remove(takes, key), { clip: null });
  else return;
  event.preventDefault();
  event.stopPropagation();
}

/** Drag a take or its edge with a pointer: `edit` returns the takes after a drag by some seconds over a character's track. */
function drag(key: string, edit: (takes: readonly FilmTake[], by: number, character?: string) => readonly FilmTake[]): (event: PointerEvent) => void {
  return (down) => {
    const target = down.currentTarget as HTMLElement;
    const track = target.closest(".track");
    if (track === null || !down.isPrimary) return;
    const clipElement = target.closest<HTMLElement>(".clip");
    const scale = widthOf(current()) / track.getBoundingClientRect().width;
    target.setPointerCapture(down.pointerId);
    let takes: readonly FilmTake[] | null = null;
    target.onpointermove = (event) => {
      const by = event.clientX - down.clientX;
      if (takes === null && Math.abs(by) < 4 && Math.abs(event.clientY - down.clientY) < 8) return;
      const over = document.elementsFromPoint(event.clientX, event.clientY).find((each) => each.matches(".track"));
      takes = edit(current().film.present.takes, by * scale, over?.getAttribute("data-character") ?? undefined);
      if (clipElement !== null) preview(clipElement, takeOf(takes, key), event.clientY - down.clientY);
    };
    target.onpointerup = target.onpointercancel = (event) => {
      target.onpointermove = target.onpointerup = target.onpointercancel = null;
      if (takes !== null && event.type === "pointerup") editTakes(takes);
      else update({});
      if (clipElement !== null) clipElement.style.translate = "";
    };
  };
}

/** Show a dragged take where it would be. */
function preview(element: HTMLElement, take: FilmTake | undefined, down: number): void {
  if (take === undefined) return;
  const own = element.parentElement?.getAttribute("data-character");
  const width = widthOf(current());
  element.style.left = `${(100 * beginOf(take)) / width}%`;
  element.style.width = `${(100 * secondsOf(take)) / width}%`;
  element.style.translate = take.character === own ? "" : `0 ${down}px`;
}

/** Place what changes in every image: the playhead, the time, and the take that is being recorded. */
export function movePlayhead(state: State, seconds: number): void {
  const width = widthOf(state);
  const head = document.querySelector<HTMLElement>(".playhead");
  if (head !== null) head.style.setProperty("--at", String(Math.min(seconds / width, 1)));
  const growing = document.querySelector<HTMLElement>(".growing");
  if (growing !== null) {
    growing.style.left = `${(100 * recordingAt(state)) / width}%`;
    growing.style.width = `${(100 * recordedSeconds(state)) / width}%`;
  }
  const recorded = document.querySelector(".recorded");
  if (recorded !== null) recorded.textContent = clock(recordedSeconds(state));
  const time = document.querySelector(".strip .time");
  const text = `${seconds.toFixed(1)} s`;
  if (time !== null && time.textContent !== text) time.textContent = text;
}
