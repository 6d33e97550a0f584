/** The film of the takes: edits, playing on the stage, the count-in, and making the video. */

import type { Extra, FilmReply, FilmState, FilmTake, ServerState, ShareReply } from "./messages";
import { EMPTY, type Film, endOf, filmOf, keepFilm } from "./model/film";
import { begin, commit, settle, type undo } from "./model/history";
import { download, request, tried } from "./requests";
import { context } from "./sound";
import { type State, current, update } from "./store";
import { strings } from "./strings";

/** Seconds before a take. */
export const COUNT_IN = 3;

let sending = false;

/**
 * What changes in the page's state with a state of the server: a take that was recorded is a step that can be undone.
 * When a character was removed, no step before that can be undone, as it would bring the character back.
 */
export function receivedFilm(state: State, server: ServerState): Partial<State> {
  const timed = JSON.stringify(state.server?.timeline) === JSON.stringify(server.timeline) ? state.timed : performance.now();
  const counted = state.count !== null || !hasBegun(server);
  const recordedFrom = server.recording === null && state.count === null ? null : (state.recordedFrom ?? (counted ? null : performance.now()));
  const [before, after] = [state.film.present, filmOf(server.film)];
  const removed = state.server?.characters.some(({ name }) => !server.characters.some((each) => each.name === name)) === true;
  const history = removed ? begin(before) : state.film;
  if (sending || JSON.stringify(before) === JSON.stringify(after)) return { timed, recordedFrom, film: history };
  keepFilm(before, after);
  const recorded = state.server !== null && !removed && JSON.stringify(before.takes) !== JSON.stringify(after.takes);
  return { timed, recordedFrom, film: recorded ? commit(history, after) : { ...history, present: after } };
}

/** Whether a take is being recorded whose count-in is over, perhaps one that another window has begun. */
const hasBegun = ({ recording, stages }: ServerState): boolean =>
  recording !== null && stages.some((stage) => stage.recording === recording && stage.count_in === 0);

/** Show an edited film immediately, and send it. */
export function editFilm(film: Film, change: Partial<State> = {}): void {
  update((state) => ({ film: commit(state.film, film), edited: "film", ...change }));
  void send();
}

/** Replace the film's takes. */
export function editTakes(takes: readonly FilmTake[], change: Partial<State> = {}): void {
  editFilm({ ...current().film.present, takes }, change);
}

/** Replace tables of the film's scene. */
export function editScene(tables: Partial<Film["scene"]>, change: Partial<State> = {}): void {
  const { present } = current().film;
  editFilm({ ...present, scene: { ...present.scene, ...tables } }, change);
}

export function stepFilm(move: typeof undo): void {
  update(({ film }) => ({ film: move<Film>(film) }));
  void send();
}

/** Send what differs from the server's film. Of the edits made while one is being applied, only the newest is sent next. */
async function send(): Promise<void> {
  if (sending) return;
  sending = true;
  for (let change = unsent(current()); change !== null; change = unsent(current())) {
    const sent = current().film.present;
    const reply = await request<FilmState>(strings.busy.film, "edit_film", change);
    update(({ film, server }) => {
      const has = reply ?? server?.film ?? EMPTY; // takes are in the order of their times; refused: as before
      const edited = film.present; // perhaps meanwhile
      keepFilm(sent, has);
      const present = { takes: edited.takes === sent.takes ? has.takes : edited.takes, scene: edited.scene === sent.scene ? has.scene : edited.scene };
      return { server: server && { ...server, film: { ...server.film, ...has } }, film: settle(film, present) };
    });
  }
  sending = false;
}

/** The parts of the film that differ from the server's; null if none does. */
function unsent({ film: { present }, server }: State): Partial<Film> | null {
  const parts = (["takes", "scene"] as const).filter((part) => JSON.stringify(present[part]) !== JSON.stringify(server?.film[part]));
  return parts.length === 0 ? null : Object.fromEntries(parts.map((part) => [part, present[part]]));
}

/** Play the film on the stage from the playhead on, or pause. */
export async function play(): Promise<void> {
  const { server, playhead, film } = current();
  const timeline = server?.timeline ?? null;
  if (server?.recording != null || film.present.takes.length === 0) return;
  if (timeline === null) await request(strings.busy.play, "play_film", { at: playhead });
  else await request(strings.busy.play, "pause", { on: !timeline.paused });
}

export async function stopPlaying(): Promise<void> {
  await request(strings.busy.play, "stop");
}

export async function seek(seconds: number): Promise<void> {
  update({ playhead: Math.max(0, seconds) });
  if (current().server?.timeline != null && current().server?.recording == null) {
    await request(strings.busy.play, "seek", { seconds: Math.max(0, seconds) });
  }
}

/** The second of the film that is shown now. */
export function position(state: State): number {
  const { server, timed, playhead } = state;
  const timeline = server?.timeline ?? null;
  if (timeline === null) return server?.recording == null ? playhead : recordingAt(state) + recordedSeconds(state);
  const passed = timeline.paused ? 0 : (performance.now() - timed) / 1000;
  return Math.min(timeline.position + timeline.speed * passed, timeline.end);
}

/** How long the take is that is being recorded, in seconds; 0 during the count-in. */
export const recordedSeconds = ({ recordedFrom }: State): number => recordedFrom === null ? 0 : (performance.now() - recordedFrom) / 1000;

/** The second of the film at which the take begins that is being recorded: after the last one of its character. */
export const recordingAt = ({ film, character }: State): number => endOf(film.present.takes.filter((take) => take.character === character));

/** Show 3, 2, 1 and the clapper, each with its sound. */
export async function countIn(seconds: number): Promise<void> {
  for (let left = seconds; left >= 0; left--) {
    update(left === 0 ? { count: left, recordedFrom: performance.now() } : { count: left });
    sound(left === 0);
    await new Promise((resolve) => setTimeout(resolve, left === 0 ? 700 : 1000));
    if (current().count !== left) return; // it was stopped
  }
  update({ count: null });
}

/** A beep, or the clap of the clapper. */
function sound(clap: boolean): void {
  const audio = context();
  const gain = new GainNode(audio, { gain: 0.3 });
  gain.connect(audio.destination);
  gain.gain.setTargetAtTime(0, audio.currentTime, clap ? 0.02 : 0.06);
  const buffer = new AudioBuffer({ length: audio.sampleRate / 4, sampleRate: audio.sampleRate });
  const samples = buffer.getChannelData(0);
  for (let i = 0; i < samples.length; i++) samples[i] = clap ? 2 * Math.random() - 1 : Math.sin((2 * Math.PI * 660 * i) / audio.sampleRate);
  const source = new AudioBufferSourceNode(audio, { buffer });
  source.connect(gain);
  source.start();
}

/** Record the microphone's sound with takes, or not. */
export async function switchMicrophone(): Promise<void> {
  const { server } = current();
  if (server?.microphone === false && !server.installed.includes("sound")) ask("sound", switchMicrophone);
  else await request(strings.busy.microphone, "microphone", { on: server?.microphone !== true });
}

/** Make the film, and show it. */
export async function makeFilm(): Promise<void> {
  if (current().server?.installed.includes("film") === false) {
    ask("film", makeFilm);
    return;
  }
  const made = await request<FilmReply>(strings.busy.make, "make_film");
  if (made === null) return;
  const blob = await download(made.file);
  closeFilm();
  update({ made: { ...made, url: URL.createObjectURL(new Blob([blob], { type: "video/mp4" })), shared: null } });
}

/** Let phones open the film that was made. */
export async function shareFilm(): Promise<void> {
  const { made } = current();
  if (made === null) return;
  const shared = await request<ShareReply>(strings.busy.share, "share_film", { file: made.file });
  update(({ made: shown }) => (shown?.file === made.file ? { made: { ...shown, shared } } : {}));
}

export function closeFilm(): void {
  const { made } = current();
  if (made !== null) URL.revokeObjectURL(made.url);
  update({ made: null });
}

let whenInstalled = (): Promise<void> => Promise.resolve();

/** Ask whether to install what something needs, which is done then. */
export function ask(extra: Extra, then: () => Promise<void>): void {
  whenInstalled = then;
  update({ asking: extra });
}

/** Install what was asked for, and do what needs it. */
export async function install(extra: Extra): Promise<void> {
  update({ asking: null });
  if ((await request(strings.busy.install, "install", { extra })) !== null) await whenInstalled();
}

const pictures = new Map<string, string>();

/** The address of a picture of the server; empty until it has been loaded. */
export function pictureOf(id: string): string {
  const known = pictures.get(id);
  if (known !== undefined || id === "") return known ?? "";
  pictures.set(id, "");
  void tried(() => download(id)).then(
    (blob) => {
      pictures.set(id, URL.createObjectURL(blob));
      update({});
    },
    () => undefined, // the page does without it
  );
  return "";
}
