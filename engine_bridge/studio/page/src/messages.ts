/** What the server sends: made from the classes of engine_bridge/studio/messages, which describe it. */

import type { Joint } from "./model/skeleton";

export type UploadKind = "character" | "log" | "puppet" | "video" | "sound" | "picture";

export type Extra = "camera" | "film" | "sound";

export type Direction = "x" | "-x" | "y" | "-y" | "z" | "-z";

export type AxisSet = "" | "x" | "y" | "z" | "xy" | "xz" | "yz" | "xyz";

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

export interface Puppet {
  readonly character: PuppetCharacter;
  readonly limb?: readonly Limb[];
  readonly handle?: readonly Handle[];
  readonly morph?: readonly Morph[];
  readonly channel?: readonly Range[];
  readonly root?: Root | null;
  readonly retarget?: Retarget;
  readonly smoothing?: Smoothing;
  readonly solver?: Solver;
  readonly vrm?: Vrm | null;
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

export interface ScreenSettings {
  readonly run: string;
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

export interface PuppetCharacter {
  readonly mesh?: string;
  readonly up?: Direction;
  readonly front?: Direction;
  readonly scale?: number;
  readonly body?: number | null;
}

export interface Limb {
  readonly name: string;
  readonly nodes?: readonly string[] | null;
  readonly points: readonly (readonly [number, number, number])[];
  readonly joints: readonly (Joint | readonly Joint[])[];
  readonly follow?: "direction" | "turn";
  readonly gain?: number;
  readonly parent?: string | null;
  readonly stands?: boolean;
  readonly delay?: number;
  readonly bend?: Bend | null;
}

export interface Handle {
  readonly name: string;
  readonly position: readonly [number, number, number];
  readonly joint?: Joint | null;
  readonly joints?: readonly Joint[] | null;
  readonly axes?: AxisSet;
  readonly gain?: number;
  readonly channel?: string | null;
  readonly moves?: readonly [number, number, number];
}

export interface Morph {
  readonly target: string;
  readonly channel: string;
  readonly gain?: number;
}

export interface Range {
  readonly name: string;
  readonly neutral?: number;
  readonly full?: number;
}

export interface Root {
  readonly joint?: Joint;
  readonly axes?: AxisSet;
  readonly turns?: boolean;
  readonly feet?: "lock" | "free";
  readonly walk?: "in place" | "forward";
}

export interface Retarget {
  readonly mirror?: boolean;
  readonly scale?: "auto" | number;
  readonly arm_space?: number;
  readonly hands_meet?: boolean;
}

export interface Smoothing {
  readonly alpha?: number;
  readonly gamma?: number;
  readonly jitter_radius?: number;
  readonly max_deviation?: number | null;
  readonly prediction?: number;
}

export interface Solver {
  readonly fields?: number;
  readonly isolines?: number;
  readonly iterations?: number;
  readonly rotations?: "clusters" | "covariance" | null;
}

export interface Vrm {
  readonly name: string;
  readonly authors: readonly string[];
  readonly licence: string;
  readonly version?: string | null;
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

export interface FilmTake {
  readonly start: number;
  readonly stop: number | null;
  readonly character: string;
  readonly file: string;
  readonly user?: number | null;
  readonly at: number | null;
  readonly loop?: number;
  readonly fade?: number;
  readonly position?: readonly [number, number] | null;
  readonly turn?: number | null;
  readonly sound?: boolean;
  readonly mute: boolean;
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

export interface TimelineTake {
  readonly character: string;
  readonly take: string;
  readonly at: number;
  readonly seconds: number;
  readonly sound: TimelineSound | null;
}

export interface Bend {
  readonly channel: string;
  readonly degrees: number;
  readonly axis?: Direction;
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

export interface FilmFormat {
  readonly size?: readonly [number, number];
  readonly fps?: number;
  readonly seconds?: number | null;
  readonly fade_in?: number;
  readonly fade_out?: number;
}

export interface FilmSound {
  readonly start?: number;
  readonly stop?: number | null;
  readonly file: string;
  readonly at?: number;
  readonly gain?: number;
  readonly fade_in?: number;
  readonly fade_out?: number;
  readonly mute?: boolean;
}

export interface FilmMusic {
  readonly loop?: "cheerful" | "calm" | "waltz" | "adventure" | "suspense" | null;
  readonly file?: string | null;
  readonly gain?: number;
  readonly fade_in?: number;
  readonly fade_out?: number;
}

export interface FilmCamera {
  readonly at?: number;
  readonly shot?: "wide" | "close" | "follow" | "over the shoulder";
  readonly show?: readonly string[];
  readonly behind?: string | null;
  readonly azimuth?: number | null;
  readonly elevation?: number;
  readonly field_of_view?: number;
  readonly zoom?: number;
  readonly fade?: number;
}

export interface FilmBackground {
  readonly set?: "studio" | "meadow" | "forest" | "beach" | "desert" | "snow" | "castle" | "city" | "night" | "stage" | "space" | "underwater" | null;
  readonly color?: string | null;
  readonly colors?: readonly [string, string] | null;
  readonly picture?: string | null;
}

export interface FilmFloor {
  readonly show?: boolean;
  readonly color?: string | null;
}

export interface FilmLight {
  readonly mood?: "day" | "evening" | "night" | "overcast" | "spotlight" | "water" | null;
}

export interface FilmTitle {
  readonly at?: number;
  readonly seconds?: number;
  readonly size?: number;
  readonly font?: string;
  readonly text: string;
  readonly place?: "top" | "middle" | "bottom";
  readonly color?: string;
  readonly fade?: number;
}

export interface FilmBubble {
  readonly at?: number;
  readonly seconds?: number;
  readonly size?: number;
  readonly font?: string;
  readonly character: string;
  readonly text?: string | null;
  readonly kind?: "speech" | "thought" | "name";
}

export interface FilmCharacter {
  readonly name: string;
  readonly puppet: string;
  readonly position?: readonly [number, number] | null;
  readonly turn?: number;
  readonly height?: number | null;
  readonly color?: string | null;
}

export interface TimelineSound {
  readonly file: string;
  readonly at: number;
}
