// The connection to a Puppetline service over WebSocket (docs/protocol.md): subscriptions, requests, reconnecting.

import { FRAME_KINDS, MAJOR, WireError, decode } from "./message.js";

/** @import {Message, Json} from "./message.js" */
/** @typedef {"connecting" | "connected" | "offline" | "refused" | "closed"} State */
/** @typedef {(message: Message) => void} Listener */

const STATUS = "service/status";

/** Close code of a wrong token. */
const WRONG_TOKEN = 4401;

/** Shortest and longest pause between two attempts to connect, in milliseconds; it doubles each time. */
const MIN_RETRY_MS = 250;
const MAX_RETRY_MS = 4000;

/** Seconds without a message after which the client reconnects; a status arrives every second. */
const SILENCE_SECONDS = 6;

/** Shortest time between two requests of a topic, in milliseconds. */
const ASK_MS = 1000;

/** The service has answered a request with an error, or the connection was lost before it answered. */
export class RequestError extends Error {
  /** @param {{where: string, found: string, expected: string, fix: string}} error */
  constructor(error) {
    super(`${error.where}: found ${error.found}; expected ${error.expected}. ${error.fix}`);
    this.where = error.where;
    this.found = error.found;
    this.expected = error.expected;
    this.fix = error.fix;
  }
}

/**
 * A connection that lasts until it is closed: it reconnects and subscribes again automatically.
 *
 * Dispatches the event `state` when `state` changes.
 */
export class Client extends EventTarget {
  /** @type {State} */
  #state = "connecting";
  /** @type {WebSocket | null} */
  #socket = null;
  /** @type {Map<string, Set<Listener>>} */
  #listeners = new Map();
  /** The last message of each topic that is not of a kind of frames. @type {Map<string, Message>} */
  #latest = new Map();
  /** @type {Map<string, number>} */
  #asked = new Map();
  /** @type {Map<number, {resolve: (result: any) => void, reject: (error: Error) => void}>} */
  #requests = new Map();
  #count = 0;
  #retry = MIN_RETRY_MS;
  /** Seconds since the last message in which the page ran: while it stands still, as if hidden for long, messages wait. */
  #silent = 0;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;
  #watch;

  /**
   * @param {string} url for example `ws://127.0.0.1:7402/stream`
   * @param {{token?: string}} [options] token of the service, if it has one
   */
  constructor(url, { token } = {}) {
    super();
    this.url = url;
    this.token = token;
    /** Why the client is offline or refused. */
    this.reason = "";
    this.#watch = setInterval(() => this.#checkSilence(), 1000);
    this.subscribe(STATUS, () => {});
    this.#connect();
  }

  get state() {
    return this.#state;
  }

  /**
   * Receive the messages of a topic, such as `dog/controls`. If the last message of the topic is not a frame, it is
   * passed to a new listener too.
   *
   * @param {string} topic
   * @param {Listener} listener
   * @returns {() => void} ends the subscription
   */
  subscribe(topic, listener) {
    const listeners = this.#listeners.get(topic) ?? new Set();
    listeners.add(listener);
    const latest = this.#latest.get(topic);
    if (!this.#listeners.has(topic)) {
      this.#listeners.set(topic, listeners);
      this.#ask(topic);
    } else if (latest) {
      queueMicrotask(() => listeners.has(listener) && listener(latest));
    }
    return () => this.#unsubscribe(topic, listener);
  }

  /**
   * Request a subscribed topic again, for example a scene; at most once per second.
   *
   * @param {string} topic
   */
  ask(topic) {
    const asked = this.#asked.get(topic) ?? -Infinity;
    if (this.#listeners.has(topic) && performance.now() >= asked + ASK_MS) this.#ask(topic);
  }

  /**
   * Send a request of docs/control.md, such as `{do: "calibrate", character: "dog"}`.
   *
   * @param {{do: string, [argument: string]: string | number | boolean | null}} body
   * @returns {Promise<any>} the result
   * @throws {RequestError} the service's error, or no connection
   */
  request(body) {
    return new Promise((resolve, reject) => {
      const id = ++this.#count;
      if (this.#state !== "connected") return reject(new RequestError(this.#lost()));
      this.#requests.set(id, { resolve, reject });
      this.#send({ ...body, id });
    });
  }

  /** Connect now, even if the service has refused the token. */
  retry() {
    if (this.#state === "offline" || this.#state === "refused") this.#connect();
  }

  /** Disconnect for good. */
  close() {
    this.#drop("closed", "");
    clearInterval(this.#watch);
  }

  #connect() {
    clearTimeout(this.#timer);
    if (this.#state === "refused") this.#change("connecting", "");
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    this.#silent = 0;
    socket.onopen = () => {
      this.#send(this.token === undefined ? {} : { token: this.token });
      for (const topic of this.#listeners.keys()) this.#ask(topic);
    };
    socket.onmessage = ({ data }) => {
      this.#silent = 0;
      if (typeof data === "string") this.#takeReply(data);
      else this.#take(data);
    };
    socket.onclose = ({ code, reason }) => {
      if (code === WRONG_TOKEN) this.#drop("refused", "The service refuses the token.");
      else this.#drop("offline", reason || `No Puppetline service at ${this.url}.`);
    };
  }

  /** @param {ArrayBuffer} data */
  #take(data) {
    let message;
    try {
      message = decode(data);
    } catch (error) {
      if (!(error instanceof WireError)) throw error;
      if (new DataView(data).byteLength > 64 && new DataView(data).getUint8(64) !== MAJOR) {
        this.#drop("refused", `The service uses another version of the protocol: ${error.message}.`);
      }
      return;
    }
    this.#retry = MIN_RETRY_MS;
    this.#change("connected", "");
    const listeners = this.#listeners.get(message.topic);
    if (!listeners) return;
    if (!FRAME_KINDS.has(message.kind)) this.#latest.set(message.topic, message);
    for (const listener of [...listeners]) listener(message);
  }

  /** @param {string} text */
  #takeReply(text) {
    const reply = JSON.parse(text);
    const waiting = this.#requests.get(reply.id);
    if (!waiting) return;
    this.#requests.delete(reply.id);
    if (reply.ok) waiting.resolve(reply.result);
    else waiting.reject(new RequestError(reply.error));
  }

  /** @param {string} topic */
  #ask(topic) {
    if (this.#socket?.readyState !== WebSocket.OPEN) return;
    this.#asked.set(topic, performance.now());
    this.#send({ subscribe: topic });
  }

  /**
   * @param {string} topic
   * @param {Listener} listener
   */
  #unsubscribe(topic, listener) {
    const listeners = this.#listeners.get(topic);
    if (!listeners?.delete(listener) || listeners.size) return;
    this.#listeners.delete(topic);
    this.#latest.delete(topic);
    this.#asked.delete(topic);
    if (this.#socket?.readyState === WebSocket.OPEN) this.#send({ unsubscribe: topic });
  }

  /** @param {Json} value */
  #send(value) {
    this.#socket?.send(JSON.stringify(value));
  }

  /**
   * Forget the connection and what belongs to this run of the service; reconnect after a pause if it was lost.
   *
   * @param {State} state
   * @param {string} reason
   */
  #drop(state, reason) {
    clearTimeout(this.#timer);
    const socket = this.#socket;
    this.#socket = null;
    if (socket) {
      socket.onopen = socket.onmessage = socket.onclose = null;
      socket.close();
    }
    this.#latest.clear();
    this.#change(state, reason);
    const requests = [...this.#requests.values()];
    this.#requests.clear();
    for (const { reject } of requests) reject(new RequestError(this.#lost()));
    if (state === "offline") {
      this.#timer = setTimeout(() => this.#connect(), this.#retry);
      this.#retry = Math.min(2 * this.#retry, MAX_RETRY_MS);
    }
  }

  #checkSilence() {
    if (this.#socket && ++this.#silent > SILENCE_SECONDS) {
      this.#drop("offline", `No message from ${this.url} for ${SILENCE_SECONDS} s.`);
    }
  }

  #lost() {
    const found = this.reason || "no connection";
    return { where: this.url, found, expected: "a running service", fix: "Start it, or check its address and token." };
  }

  /**
   * @param {State} state
   * @param {string} reason
   */
  #change(state, reason) {
    this.reason = reason;
    if (state === this.#state) return;
    this.#state = state;
    this.dispatchEvent(new Event("state"));
  }
}
