/** The connection to the studio's server: requests with replies, pushed events, uploads and downloads. */

import type { Greeting, ServerError, ServerState, UploadReply } from "./messages";
import { remember, remembered } from "./storage";

export const RETRY_MILLISECONDS = 1000;
const SESSION = "puppetline.session";

/** Raised with the server's words when it refuses a request. */
export class Refusal extends Error {
  constructor(readonly reason: ServerError) {
    super(sentence(reason));
  }
}

/** What was found and how to fix it, as sentences. */
export function sentence({ where, found, expected, fix }: ServerError): string {
  const fact = expected === "" ? found : `found ${found}; expected ${expected}`;
  return `${where === "" ? "" : `${where}: `}${fact}.${fix === "" ? "" : ` ${fix}`}`;
}

export interface Events {
  opened: (greeting: Greeting) => void;
  state: (state: ServerState) => void;
  progress: (job: string, text: string, fraction: number) => void;
  lost: () => void;
  refused: (reason: string) => void;
}

type Message =
  | { hello: Greeting }
  | { event: "state"; state: ServerState }
  | { event: "progress"; job: string; text: string; fraction: number }
  | { id: number; ok: true; result: unknown }
  | { id: number | null; ok: false; error: ServerError };

interface Waiting {
  resolve: (result: unknown) => void;
  reject: (reason: Error) => void;
}

export class Connection {
  private socket: WebSocket | null = null;
  private next = 1;
  private readonly waiting = new Map<number, Waiting>();

  /** The token of this browser tab: the session's, the one-time token of the address, or that of a kiosk's screen. */
  get token(): string {
    const inAddress = new URLSearchParams(location.hash.slice(1)).get("token");
    return sessionStorage.getItem(SESSION) ?? inAddress ?? remembered(SESSION) ?? "";
  }

  /** Connect, and connect again when the connection is lost. */
  open(events: Events): void {
    const socket = new WebSocket(address("/api"));
    this.socket = socket;
    let greeted = false;
    socket.onopen = () => {
      socket.send(JSON.stringify({ token: this.token }));
    };
    socket.onmessage = ({ data }: MessageEvent<string>) => {
      const message = JSON.parse(data) as Message;
      if ("hello" in message) {
        greeted = true;
        sessionStorage.setItem(SESSION, message.hello.session);
        // The screen of a service that runs by itself opens again after a restart of the browser.
        if (message.hello.joined) remember(SESSION, message.hello.session);
        history.replaceState(null, "", location.pathname);
        events.opened(message.hello);
      } else this.receive(message, events);
    };
    socket.onclose = ({ code, reason }) => {
      for (const { reject } of this.waiting.values()) reject(new Error(reason));
      this.waiting.clear();
      if (!greeted && code >= 4000) {
        if (sessionStorage.getItem(SESSION) !== null && location.hash.includes("token=")) {
          sessionStorage.removeItem(SESSION); // the server has restarted, and the address has its new token
          this.open(events);
          return;
        }
        events.refused(reason);
        return;
      }
      events.lost();
      setTimeout(() => {
        this.open(events);
      }, RETRY_MILLISECONDS);
    };
  }

  /** Send a request and return its result. */
  async request<T>(what: string, values: object = {}): Promise<T> {
    const { socket } = this;
    if (socket?.readyState !== WebSocket.OPEN) throw new Error("");
    const id = this.next++;
    const reply = new Promise<unknown>((resolve, reject) => {
      this.waiting.set(id, { resolve, reject });
    });
    socket.send(JSON.stringify({ id, do: what, ...values }));
    return (await reply) as T;
  }

  async upload(file: File): Promise<UploadReply> {
    const reply = await fetch(`/uploads?name=${encodeURIComponent(file.name)}`, {
      method: "POST",
      body: file,
      headers: { authorization: `Bearer ${this.token}` },
    });
    return (await accepted(reply)).json() as Promise<UploadReply>;
  }

  async download(id: string): Promise<Blob> {
    const reply = await fetch(`/files/${encodeURIComponent(id)}`, { headers: { authorization: `Bearer ${this.token}` } });
    return (await accepted(reply)).blob();
  }

  private receive(message: Exclude<Message, { hello: unknown }>, events: Events): void {
    if ("event" in message) {
      if (message.event === "state") events.state(message.state);
      else events.progress(message.job, message.text, message.fraction);
      return;
    }
    const waiting = message.id === null ? undefined : this.waiting.get(message.id);
    if (waiting === undefined || message.id === null) return;
    this.waiting.delete(message.id);
    if (message.ok) waiting.resolve(message.result);
    else waiting.reject(new Refusal(message.error));
  }
}

/** The address of a WebSocket of this page's own server. */
export function address(path: string): string {
  return `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${path}`;
}

async function accepted(reply: Response): Promise<Response> {
  if (reply.ok) return reply;
  const { error } = (await reply.json().catch(() => ({ error: null }))) as { error: ServerError | null };
  throw error === null ? new Error(`${reply.status} ${reply.statusText}`) : new Refusal(error);
}
