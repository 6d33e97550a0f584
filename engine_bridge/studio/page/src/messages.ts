/** What the server sends, made from the classes of engine_bridge/studio/messages. */

import type { FilmBackground, FilmBubble, FilmCamera, FilmCharacter, FilmFloor, FilmFormat, FilmLight, FilmMusic, FilmSound, FilmTake, FilmTitle, Puppet } from "./tables";

export type * from "./tables";

export type UploadKind = "character" | "log" | "puppet" | "video" | "sound" | "picture";

export type Extra = "camera" | "film" | "sound";

export interface Greeting {
  readonly session: string;
  readonly version: string;
  readonly joints: readonly string[];
  readonly parents: Readonly<Record<string, string>>;
  readonly forms: readonly string[];
  readonly suffixes: Readonly<Record<string, readonly string[]>>;
  readonly limits: Readonly<Record<string, number>>;
  readonly joined: boolean;
}

export interface ServerState {
  readonly characters: readonly CharacterState[];
  readonly source: SourceState;
  readonly stages: readonly StageState[];
  readonly service: ServiceState;
  readonly performers: readonly PerformerState[];
  readonly recording: string | null;
  readonly takes: readonly TakeState[];
  readonly film: FilmState;
  readonly installed: readonly string[];
  readonly microphone: boolean;
  readonly timeline: Timeline | null;
  readonly uploads: readonly UploadState[];
  readonly files: readonly FileState[];
  readonly jobs: readonly JobState[];
  readonly status: StatusState;
  readonly banner: Banner;
}

export interface ServerError {
  readonly where: string;
  readonly found: string;
  readonly expected: string;
  readonly fix: string;
}

export interface Sources {
  readonly characters: readonly string[];
  readonly examples: readonly string[];
  readonly devices: readonly Device[];
  readonly ports: readonly Port[];
}

export interface LookReply {
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
  readonly plan: "upright" | "two legs" | "four legs" | "many legs" | "wings" | "no legs" | null;
}

export interface UploadReply {
  readonly upload: string;
  readonly kind: UploadKind;
  readonly name: string;
  readonly facts: Readonly<Record<string, unknown>>;
  readonly file: string;
}

export interface ExportReply {
  readonly file: string;
  readonly name: string;
  readonly numbers: Readonly<Record<string, unknown>>;
  readonly text: string;
}

export interface FilmReply {
  readonly file: string;
  readonly name: string;
  readonly seconds: number;
  readonly notes: readonly string[];
}

export interface FilmPlan {
  readonly size: readonly [number, number];
  readonly step: number;
  readonly bubbles: readonly BubbleShape[];
  readonly moments: readonly Moment[];
}

export interface ShareReply {
  readonly address: string;
  readonly code: string;
  readonly poster: string;
  readonly poster_name: string;
}

export interface ScreenSettings {
  readonly version: string;
  readonly models: readonly string[];
  readonly kiosk: KioskScreen | null;
}

export interface ServiceReport {
  readonly service: ServiceStatus;
  readonly stages: readonly StageStatus[];
  readonly characters: readonly CharacterStatus[];
  readonly clients: ClientsStatus;
  readonly outputs: readonly OutputStatus[];
  readonly timeline: Timeline | null;
  readonly clips: readonly ClipStatus[];
}

export interface CharacterState {
  readonly name: string;
  readonly title: string;
  readonly stage: string;
  readonly limbs: readonly string[];
  readonly handles: readonly string[];
  readonly targets: readonly string[];
  readonly vertices: number;
  readonly triangles: number;
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

export interface StageState {
  readonly name: string;
  readonly source: string;
  readonly rate: number;
  readonly refused: Readonly<Record<string, number>>;
  readonly recording: string | null;
  readonly count_in: number;
}

export interface ServiceState {
  readonly running: boolean;
  readonly starting: boolean;
  readonly address: string;
  readonly restarts: number;
  readonly problem: string;
  readonly text: string;
}

export interface PerformerState {
  readonly user: number;
  readonly stage: string;
  readonly state: string;
  readonly character: string | null;
  readonly distance: number;
  readonly height: number | null;
}

export interface TakeState {
  readonly name: string;
  readonly seconds: number | null;
  readonly frames: number;
  readonly bytes: number;
  readonly written: number;
  readonly at: number | null;
  readonly parts: readonly string[];
  readonly picture: string;
  readonly wave: string;
  readonly sound: boolean;
  readonly sound_file: string;
}

export interface FilmState {
  readonly takes: readonly FilmTake[];
  readonly scene: FilmScene;
  readonly light: Lighting;
  readonly problem: string;
}

export interface Timeline {
  readonly position: number;
  readonly moment: number;
  readonly start: number;
  readonly end: number;
  readonly speed: number;
  readonly paused: boolean;
  readonly loop: boolean;
  readonly takes: readonly TimelineTake[];
}

export interface UploadState {
  readonly upload: string;
  readonly name: string;
  readonly kind: UploadKind;
  readonly bytes: number;
  readonly facts: Readonly<Record<string, unknown>>;
}

export interface FileState {
  readonly file: string;
  readonly name: string;
  readonly bytes: number;
  readonly kind: "export" | "puppet" | "take";
}

export interface JobState {
  readonly job: string;
  readonly title: string;
  readonly text: string;
  readonly fraction: number;
  readonly state: "running" | "done" | "failed" | "cancelled";
  readonly result: Readonly<Record<string, unknown>> | null;
  readonly error: Readonly<Record<string, string>> | null;
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

export interface SeenPerformer {
  readonly user: number;
  readonly text: string;
  readonly joints: readonly (readonly [number, number] | null)[] | null;
}

export interface BubbleShape {
  readonly kind: "speech" | "thought" | "name";
  readonly lines: readonly (readonly [string, number])[];
  readonly letter: number;
  readonly half: readonly [number, number];
}

export interface Moment {
  readonly brightness: number;
  readonly titles: readonly number[];
  readonly views: readonly ShownView[];
  readonly places: Readonly<Record<string, readonly [number, number, number, number]>>;
}

export interface KioskScreen {
  readonly title: string;
  readonly files: readonly string[];
  readonly background: string;
  readonly color: string;
  readonly accent: string;
  readonly languages: readonly string[];
  readonly texts: Readonly<Record<string, Readonly<Record<string, string>>>>;
  readonly minutes: number;
  readonly longest: number;
  readonly phones: string | null;
}

export interface ServiceStatus {
  readonly version: string;
  readonly uptime: number;
  readonly pid: number;
  readonly memory: number;
  readonly cpu: number;
}

export interface StageStatus {
  readonly name: string;
  readonly source: string;
  readonly frames: number;
  readonly rate: number;
  readonly dropped: number;
  readonly refused: Readonly<Record<string, number>>;
  readonly faults: number;
  readonly latency_ms: LatencyStatus;
  readonly users: readonly UserStatus[];
  readonly sensor: SensorStatus;
  readonly recording: string | null;
  readonly count_in: number;
}

export interface CharacterStatus {
  readonly name: string;
  readonly stage: string;
  readonly performer: number | null;
  readonly state: string;
  readonly frames: number;
  readonly rate: number;
  readonly residual: number | null;
  readonly limited: number;
}

export interface ClientsStatus {
  readonly connected: number;
  readonly refused: number;
  readonly limit: number;
}

export interface OutputStatus {
  readonly wire: string;
  readonly target: string;
  readonly sent: number;
  readonly bytes: number;
  readonly skipped: number | null;
  readonly failed: number;
  readonly clients: number | null;
  readonly refused: number;
}

export interface ClipStatus {
  readonly code: string;
  readonly seconds_left: number | null;
}

export interface FilmScene {
  readonly film: FilmFormat;
  readonly sound: readonly FilmSound[];
  readonly music: FilmMusic;
  readonly camera: readonly FilmCamera[];
  readonly background: FilmBackground;
  readonly floor: FilmFloor;
  readonly light: FilmLight;
  readonly title: readonly FilmTitle[];
  readonly bubble: readonly FilmBubble[];
  readonly character: readonly FilmCharacter[];
}

export interface Lighting {
  readonly key: readonly [number, number, number];
  readonly sky: readonly [number, number, number];
  readonly ground: readonly [number, number, number];
  readonly direction: readonly [number, number, number];
}

export interface TimelineTake {
  readonly character: string;
  readonly take: string;
  readonly at: number;
  readonly seconds: number;
  readonly sound: TimelineSound | null;
}

export interface ShownView {
  readonly shot: number;
  readonly share: number;
  readonly eye: readonly [number, number, number];
  readonly target: readonly [number, number, number];
  readonly field_of_view: number;
  readonly bubbles: readonly ShownBubble[];
}

export interface LatencyStatus {
  readonly p50: number | null;
  readonly p95: number | null;
  readonly p99: number | null;
  readonly max: number | null;
}

export interface UserStatus {
  readonly user: number;
  readonly state: string;
  readonly character: string | null;
  readonly seen: number;
  readonly distance: number;
  readonly height: number | null;
  readonly reach: number | null;
}

export interface SensorStatus {
  readonly tilt: number;
  readonly height: number;
  readonly roll: number;
}

export interface TimelineSound {
  readonly file: string;
  readonly at: number;
}

export interface ShownBubble {
  readonly number: number;
  readonly opacity: number;
  readonly middle: readonly [number, number];
  readonly tip: readonly [number, number];
}
