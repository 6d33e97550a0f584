/** What the user can do: each action asks the server, changes the state, or both. */

import type {
  Banner,
  CharacterState,
  ExportReply,
  LookReply,
  PuppetReply,
  ServerState,
  SmoothingReply,
  Sources,
} from "./messages";
import { begin, commit, redo as later, undo as earlier } from "./model/history";
import { type Sample, held, movedByChannel, withChannel, withMorph, withRange } from "./model/channels";
import { type Part, type Puppet, type Smoothing, follow, has, mirror, remove, symmetryPoint } from "./model/puppet";
import type { Joint } from "./model/skeleton";
import { smoothingOf } from "./model/smoothing";
import type { Vector } from "./model/vector";
import { strings } from "./strings";
import { COUNT_IN, ask, countIn, receivedFilm, stepFilm } from "./film";
import { connection, doing, download, request } from "./requests";
import { type Recording, current, shownCharacter, shownPuppet, update } from "./store";

export const connect = (): void => {
  connection.open({
    opened: (greeting) => {
      update({ connected: "open", greeting, ...(greeting.joined ? { face: "workshop" as const } : {}) });
    },
    state: receive,
    progress: (job, text, fraction) => {
      update(({ progress, since }) => ({
        progress: { ...progress, [job]: { text, fraction } },
        since: progress[job]?.text === text ? since : { ...since, [job]: performance.now() }, // the share is that of a step
      }));
    },
    lost: () => {
      update({ connected: "lost", busy: [] });
    },
    refused: (refusal) => {
      update({ connected: "refused", refusal });
    },
  });
};

function receive(server: ServerState): void {
  const names = server.characters.map(({ name }) => name);
  update((state) => {
    const character = state.character !== null && names.includes(state.character) ? state.character : (names.at(-1) ?? null);
    return {
      server,
      character,
      puppets: Object.fromEntries(Object.entries(state.puppets).filter(([name]) => names.includes(name))),
      ...(character === state.character ? {} : { selection: null }),
      since: { ...Object.fromEntries(server.jobs.map(({ job }) => [job, performance.now()])), ...state.since },
      ...receivedFilm(state, server),
    };
  });
  for (const each of server.characters) void refresh(each);
}

const fetched = new Map<string, string>();

/** Fetch a puppet that has changed, here or in another window. */
async function refresh({ name, version }: CharacterState): Promise<void> {
  if (fetched.get(name) === version || editing.has(name)) return;
  fetched.set(name, version);
  try {
    const { puppet, plan } = await connection.request<PuppetReply>("puppet", { character: name });
    update(({ plans }) => ({ plans: { ...plans, [name]: plan } }));
    const known = current().puppets[name];
    if (editing.has(name) || JSON.stringify(known?.present) === JSON.stringify(puppet)) return;
    update(({ puppets }) => ({
      puppets: { ...puppets, [name]: known === undefined ? begin(puppet) : commit(known, puppet) },
    }));
  } catch {
    fetched.delete(name); // the next state asks again
  }
}

// ---------------------------------------------------------------------------------------------------- characters

export function show(character: string): void {
  update({ character, selection: null, adding: false });
}

export async function closeCharacter(character: string): Promise<void> {
  await request(strings.busy.close, "close_character", { character });
}

// ---------------------------------------------------------------------------------------------------- performers

export async function chooseSource(): Promise<void> {
  update({ choosing: true });
  update({ sources: await connection.request<Sources>("sources").catch(() => null) });
}

export async function lookAgain(): Promise<void> {
  update({ sources: null });
  await chooseSource();
}

export async function performLive(uri: string): Promise<void> {
  await request(strings.busy.source, "source", { uri });
  update({ choosing: false, atRest: false });
}

/** Let the webcam perform; what that needs is installed first, if the user wants it. */
export async function performWebcam(): Promise<void> {
  if (current().server?.installed.includes("camera") !== true) {
    ask("camera", performWebcam);
    return;
  }
  const uri = await device((each) => each.startsWith("camera:"), strings.sources.noWebcam);
  if (uri !== null) await performLive(current().faces ? `${uri}?face&hands` : uri);
}

export const isKinect = (uri: string): boolean => /^(freenect|openni):/.test(uri);

export async function performKinect(): Promise<void> {
  const uri = await device(isKinect, strings.sources.noKinect);
  if (uri !== null) await performLive(uri);
}

/** The address of the first device that is plugged in and fits; null, and a message, without one. */
async function device(fits: (uri: string) => boolean, absent: string): Promise<string | null> {
  const sources = await request<Sources>(strings.busy.devices, "sources");
  const uri = sources?.devices.find((each) => fits(each.uri))?.uri ?? null;
  if (sources !== null) update({ sources, notice: uri === null ? { level: "warning", text: absent } : null });
  return uri;
}

/** Make a recording the performer: all of it in a loop, or what it is trimmed to. */
export async function perform({ kind, name }: Recording, trimmed = false): Promise<void> {
  const { loop, trim } = current();
  const [start, stop] = trimmed ? trim : [null, null];
  await request(strings.busy.source, "source", { [kind]: name, loop: trimmed ? loop : true, start, stop });
  update({ choosing: false, atRest: false });
}

export async function calibrate(character: string): Promise<void> {
  await request(strings.busy.calibrate, "calibrate", { character });
}

/** Choose the performer who drives a character; with null, the service chooses. */
export async function chooseUser(character: string, user: number | null): Promise<void> {
  await request(strings.busy.choose, "choose_user", { character, user });
}

let looking = 0;

/** Show what the source sees, and update it until it is hidden; or hide it. */
export async function look(on: boolean): Promise<void> {
  const turn = ++looking;
  update({ looking: on, look: null });
  while (current().looking && turn === looking) {
    const stage = shownCharacter(current())?.stage;
    const seen = await connection.request<LookReply>("look", stage === undefined || stage === "" ? {} : { stage }).catch((error: unknown): LookReply => {
      const problem: Banner = { level: "warning", text: error instanceof Error ? error.message : "", fix: "" };
      return { picture: "", width: 0, height: 0, problems: [problem], performers: [] };
    });
    if (turn === looking) update({ look: seen });
    await new Promise((resolve) => setTimeout(resolve, 500));
  }
}

// --------------------------------------------------------------------------------------------------------- edits

const editing = new Set<string>();

/** Show a puppet immediately, and send it. Of the edits made while it is being applied, only the newest is sent next. */
export function edit(puppet: Puppet): void {
  const { character, puppets } = current();
  if (character === null) return;
  const history = puppets[character];
  if (history === undefined) return;
  update({ puppets: { ...puppets, [character]: commit(history, puppet) }, edited: "puppet" });
  void send(character);
}

/** Let the limbs follow the performer as another body plan says. */
export async function changePlan(plan: string): Promise<void> {
  const { character } = current();
  if (character === null) return;
  const reply = await request<PuppetReply>(strings.busy.edit, "change_plan", { character, plan });
  if (reply !== null && current().character === character) edit(reply.puppet);
}

export function undo(): void {
  if (current().edited === "film") stepFilm(earlier);
  else step(earlier);
}

export function redo(): void {
  if (current().edited === "film") stepFilm(later);
  else step(later);
}

function step(move: typeof earlier): void {
  const { character, puppets, selection } = current();
  const history = character === null ? undefined : puppets[character];
  if (character === null || history === undefined) return;
  const moved = move(history);
  if (moved === history) return;
  update({
    puppets: { ...puppets, [character]: moved },
    selection: selection !== null && has(moved.present, selection) ? selection : null,
  });
  void send(character);
}

async function send(character: string): Promise<void> {
  if (editing.has(character)) return;
  editing.add(character);
  try {
    let sent: Puppet | undefined;
    while (current().puppets[character] !== undefined && sent !== current().puppets[character]?.present) {
      sent = current().puppets[character]?.present;
      const reply = await request<PuppetReply>(strings.busy.edit, "edit", { character, puppet: sent });
      if (reply === null && sent === current().puppets[character]?.present) {
        // refused: the character stays as it is, and so does the page
        update(({ puppets }) => {
          const history = puppets[character];
          return history === undefined ? {} : { puppets: { ...puppets, [character]: { ...earlier(history), future: [] } } };
        });
        return;
      }
      const { puppets } = current();
      const history = puppets[character];
      if (reply !== null && history !== undefined && history.present === sent) {
        // as the server has it: handles are snapped to the surface
        sent = reply.puppet;
        update(({ plans }) => ({
          puppets: { ...puppets, [character]: { ...history, present: reply.puppet } },
          plans: { ...plans, [character]: reply.plan },
        }));
      }
    }
  } finally {
    editing.delete(character);
  }
}

export function select(selection: Part | null): void {
  update({ selection, ...(selection === null ? {} : { tab: "limbs" as const }) });
}

/** Choose a part; a joint or a channel that waits for it moves it from now on. */
export function pickPart(part: Part): void {
  const puppet = shownPuppet(current());
  const { joint, channel } = current();
  if (channel !== null && puppet !== null) {
    edit(withChannel(puppet, part, channel));
    update({ channel: null });
  }
  if (joint !== null && puppet !== null) {
    edit(follow(puppet, part, joint));
    update({ joint: null });
  }
  select(part);
}

/** Choose a joint: it moves the selected part, or waits for one. */
export function pickJoint(joint: Joint): void {
  const { selection, joint: waiting } = current();
  const puppet = shownPuppet(current());
  if (selection !== null && puppet !== null) edit(follow(puppet, selection, joint));
  else update({ joint: waiting === joint ? null : joint, channel: null, target: null });
}

/** Choose a channel: it moves the selected part or the morph target that waits for it, or waits for one of these. */
export function pickChannel(channel: string): void {
  const { selection, channel: waiting, target } = current();
  const puppet = shownPuppet(current());
  if (puppet === null) return;
  if (target !== null) edit(withMorph(puppet, target, channel));
  else if (selection !== null) edit(withChannel(puppet, selection, channel));
  else {
    update({ channel: waiting === channel ? null : channel, joint: null, tab: "limbs", selection: null });
    return;
  }
  update({ channel: null, target: null });
}

/** Choose a morph target: the channel that waits for it moves it, or it waits for one. */
export function pickTarget(target: string): void {
  const { channel, target: waiting } = current();
  const puppet = shownPuppet(current());
  if (channel !== null && puppet !== null) {
    edit(withMorph(puppet, target, channel));
    update({ channel: null });
  } else update({ target: waiting === target ? null : target, joint: null });
}

let samples: Sample[] = [];

/** Measure which values of a channel count as 0 and 1: the performer holds both for a second. */
export function findRange(channel: string): void {
  samples = [];
  update({ finding: { channel, neutral: null }, channel: null, target: null, joint: null });
}

/** Take a value of the channel whose range is being measured, at a time in milliseconds. */
export function sampled(time: number, values: Readonly<Record<string, number>>): void {
  const { finding } = current();
  const puppet = shownPuppet(current());
  if (finding === null || puppet === null) return;
  samples.push({ time, value: values[finding.channel] ?? 0 });
  const value = held(samples, finding.neutral);
  if (value === null) return;
  samples = [];
  if (finding.neutral === null) {
    update({ finding: { ...finding, neutral: value } });
    return;
  }
  edit(withRange(puppet, finding.channel, { neutral: finding.neutral, full: value }));
  update({ finding: null, notice: { level: "info", text: strings.channels.found(finding.channel, movedByChannel(puppet, finding.channel)) } });
}

export function removeSelected(): void {
  const { selection } = current();
  const puppet = shownPuppet(current());
  if (selection === null || puppet === null) return;
  const next = remove(puppet, selection);
  update({ selection: null });
  edit(next);
}

export function mirrorSelected(bounds: readonly [Vector, Vector]): void {
  const { selection } = current();
  const puppet = shownPuppet(current());
  if (selection === null || puppet === null) return;
  const whole: Part = { kind: selection.kind, name: selection.name };
  const mirrored = mirror(puppet, whole, symmetryPoint(puppet, bounds));
  if (mirrored === null) return;
  edit(mirrored.puppet);
  select(mirrored.part);
}

/** Show the effect of a smoothing on a test signal, or on a joint of the performer who drives the shown character. */
export async function preview(smoothing: Smoothing): Promise<void> {
  const { plotted } = current();
  const shown = shownCharacter(current());
  const live = plotted === null || shown === null ? {} : { joint: plotted, character: shown.name };
  const reply = await connection.request<SmoothingReply>("smoothing_preview", { ...smoothing, ...live }).catch(() => null);
  if (plotted === current().plotted) update({ preview: reply });
}

let plotting = 0;

/** Choose what the plot of the smoothing shows; a joint's plot is updated while it is on the page. */
export async function plot(joint: Joint | null): Promise<void> {
  const turn = ++plotting;
  update({ plotted: joint, preview: null });
  do {
    const puppet = shownPuppet(current());
    if (puppet !== null) await preview(smoothingOf(puppet));
    await new Promise((resolve) => setTimeout(resolve, 1000));
  } while (joint !== null && turn === plotting && current().tab === "motion" && current().face === "workshop");
  if (turn === plotting && joint !== null) void plot(null);
}

export async function save(character: string): Promise<void> {
  const saved = await request<{ name: string; file: string }>(strings.busy.save, "save_puppet", { character });
  if (saved !== null && saved.file !== "") await offer(saved.file, saved.name);
}

// --------------------------------------------------------------------------------------------------------- takes

/** Record the character that is shown after a count-in, while the film's other takes play; or stop. */
export async function record(on: boolean): Promise<void> {
  if (on) {
    const { character } = current();
    const begun = await request(strings.busy.record, "record_start", { count_in: COUNT_IN, ...(character === null ? {} : { character }) });
    if (begun !== null) await countIn(COUNT_IN);
    return;
  }
  update({ count: null });
  const take = await request<{ name?: string }>(strings.busy.stop, "record_stop");
  if (take?.name !== undefined) {
    update({ tab: "takes", recording: { kind: "take", name: take.name }, trim: [null, null], exported: null, edited: "film" });
  }
}

export async function deleteTake(take: string): Promise<void> {
  await request(strings.busy.remove, "delete_take", { take });
}

export async function deleteUpload(upload: string): Promise<void> {
  await request(strings.busy.remove, "delete_upload", { upload });
}

export async function exportRecording(): Promise<void> {
  const { character, recording, form, trim } = current();
  if (character === null || recording === null) return;
  const [start, stop] = trim;
  const values = { character, [recording.kind]: recording.name, form: form || null, start, stop };
  update({ exported: null });
  update({ exported: await request<ExportReply>(strings.busy.export, "export", values) });
}

export async function cancel(job: string): Promise<void> {
  await connection.request("cancel", { job }).catch(() => null);
}

/** Show an address that opens the page in another window, once. */
export async function invite(): Promise<void> {
  const reply = await request<{ address: string }>(strings.busy.invite, "invite");
  if (reply !== null) update({ notice: { level: "info", text: strings.status.invited(reply.address) } });
}

/** Save a file of the server on this computer. */
export async function offer(id: string, name: string): Promise<void> {
  const blob = await doing(strings.busy.save, () => download(id));
  if (blob === null) return;
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => {
    URL.revokeObjectURL(link.href);
  }, 60_000);
}
