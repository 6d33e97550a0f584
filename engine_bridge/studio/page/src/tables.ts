/** Tables of puppet and scene files, made from the classes of engine_bridge. */

import type { Joint } from "./model/skeleton";

export type Direction = "x" | "-x" | "y" | "-y" | "z" | "-z";

export type AxisSet = "" | "x" | "y" | "z" | "xy" | "xz" | "yz" | "xyz";

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

export interface PuppetCharacter {
  readonly mesh?: string;
  readonly up?: Direction;
  readonly front?: Direction;
  readonly turn?: number;
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

export interface Bend {
  readonly channel: string;
  readonly degrees: number;
  readonly axis?: Direction;
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
