// A buffer of received frames, from which each refresh of the display gets an interpolated pose.
//
// Frames arrive at irregular times, and at another rate than the display's. They are therefore shown with a delay,
// interpolated by the source's times. If no frames arrive, the last one stays.

/** @import {Message} from "./message.js" */

/** Maximum number of frames in the buffer. */
const MAX_FRAMES = 256;

/** Maximum time between two frames of one motion, in seconds of the source's clock. */
const MAX_GAP = 0.5;

/** Period in which the frame with the shortest transmission time defines the offset of the source's clock, in seconds. */
const WINDOW = 1.0;

/** Maximum relative change of the playback speed that corrects clock drift. */
const MAX_RATE_CHANGE = 0.05;

/** Maximum drift that the speed corrects, in seconds; playback skips larger differences. */
const MAX_GRADUAL_DRIFT = 0.25;

export class JitterBuffer {
  /** @type {Message[]} */
  #frames = [];
  /** Local clock minus source's clock, as used for playback. */
  #lag = 0;
  /** Smallest lags of this window and of the one before. */
  #smallest = [Infinity, Infinity];
  #windowEnd = -Infinity;
  #advanced = 0;

  /** @param {number} [delay] time by which the shown pose lags behind the received frames, in seconds */
  constructor(delay = 0.05) {
    this.delay = delay;
    /** The shown time, in seconds of the source's clock. */
    this.time = 0;
    /** The frames before and after the shown time; null before the first. @type {Message | null} */
    this.earlier = null;
    /** @type {Message | null} */
    this.later = null;
    /** Position of the shown time between `earlier` (0) and `later` (1). */
    this.share = 0;
    /** Number of frames that were lost in transmission, from gaps in their numbers. */
    this.lost = 0;
  }

  /**
   * Add a frame.
   *
   * @param {Message} frame
   * @param {number} now time of its arrival, in seconds of the local clock
   */
  push(frame, now) {
    const last = this.#frames.at(-1);
    const { time, sequence } = frame.header;
    const elapsed = last ? time - last.header.time : 0;
    if (last && !(sequence > last.header.sequence && elapsed > 0 && elapsed <= MAX_GAP)) this.clear();
    const before = this.#frames.at(-1);
    if (before) {
      this.lost += sequence - before.header.sequence - 1;
    } else {
      this.#lag = now - time;
      this.#advanced = now;
    }
    this.#frames.push(frame);
    if (this.#frames.length > MAX_FRAMES) this.#frames.shift();
    if (now >= this.#windowEnd) {
      this.#smallest = [Infinity, this.#smallest[0]];
      this.#windowEnd = now + WINDOW;
    }
    this.#smallest[0] = Math.min(this.#smallest[0], now - time);
  }

  /**
   * Determine the frames to show; return false before the first.
   *
   * @param {number} now seconds of the local clock
   */
  advance(now) {
    if (!this.#frames.length) return this.earlier !== null;
    this.#adjustLag(now);
    const shown = now - this.#lag - this.delay;
    this.time = shown;
    while (this.#frames.length > 1 && this.#frames[1].header.time <= shown) this.#frames.shift();
    const earlier = this.#frames[0];
    const later = this.#frames[1] ?? earlier;
    const span = later.header.time - earlier.header.time;
    this.earlier = earlier;
    this.later = later;
    this.share = span > 0 ? Math.min(Math.max((shown - earlier.header.time) / span, 0), 1) : 0;
    return true;
  }

  /** Remove all frames; the shown ones stay in `earlier` and `later`. */
  clear() {
    this.#frames.length = 0;
    this.#smallest = [Infinity, Infinity];
    this.#windowEnd = -Infinity;
  }

  /** @param {number} now */
  #adjustLag(now) {
    const difference = Math.min(...this.#smallest) - this.#lag;
    const step = MAX_RATE_CHANGE * (now - this.#advanced);
    const isSkipped = Math.abs(difference) > MAX_GRADUAL_DRIFT;
    this.#lag += isSkipped ? difference : Math.min(Math.max(difference, -step), step);
    this.#advanced = now;
  }
}
