/** The page without a browser: its tree of nodes, the server that it asks, and a clock that a test turns. */

import { appendFileSync } from "node:fs";

import { connect, sampled } from "../src/actions";
import { type Child, type Node_ } from "../src/dom";
import { keys } from "../src/keys";
import type { CharacterState, FilmPlan, FilmScene, FilmState, FilmTake, Greeting, ServerError, ServerState, TakeState, UploadKind } from "../src/messages";
import { EMPTY } from "../src/model/film";
import type { Limb, Puppet } from "../src/model/puppet";
import type { Vector } from "../src/model/vector";
import { figure } from "../src/panels/figure";
import { meters } from "../src/panels/meters";
import { put } from "../src/placing";
import { planFilm } from "../src/plan";
import { type Face, INITIAL, current, subscribe, update } from "../src/store";
import { page } from "../src/view";

// ------------------------------------------------------------------------------------------------------- the clock

let now = 0;
let timers: { readonly id: number; readonly at: number; readonly work: () => void }[] = [];
let made = 0;

const soon = (): Promise<void> => new Promise((resolve) => setImmediate(resolve));

/** Let the clock run, and all that waits for it. */
export async function pass(milliseconds: number): Promise<void> {
  const end = now + milliseconds;
  for (;;) {
    await soon();
    const next = timers.filter(({ at }) => at <= end).sort((a, b) => a.at - b.at || a.id - b.id)[0];
    if (next === undefined) break;
    timers = timers.filter(({ id }) => id !== next.id);
    now = Math.max(now, next.at);
    next.work();
  }
  now = end;
}

// ------------------------------------------------------------------------------------------------------ the server

export interface Request {
  readonly id: number;
  readonly do: string;
  readonly [key: string]: unknown;
}

type Reply = (request: Request) => unknown;

export const refusal = (found: string): ServerError => ({ where: "the request", found, expected: "something else", fix: "Choose it." });

class Refused extends Error {
  constructor(readonly reason: ServerError) {
    super(reason.found);
  }
}

/** Frames of both directions, for the test that compares them with the server's own classes. */
function keep(frame: object): void {
  const file = process.env.STUDIO_FRAMES;
  if (file !== undefined) appendFileSync(file, `${JSON.stringify(frame)}\n`);
}

export const GREETING: Greeting = {
  session: "session",
  version: "1",
  joints: [],
  parents: {},
  forms: ["morph", "frames"],
  suffixes: { character: [".glb", ".obj"], log: [".log"], puppet: [".toml"], video: [".mp4"], sound: [".mp3"], picture: [".png"] },
  limits: { upload_bytes: 1000, uploads: 5 },
  joined: false,
};

export const NAME = "figure";

const LIMB = (name: string, points: readonly Vector[], ...joints: Limb["joints"]): Limb => ({ name, points, joints });

export const PUPPET: Puppet = {
  character: { mesh: "figure.glb", up: "y", front: "z", scale: 1 },
  limb: [
    LIMB("trunk", [[0, 0, 0], [0, 1, 0]], "hip_center", "shoulder_center"),
    LIMB("head", [[0, 1, 0], [0, 2, 0]], "shoulder_center", "head"),
    LIMB("left arm", [[1, 1, 0], [2, 1, 0], [3, 1, 0], [4, 1, 0]], "shoulder_left", "elbow_left", "wrist_left", "hand_left"),
    LIMB("right arm", [[-1, 1, 0], [-9, 1, 0]], "shoulder_right", "hand_right"),
  ],
  handle: [{ name: "hump", position: [0, 1, -1] }],
  morph: [],
  channel: [],
  root: null,
  retarget: {},
};

const character = (name: string, change: Partial<CharacterState> = {}): CharacterState => ({
  name, title: name, stage: "stage", limbs: [], handles: [], targets: ["jaw", "brows"], vertices: 8, triangles: 12, version: "", saved: true,
  model: "", notes: [], performer: 1, state: "performing", mirror: false, rate: 30, ...change,
});

export const take = (name: string, change: object = {}): TakeState => Object.assign(
  { name, seconds: 4, frames: 120, bytes: 9, written: 0, at: null, parts: [], picture: "", wave: "", sound: false, sound_file: "" }, change);

export const clip = (name: string, at: number): FilmTake => ({ character: NAME, file: `takes/${name}.log`, at, start: 0, stop: 4, mute: false });

export const FILM: FilmState = { ...EMPTY, light: { key: [1, 1, 1], sky: [1, 1, 1], ground: [0, 0, 0], direction: [0, 1, 0] }, problem: "" };

const PLAN: FilmPlan = {
  size: [1280, 720],
  step: 0.5,
  bubbles: [],
  moments: [{ brightness: 1, titles: [], views: [{ shot: 0, share: 1, eye: [0, 1, 4], target: [0, 1, 0], field_of_view: 30, bubbles: [] }], places: { [NAME]: [0, 0, 0, 0] } }],
};

const STATE: ServerState = {
  characters: [],
  source: { uri: "demo:walk", kind: "example", name: "walk", text: "Walk", loop: true, start: null, stop: null },
  stages: [],
  service: { running: true, starting: false, address: "", restarts: 0, problem: "", text: "" },
  performers: [],
  recording: null,
  takes: [],
  film: FILM,
  installed: ["camera", "film", "sound"],
  microphone: false,
  timeline: null,
  uploads: [],
  files: [],
  jobs: [],
  status: { fps: 30, latency_ms: 4, clients: 1, drops: 0 },
  banner: { level: "none", text: "", fix: "" },
};

let versions = 0;

/** Answers as the studio's server does; `on` replaces an answer, and `requests` has what was asked. */
export class Server {
  state: ServerState = STATE;
  greeting: Greeting = GREETING;
  /** Why it refuses pages with these tokens. */
  readonly refused = new Map<string, string>();
  readonly tokens: string[] = [];
  readonly requests: Request[] = [];
  readonly uploads: string[] = [];
  private readonly puppets = new Map<string, Puppet>();
  private readonly answers = new Map<string, Reply>([
    ["puppet", ({ character }) => this.puppet(character as string)],
    ["edit", ({ character, puppet }) => {
      this.open(character as string, puppet as Puppet, { saved: false });
      return this.puppet(character as string);
    }],
    ["edit_film", ({ takes, scene }) => {
      const { film } = this.state;
      this.change({ film: { ...FILM, takes: (takes as FilmTake[] | undefined) ?? film.takes, scene: (scene as FilmScene | undefined) ?? film.scene } });
      return this.state.film;
    }],
    ["plan_film", () => PLAN],
    ["smoothing_preview", () => ({ times: [0, 1], measured: [0, 1], smoothed: [0, 0.5], measured_mm: 5, jitter_mm: 1, lag_ms: 60, rise_ms: 1, overshoot_mm: 0 })],
    ["sources", () => ({ characters: [], examples: ["walk"], devices: [], ports: [] })],
  ]);
  private socket: Socket | null = null;

  /** Answer a kind of request in another way. */
  on(what: string, answer: Reply): this {
    this.answers.set(what, answer);
    return this;
  }

  /** Refuse a kind of request. */
  refuse(what: string, found: string): this {
    return this.on(what, () => {
      throw new Refused(refusal(found));
    });
  }

  /** Hold the answers to a kind of request back; the function that it returns sends the next one. */
  hold(what: string): () => Promise<void> {
    const answer = this.answers.get(what);
    const waiting: (() => void)[] = [];
    this.on(what, async (request) => {
      await new Promise<void>((resolve) => waiting.push(resolve));
      return answer?.(request) ?? {};
    });
    return async () => {
      waiting.shift()?.();
      await soon();
    };
  }

  /** Open a character, or replace its puppet. */
  open(name: string, puppet: Puppet, change: Partial<CharacterState> = {}): void {
    this.puppets.set(name, puppet);
    const before = this.state.characters.find((each) => each.name === name) ?? character(name);
    const others = this.state.characters.filter((each) => each.name !== name);
    this.change({ characters: [...others, { ...before, version: String(++versions), ...change }] });
  }

  /** Send a state that differs from the one before. */
  change(change: Partial<ServerState>): void {
    this.state = { ...this.state, ...change };
    this.send({ event: "state", state: this.state });
  }

  send(frame: object): void {
    keep(frame);
    this.socket?.onmessage?.({ data: JSON.stringify(frame) });
  }

  /** The requests of a kind, without their ids. */
  asked(what: string): object[] {
    return this.requests.filter((each) => each.do === what).map((each) => Object.fromEntries(Object.entries(each).filter(([key]) => key !== "id" && key !== "do")));
  }

  /** End the connection, with a code and a reason. */
  end(code: number, reason = ""): void {
    const { socket } = this;
    this.socket = null;
    if (socket !== null) socket.readyState = 3;
    socket?.onclose?.({ code, reason });
  }

  connected(socket: Socket): void {
    this.socket = socket;
    queueMicrotask(() => socket.onopen?.());
  }

  async received(text: string): Promise<void> {
    const request = JSON.parse(text) as Request & { readonly token?: string };
    if (request.token !== undefined) {
      this.tokens.push(request.token);
      const reason = this.refused.get(request.token);
      if (reason !== undefined) {
        this.end(4401, reason);
        return;
      }
      this.send({ hello: this.greeting });
      this.send({ event: "state", state: this.state });
      return;
    }
    this.requests.push(request);
    try {
      const result = await (this.answers.get(request.do) ?? (() => ({})))(request);
      keep({ request, result });
      this.send({ id: request.id, ok: true, result });
    } catch (error) {
      if (!(error instanceof Refused)) throw error;
      keep({ request });
      this.send({ id: request.id, ok: false, error: error.reason });
    }
  }

  private puppet(name: string): object {
    return { character: name, puppet: this.puppets.get(name), saved: true, plan: null };
  }
}

class Socket {
  static readonly OPEN = 1;
  readyState = 1;
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: string }) => void) | null = null;
  onclose: ((event: { code: number; reason: string }) => void) | null = null;

  constructor() {
    server.connected(this);
  }

  send(text: string): void {
    void server.received(text);
  }
}

// ------------------------------------------------------------------------------------- what a browser would have

let server = new Server();

/** What the page has saved on this computer. */
export const saved: { name: string; file: string }[] = [];
/** The last dialog that chooses files. */
export const chooser = { accept: "", files: [] as File[], onchange: (): void => undefined };
/** The id of the element that has the focus. */
export let focused = "";

class Field {
  type = "text";
}

class Select {
  type = "select-one";
}

class Sound {
  readonly gain = { setTargetAtTime: (): void => undefined };
  readonly connect = (): void => undefined;
  readonly start = (): void => undefined;
  readonly getChannelData = (): Float32Array => new Float32Array();
}

const KINDS: Readonly<Record<string, UploadKind>> = { toml: "puppet", log: "log", mp4: "video", mp3: "sound", png: "picture" };

const storage = new Map<string, string>();
const stored = (values: Map<string, string>): object => ({
  getItem: (key: string) => values.get(key) ?? null,
  setItem: (key: string, value: string) => values.set(key, value),
  removeItem: (key: string) => values.delete(key),
});
const address = { hash: "#token=once", pathname: "/", protocol: "http:", host: "127.0.0.1:7480" };

Object.assign(globalThis, {
  setTimeout: (work: () => void, milliseconds = 0) => {
    timers.push({ id: ++made, at: now + milliseconds, work });
    return made;
  },
  clearTimeout: (timer: number) => {
    timers = timers.filter(({ id }) => id !== timer);
  },
  WebSocket: Socket,
  location: address,
  history: { replaceState: () => undefined },
  sessionStorage: stored(storage),
  localStorage: stored(new Map()),
  fetch: (path: string, { body }: { body?: File }) => {
    if (body === undefined) return Promise.resolve({ ok: true, blob: () => Promise.resolve(new Blob([path])) });
    const kind = KINDS[body.name.split(".").at(-1) ?? ""] ?? "character";
    server.uploads.push(body.name);
    return Promise.resolve({ ok: true, json: () => Promise.resolve({ upload: `id-of-${body.name.split(".")[0] ?? ""}`, kind, name: body.name, file: `media/${body.name}` }) });
  },
  document: {
    activeElement: null,
    createElement: (tag: string) => tag === "input" ? Object.assign(chooser, { click: () => undefined }) : {
      href: "", download: "",
      click(this: { href: string; download: string }) {
        saved.push({ name: this.download, file: this.href });
      },
    },
    getElementById: (id: string) => ({
      setAttribute: () => undefined,
      focus: () => {
        focused = id;
      },
    }),
  },
  HTMLElement: Field,
  HTMLInputElement: Field,
  HTMLSelectElement: Select,
  AudioContext: class {
    readonly sampleRate = 4;
    readonly currentTime = 0;
    readonly destination = {};
  },
  GainNode: Sound,
  AudioBuffer: Sound,
  AudioBufferSourceNode: Sound,
});
performance.now = () => now;

// ---------------------------------------------------------------------------------------------------------- the page

function flat(child: Child): (Node_ | string)[] {
  if (child === false || child === null || child === undefined) return [];
  if (typeof child === "string") return [child];
  return "tag" in child ? [child] : child.flatMap(flat);
}

/** Siblings have different keys, by which they are found again when the page is drawn. */
function checkKeys(siblings: readonly (Node_ | string)[]): void {
  const nodes = siblings.filter((node) => typeof node !== "string");
  const keyed = nodes.map(({ attributes }) => attributes.key).filter((key) => key !== undefined);
  if (new Set(keyed).size < keyed.length) throw new Error(`siblings have the same key: ${keyed.join()}`);
  for (const { children } of nodes) checkKeys(children);
}

const textOf = (node: Node_ | string): string => typeof node === "string" ? node : node.children.map(textOf).join("");

/** An element of the page, as a user finds it. */
class Found {
  constructor(
    readonly node: Node_,
    /** Whether the user cannot change it. */
    readonly disabled: boolean,
  ) {}

  get text(): string {
    return textOf(this.node);
  }

  get value(): unknown {
    return this.node.attributes.value;
  }

  /** The value of an attribute. */
  is(attribute: string): unknown {
    return this.node.attributes[attribute];
  }

  /** The texts that a select offers. */
  get choices(): string[] {
    return this.node.children.map(textOf);
  }

  async click(): Promise<void> {
    await this.fire("onclick", {});
  }

  /** Type into a field, and leave it. */
  async enter(value: string | number): Promise<void> {
    const [min, max] = [Number(this.is("min") ?? -Infinity), Number(this.is("max") ?? Infinity)];
    const target = { value: String(value), valueAsNumber: Number(value), validity: { badInput: Number.isNaN(Number(value)), rangeUnderflow: Number(value) < min, rangeOverflow: Number(value) > max } };
    await this.fire("onchange", { target });
  }

  /** Choose an entry of a select by its text. */
  async choose(text: string): Promise<void> {
    const option = this.node.children.find((each) => textOf(each) === text);
    if (option === undefined || typeof option === "string") throw new Error(`no ${text} among ${this.choices.join()}`);
    await this.fire("onchange", { target: { value: option.attributes.value } });
  }

  async check(checked: boolean): Promise<void> {
    await this.fire("onchange", { target: { checked } });
  }

  /** Press a key. */
  async press(key: string): Promise<void> {
    await this.fire("onkeydown", { key, preventDefault: () => undefined, stopPropagation: () => undefined });
  }

  private async fire(name: string, event: object): Promise<void> {
    if (this.disabled) throw new Error(`${this.text} is disabled`);
    (this.node.attributes[name] as unknown as (event: object) => void)(event);
    await soon();
  }
}

let shown: Page | null = null;

subscribe(() => {
  shown?.draw();
  void planFilm();
});

/** The page of a studio that has a character. */
export class Page {
  joints: Float32Array | null = null;
  channels: Record<string, number> = {};
  emphasised: string | null = null;

  private constructor(readonly server: Server) {}

  static async open(prepare: (server: Server) => void = () => undefined, face: Face = "workshop"): Promise<Page> {
    server = new Server();
    server.open(NAME, PUPPET);
    prepare(server);
    shown = new Page(server);
    update({ ...INITIAL, face });
    connect();
    await soon();
    return shown;
  }

  get state() {
    return current();
  }

  get puppet(): Puppet {
    const shown = current().puppets[current().character ?? ""]?.present;
    if (shown === undefined) throw new Error("no character is shown");
    return shown;
  }

  limb(name: string): Limb {
    return this.named(this.puppet.limb, name);
  }

  handle(name: string) {
    return this.named(this.puppet.handle, name);
  }

  private named<T extends { readonly name: string }>(all: readonly T[] | undefined, name: string): T {
    const found = all?.find((each) => each.name === name);
    if (found === undefined) throw new Error(`no ${name}`);
    return found;
  }

  /** All elements, each with whether it is disabled. */
  private *all(nodes: readonly (Node_ | string)[] = this.nodes(), off = false): Generator<Found> {
    for (const node of nodes) {
      if (typeof node === "string") continue;
      const disabled = off || node.attributes.disabled === true;
      yield new Found(node, disabled);
      yield* this.all(node.children, disabled);
    }
  }

  /** Draw the page, as a browser does whenever the state has changed. */
  draw(): void {
    this.nodes();
  }

  private nodes(): (Node_ | string)[] {
    const viewer = { drawnPerSecond: 30, has: () => true, bounds: () => [[-4, 0, -1], [4, 2, 1]] as const, height: () => 2, fit: () => undefined };
    const live = [figure(current(), this.joints, (joint) => {
      this.emphasised = joint;
    }), meters(current(), this.channels)];
    const nodes = [...page(current(), viewer), live].flatMap(flat);
    checkKeys(nodes);
    return nodes;
  }

  get text(): string {
    return this.nodes().map(textOf).join("\n");
  }

  /** All elements inside of another. */
  within({ node, disabled }: Found): Found[] {
    return [...this.all(node.children, disabled)];
  }

  /** All elements of a tag that have a class, if one is given. */
  every(tag: string, name = ""): Found[] {
    return [...this.all()].filter(({ node }) => node.tag === tag && (name === "" || String(node.attributes.class ?? "").split(" ").includes(name)));
  }

  /** The buttons of a name, which a screen reader says. */
  buttons(name: string): Found[] {
    return [...this.all()].filter((each) => (each.node.tag === "button" || each.is("role") === "button") && (each.is("aria-label") ?? each.text) === name);
  }

  button(name: string): Found {
    return one(name, this.buttons(name));
  }

  /** A row of a list by its name. */
  line(name: string): Found {
    return one(name, this.every("button", "line").filter(({ node }) => node.children.some((each) => typeof each !== "string" && each.attributes.class === "name" && textOf(each) === name)));
  }

  /** A field by its label. */
  field(label: string): Found {
    const inputs = (found: Found): Found[] => this.within(found).filter(({ node }) => ["input", "select"].includes(node.tag));
    const labelled = [...this.all()].filter(({ node }) => node.tag === "label" && node.children.some((each) => typeof each !== "string" && each.tag === "span" && textOf(each) === label));
    const own = [...this.all()].filter((each) => ["input", "select"].includes(each.node.tag) && each.is("aria-label") === label);
    return one(label, [...labelled.flatMap(inputs), ...own]);
  }

  joint(name: string): Found {
    return one(name, this.every("g", "joint").filter((each) => each.is("id") === `joint-${name}`));
  }

  meter(name: string): Found {
    return one(name, this.every("button", "meter").filter(({ node }) => typeof node.children[0] !== "string" && textOf(node.children[0]?.children[0] ?? "") === name));
  }

  /** Press a key of the page, outside of fields, or inside of the one that is typed into. */
  async press(key: string, more: object = {}): Promise<void> {
    keys(Object.assign({ key, ctrlKey: false, metaKey: false, shiftKey: false, repeat: false, target: null, preventDefault: () => undefined, stopPropagation: () => undefined }, more) as unknown as KeyboardEvent);
    await soon();
  }

  /** Click the body in the 3D view with a tool. */
  async click(inside: Vector, surface: Vector = inside): Promise<void> {
    put(inside, surface, [[-4, 0, -1], [4, 2, 1]]);
    await soon();
  }

  /** The performer's channels have these values for some milliseconds, 30 times a second. */
  async perform(channels: Record<string, number>, milliseconds: number): Promise<void> {
    this.channels = channels;
    for (const end = now + milliseconds; now < end;) {
      sampled(now, channels);
      await pass(1000 / 30);
    }
  }
}

function one(what: string, found: readonly Found[]): Found {
  const [first, ...others] = found;
  if (first === undefined || others.length > 0) throw new Error(`${found.length} elements: ${what}`);
  return first;
}

/** A field into which somebody types. */
export const typing = (): object => new Field();
