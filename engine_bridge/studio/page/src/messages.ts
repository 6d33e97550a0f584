/** What the studio's server sends and accepts; engine_bridge/studio/messages describes every key. */

import type { Puppet } from "./model/puppet";

export interface CharacterState {
  readonly name: string;
  readonly title: string;
  readonly stage: string;
  readonly limbs: readonly string[];
  readonly handles: readonly string[];
  /** Names of the morph targets that the mesh has. */
  readonly targets: readonly string[];
  readonly vertices: number;
  readonly triangles: number;
  /** Changes with every edit. */
  readonly version: string;
  readonly saved: boolean;
  readonly model: string;
  readonly notes: readonly string[];
  readonly performer: number | null;
  readonly state: string;
  readonly mirror: boolean;
  readonly rate: number;
}

export interface SourceState {
  readonly uri: string;
  readonly kind: "none" | "example" | "upload" | "take" | "live";
  readonly name: string;
  readonly text: string;
  readonly loop: boolean;
  readonly start: number | null;
  readonly stop: number | null;
}

export interface PerformerState {
  readonly user: number;
  readonly stage: string;
  readonly state: string;
  readonly character: string | null;
  readonly distance: number;
  readonly height: number | null;
}

export interface ServiceState {
  readonly running: boolean;
  readonly starting: boolean;
  readonly restarts: number;
  readonly problem: string;
}

export type UploadKind = "character" | "log" | "puppet";

export interface UploadState {
  readonly upload: string;
  readonly name: string;
  readonly kind: UploadKind;
  readonly bytes: number;
}

export interface TakeState {
  readonly name: string;
  readonly seconds: number | null;
  /** Id of its pictures side by side; empty until they are drawn. */
  readonly picture: string;
  /** Id of the wave form of its sound; empty without sound. */
  readonly wave: string;
  /** Id of its sound; empty without one. */
  readonly sound_file: string;
}

/** A take in the film; docs/film.md describes all keys, which the page gives back as they are. */
export interface FilmTake {
  readonly character: string;
  readonly file: string;
  readonly at: number | null;
  readonly start: number;
  readonly stop: number | null;
  readonly mute: boolean;
}

export interface FilmState {
  readonly takes: readonly FilmTake[];
  readonly problem: string;
}

/** A take that plays on a character, with the second of the timeline of its sound's first sample. */
export interface TimelineTake {
  readonly character: string;
  readonly take: string;
  readonly at: number;
  readonly seconds: number;
  readonly sound: { readonly at: number } | null;
}

export interface Timeline {
  readonly position: number;
  /** Time of `position`, in seconds of the service's monotonic clock. */
  readonly moment: number;
  readonly start: number;
  readonly end: number;
  readonly speed: number;
  readonly paused: boolean;
  readonly loop: boolean;
  readonly takes: readonly TimelineTake[];
}

/** A video of a kiosk's visitor; null while it is made. */
export interface ClipState {
  readonly code: string;
  readonly minutes: number | null;
}

export interface FilmReply {
  readonly file: string;
  readonly name: string;
  readonly seconds: number;
  readonly notes: readonly string[];
}

export type Extra = "camera" | "film" | "sound";

export interface JobState {
  readonly job: string;
  readonly title: string;
  readonly text: string;
  readonly fraction: number;
  readonly state: "running" | "done" | "failed" | "cancelled";
}

export interface StatusState {
  readonly fps: number;
  readonly latency_ms: number | null;
  readonly clients: number;
  readonly drops: number;
}

export interface Banner {
  readonly level: "none" | "info" | "warning" | "error";
  readonly text: string;
  readonly fix: string;
}

export interface ServerState {
  readonly characters: readonly CharacterState[];
  readonly source: SourceState;
  readonly service: ServiceState;
  readonly performers: readonly PerformerState[];
  readonly recording: string | null;
  readonly takes: readonly TakeState[];
  readonly film: FilmState;
  readonly installed: readonly string[];
  /** Whether the sound is recorded with takes. */
  readonly microphone: boolean;
  readonly timeline: Timeline | null;
  readonly clips: readonly ClipState[];
  readonly uploads: readonly UploadState[];
  readonly jobs: readonly JobState[];
  readonly status: StatusState;
  readonly banner: Banner;
}

export interface Greeting {
  readonly session: string;
  readonly version: string;
  readonly forms: readonly string[];
  readonly suffixes: Readonly<Record<UploadKind, readonly string[]>>;
  readonly limits: { readonly upload_bytes: number; readonly uploads: number };
  readonly joined: boolean;
}

export interface Device {
  readonly name: string;
  readonly ok: boolean | null;
  readonly detail: string;
  readonly fix: string;
  readonly uri: string;
}

export interface Port {
  readonly uri: string;
  readonly text: string;
  readonly arriving: number;
  readonly rate: number;
  readonly refused: Readonly<Record<string, number>>;
  readonly problem: string;
}

export interface Sources {
  readonly characters: readonly string[];
  readonly examples: readonly string[];
  readonly devices: readonly Device[];
  readonly ports: readonly Port[];
}

export interface SeenPerformer {
  readonly user: number;
  readonly text: string;
  /** Positions of the 20 joints, as shares of the image's width and height. */
  readonly joints: readonly (readonly [number, number] | null)[] | null;
}

export interface LookReply {
  /** JPEG in base64; empty for a source without images. */
  readonly picture: string;
  readonly width: number;
  readonly height: number;
  readonly problems: readonly Banner[];
  readonly performers: readonly SeenPerformer[];
}

export interface SmoothingReply {
  readonly times: readonly number[];
  readonly measured: readonly number[];
  readonly smoothed: readonly number[];
  readonly measured_mm: number;
  readonly jitter_mm: number;
  readonly lag_ms: number | null;
  readonly rise_ms: number | null;
  readonly overshoot_mm: number | null;
}

export interface PuppetReply {
  readonly character: string;
  readonly puppet: Puppet;
  readonly saved: boolean;
  /** The body plan that the limbs follow; null if they follow none. */
  readonly plan: string | null;
}

export interface ExportReply {
  readonly job: string;
  readonly file: string;
  readonly name: string;
  readonly text: string;
}

export interface UploadReply {
  readonly upload: string;
  readonly kind: UploadKind;
  readonly name: string;
}

export interface ServerError {
  readonly where: string;
  readonly found: string;
  readonly expected: string;
  readonly fix: string;
}
