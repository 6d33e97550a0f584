/** The film of the takes: edits, playing on the stage, the count-in, and making the video. */

import type { Extra, FilmReply, FilmState, FilmTake, ServerState } from "./messages";
import { type History, commit, type undo } from "./model/history";
import { download, request } from "./requests";
import { context } from "./sound";
import { type State, current, update } from "./store";
import { strings } from "./strings";

/** Seconds before a take. */
export const COUNT_IN = 3;

let sending = 0;

/** What changes in the page's state with a state of the server: a take that was recorded is a step that can be undone. */
export function receivedFilm(state: State, server: ServerState): Partial<State> {
  const timed = JSON.stringify(state.server?.timeline) === JSON.stringify(server.timeline) ? state.timed : performance.now();
  const same = JSON.stringify(state.film.present) === JSON.stringify(server.film.takes);
  if (same || sending > 0) return { timed };
  const first = state.server === null;
  const film = first ? { ...state.film, present: server.film.takes } : commit(state.film, server.film.takes);
  return { timed, film, clip: null };
}

/** Show edited takes immediately, and send them. */
export function editFilm(takes: readonly FilmTake[], change: Partial<State> = {}): void {
  update((state) => ({ film: commit(state.film, takes), edited: "film", ...change }));
  void send();
}

export function stepFilm(move: typeof undo): void {
  update(({ film }) => ({ film: move<readonly FilmTake[]>(film), clip: null }));
  void send();
}

async function send(): Promise<void> {
  sending++;
  const sent: History<readonly FilmTake[]> = current().film;
  const reply = await request<FilmState>(strings.busy.film, "edit_film", { takes: sent.present });
  sending--;
  update(({ film, server, clip }) => {
    if (reply !== null && film.present !== sent.present) return {}; // edited meanwhile
    const present = reply?.takes ?? server?.film.takes ?? []; // as the server has it: in the order of their times
    const moved = present.some(({ file }, i) => file !== sent.present[i]?.file);
    return { film: { ...film, present }, clip: moved ? null : clip };
  });
}

/** Play the film on the stage from the playhead on, or pause. */
export async function play(): Promise<void> {
  const { server, playhead } = current();
  const timeline = server?.timeline ?? null;
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
export function position({ server, timed, playhead }: State): number {
  const timeline = server?.timeline ?? null;
  if (timeline === null) return playhead;
  const passed = timeline.paused ? 0 : (performance.now() - timed) / 1000;
  return Math.min(timeline.position + timeline.speed * passed, timeline.end);
}

/** Show 3, 2, 1 and the clapper, each with its sound. */
export async function countIn(seconds: number): Promise<void> {
  for (let left = seconds; left >= 0; left--) {
    update({ count: left });
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
  if (server?.microphone === false && !server.installed.includes("sound")) update({ asking: "sound" });
  else await request(strings.busy.microphone, "microphone", { on: server?.microphone !== true });
}

/** Make the film, and show it. */
export async function makeFilm(): Promise<void> {
  if (current().server?.installed.includes("film") === false) {
    update({ asking: "film" });
    return;
  }
  const made = await request<FilmReply>(strings.busy.make, "make_film");
  if (made === null) return;
  const blob = await download(made.file);
  closeFilm();
  update({ made: { ...made, url: URL.createObjectURL(new Blob([blob], { type: "video/mp4" })) } });
}

export function closeFilm(): void {
  const { made } = current();
  if (made !== null) URL.revokeObjectURL(made.url);
  update({ made: null });
}

/** Install what was asked for, and return whether that has worked. */
export async function install(extra: Extra): Promise<boolean> {
  update({ asking: null });
  return (await request(strings.busy.install, "install", { extra })) !== null;
}

const pictures = new Map<string, string>();

/** The address of a picture of the server; empty until it has been loaded. */
export function pictureOf(id: string): string {
  const known = pictures.get(id);
  if (known !== undefined || id === "") return known ?? "";
  pictures.set(id, "");
  void download(id).then(
    (blob) => {
      pictures.set(id, URL.createObjectURL(blob));
      update({});
    },
    () => pictures.delete(id),
  );
  return "";
}
