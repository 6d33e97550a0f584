/** The page's state, in one place: what the server has sent, and what the user has chosen in this window. */

import type { ExportReply, Extra, FilmCharacter, FilmPlan, FilmReply, Greeting, LookReply, ServerState, ShareReply, SmoothingReply, Sources } from "./messages";
import { EMPTY, type Film } from "./model/film";
import { type History, begin } from "./model/history";
import type { Part, Puppet } from "./model/puppet";
import type { Joint } from "./model/skeleton";
import type { Vector } from "./model/vector";

export type Connected = "connecting" | "open" | "lost" | "refused";
/** What the page is for: to make films, or to look at and change how a character moves. */
export type Face = "film" | "workshop";
export type Tab = "limbs" | "motion" | "takes";
export type FilmTab = "scene" | "character";
export type Tool = "select" | "limb" | "handle" | "jaw";
export type Dragging = "view" | "surface";

export interface Notice {
  readonly level: "info" | "warning" | "error";
  readonly text: string;
}

/** A recording to play or export: a take, an upload or an example. */
export interface Recording {
  readonly kind: "take" | "upload" | "example";
  readonly name: string;
}

export interface State {
  readonly connected: Connected;
  /** Why the server refused this window. */
  readonly refusal: string;
  readonly greeting: Greeting | null;
  readonly server: ServerState | null;
  /** The character that panels show. */
  readonly character: string | null;
  /** Every character's puppet as edited here, with the steps that can be undone. */
  readonly puppets: Readonly<Record<string, History<Puppet>>>;
  /** The body plan that each character's limbs follow, as the server has them. */
  readonly plans: Readonly<Record<string, string | null>>;
  readonly selection: Part | null;
  /** A joint that waits for the part that it will move. */
  readonly joint: Joint | null;
  /** A channel that waits for the limb, handle or morph target that it will move. */
  readonly channel: string | null;
  /** A morph target that waits for its channel. */
  readonly target: string | null;
  /** The channel whose range is being measured, and its neutral value as soon as it is known. */
  readonly finding: { readonly channel: string; readonly neutral: number | null } | null;
  readonly face: Face;
  /** The tab of the right panel in the workshop, and the one in the film. */
  readonly tab: Tab;
  readonly filmTab: FilmTab;
  readonly tool: Tool;
  readonly dragging: Dragging;
  /** Points of the limb or jaw that is being added. */
  readonly drawn: readonly Vector[];
  /** Whether the character is shown in its rest pose, to edit it. */
  readonly atRest: boolean;
  readonly bones: boolean;
  /** The row of a character while its place or size is being dragged. */
  readonly draft: ({ readonly name: string } & Partial<FilmCharacter>) | null;
  /** Whether the webcam measures the face and the hands too. */
  readonly faces: boolean;
  /** Whether the list of sources is open. */
  readonly choosing: boolean;
  /** Whether the choice of another character is open. */
  readonly adding: boolean;
  readonly sources: Sources | null;
  readonly looking: boolean;
  readonly look: LookReply | null;
  readonly preview: SmoothingReply | null;
  /** The performer's joint that the plot of the smoothing shows; null for a test signal. */
  readonly plotted: Joint | null;
  readonly recording: Recording | null;
  readonly trim: readonly [number | null, number | null];
  readonly loop: boolean;
  /** A value of `Greeting.forms`; empty for the one that suits the character. */
  readonly form: string;
  readonly exported: ExportReply | null;
  /** The film as edited here, with the steps that can be undone. */
  readonly film: History<Film>;
  /** What the film shows, as the server has planned it, and of what film; null inside if it cannot be planned. */
  readonly plan: { readonly of: string; readonly film: FilmPlan | null } | null;
  /** What undo undoes: the last kind of edit. */
  readonly edited: "puppet" | "film";
  /** Key of the take that is chosen in the film. */
  readonly clip: string | null;
  /** Second of the film from which it plays. */
  readonly playhead: number;
  /** When the timeline was received, in milliseconds of the page. */
  readonly timed: number;
  /** When the take began that is being recorded, in milliseconds of the page. */
  readonly recordedFrom: number | null;
  /** What the count-in shows; 0 is the clapper. */
  readonly count: number | null;
  /** The film that was made, and how phones reach it if it is shared. */
  readonly made: (FilmReply & { readonly url: string; readonly shared: ShareReply | null }) | null;
  /** What the page asks to install. */
  readonly asking: Extra | null;
  /** The side panel that is open in a narrow window. */
  readonly drawer: "left" | "right" | null;
  /** Moving pictures of characters, as addresses: eight images side by side. */
  readonly portraits: Readonly<Record<string, string>>;
  /** Whether the list of keys is open. */
  readonly help: boolean;
  readonly progress: Readonly<Record<string, { text: string; fraction: number }>>;
  /** What has been requested and not answered yet, in words. */
  readonly busy: readonly string[];
  /** When each piece of work was first seen, in milliseconds of the page. */
  readonly since: Readonly<Record<string, number>>;
  readonly notice: Notice | null;
  readonly dropping: boolean;
}

export const INITIAL: State = {
  connected: "connecting",
  refusal: "",
  greeting: null,
  server: null,
  character: null,
  puppets: {},
  plans: {},
  selection: null,
  joint: null,
  channel: null,
  target: null,
  finding: null,
  face: "film",
  tab: "limbs",
  filmTab: "scene",
  tool: "select",
  dragging: "view",
  drawn: [],
  atRest: false,
  bones: true,
  draft: null,
  faces: false,
  choosing: false,
  adding: false,
  sources: null,
  looking: false,
  look: null,
  preview: null,
  plotted: null,
  recording: null,
  trim: [null, null],
  loop: true,
  form: "",
  exported: null,
  film: begin(EMPTY),
  plan: null,
  edited: "puppet",
  clip: null,
  playhead: 0,
  timed: 0,
  recordedFrom: null,
  count: null,
  made: null,
  asking: null,
  drawer: null,
  portraits: {},
  help: false,
  progress: {},
  busy: [],
  since: {},
  notice: null,
  dropping: false,
};

type Listener = (state: State) => void;

let state = INITIAL;
let scheduled = false;
const listeners: Listener[] = [];

export const current = (): State => state;

/** Change the state; views are drawn again once, after the running code has ended. */
export function update(change: Partial<State> | ((state: State) => Partial<State>)): void {
  state = { ...state, ...(typeof change === "function" ? change(state) : change) };
  if (scheduled) return;
  scheduled = true;
  queueMicrotask(() => {
    scheduled = false;
    for (const listener of listeners) listener(state);
  });
}

export function subscribe(listener: Listener): void {
  listeners.push(listener);
}

/** The puppet of the character that is shown, with edits that the server has not confirmed yet. */
export function shownPuppet({ character, puppets }: State): Puppet | null {
  return character === null ? null : (puppets[character]?.present ?? null);
}

/** What the server says of the character that is shown. */
export function shownCharacter({ character, server }: State) {
  return server?.characters.find((each) => each.name === character) ?? null;
}

/** Whether the machine works at a file, as at a film. */
export const isWorking = ({ server }: State): boolean => server?.jobs.some(({ state }) => state === "running") === true;

/** Whether the service was started elsewhere: its files, characters and source cannot be changed here. */
export const isJoined = ({ greeting }: State): boolean => greeting?.joined === true;
