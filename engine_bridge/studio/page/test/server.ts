/** The server that the page asks. */

import { appendFileSync } from "node:fs";

import type { CharacterState, FilmPlan, FilmScene, FilmState, FilmTake, Greeting, ServerError, ServerState, TakeState } from "../src/messages";
import { EMPTY } from "../src/model/film";
import type { Limb, Puppet } from "../src/model/puppet";
import type { Vector } from "../src/model/vector";
import { soon } from "./clock";

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

/** What the server uses of a socket. */
interface Socket {
  readyState: number;
  onopen: (() => void) | null;
  onmessage: ((event: { data: string }) => void) | null;
  onclose: ((event: { code: number; reason: string }) => void) | null;
}

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
