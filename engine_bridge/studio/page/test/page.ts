/** The page without a browser: its tree of nodes, as a user finds and uses it. */

import { connect, sampled } from "../src/actions";
import { type Child, type Node_ } from "../src/dom";
import { keys } from "../src/keys";
import type { UploadKind } from "../src/messages";
import type { Limb, Puppet } from "../src/model/puppet";
import type { Vector } from "../src/model/vector";
import { figure } from "../src/panels/figure";
import { meters } from "../src/panels/meters";
import { put } from "../src/placing";
import { planFilm } from "../src/plan";
import { type Face, INITIAL, current, subscribe, update } from "../src/store";
import { page } from "../src/view";
import { pass, soon } from "./clock";
import { NAME, PUPPET, Server } from "./server";

let server = new Server();

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
    for (const end = performance.now() + milliseconds; performance.now() < end;) {
      sampled(performance.now(), channels);
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
