// One character of a service: its scene, its frames that belong to this scene, and who performs it.

/** @import {Client} from "./client.js" */
/** @import {Message, Scene} from "./message.js" */

/**
 * Follows a character, also when it is reloaded and when the service restarts.
 *
 * Dispatches the events `scene` (a new scene has arrived) and `frame` (`frame` is new; it belongs to the scene).
 */
export class Character extends EventTarget {
  /** @type {(() => void)[]} */
  #ends = [];
  /** @type {(() => void) | null} */
  #endFrames = null;
  /** @type {string} */
  #frameTopic;
  /** @type {string} */
  #sceneTopic;
  #sequence = -1;

  /**
   * @param {Client} client
   * @param {string} name
   * @param {"controls" | "vertices" | "vertices16" | "morphs" | "bones"} [kind] of the frames
   */
  constructor(client, name, kind = "controls") {
    super();
    this.client = client;
    this.name = name;
    /** @type {Scene | null} */
    this.scene = null;
    /** @type {Message | null} */
    this.frame = null;
    // under a topic of its own, only this client receives the scene
    this.#sceneTopic = `${name}/scene/${Math.random().toString(36).slice(2, 14)}`;
    this.#ends.push(client.subscribe(this.#sceneTopic, (message) => this.#takeScene(message)));
    this.#frameTopic = `${name}/${kind}`;
    this.resume();
    this.#ends.push(
      client.subscribe("service/characters", ({ kind, body }) => {
        const isListed = kind === "characters" && body.some((each) => each.name === name);
        if (isListed && !this.scene) client.ask(this.#sceneTopic); // a request for a character that was missing is not kept
      }),
    );
  }

  /** Receive no frames for a while; the scene and the last frame stay. */
  pause() {
    this.#endFrames?.();
    this.#endFrames = null;
  }

  /** Receive frames again. */
  resume() {
    this.#endFrames ??= this.client.subscribe(this.#frameTopic, (message) => this.#takeFrame(message));
  }

  /** Stop following. */
  close() {
    this.pause();
    for (const end of this.#ends) end();
    this.#ends = [];
  }

  /** @param {Message} message */
  #takeScene({ kind, body }) {
    if (kind !== "scene") return;
    const known = this.scene !== null && isSame(this.scene, body);
    this.scene = body;
    if (known) return; // only its description may have changed
    this.frame = null;
    this.dispatchEvent(new Event("scene"));
  }

  /** @param {Message} message */
  #takeFrame(message) {
    const { revision, sequence } = message.header;
    const restarted = sequence <= this.#sequence;
    this.#sequence = sequence;
    if (!this.scene || revision !== this.scene.description.revision || restarted) this.client.ask(this.#sceneTopic);
    if (!this.scene || revision !== this.scene.description.revision) return;
    this.frame = message;
    this.dispatchEvent(new Event("frame"));
  }
}

/**
 * Tell whether two scenes are drawn alike. Revisions of two runs of a service are not comparable.
 *
 * @param {Scene} one
 * @param {Scene} other
 */
function isSame(one, other) {
  const names = /** @type {const} */ (["triangles", "positions", "coordinates", "slopes"]);
  return (
    one.description.revision === other.description.revision &&
    names.every((name) => {
      const [a, b] = [one[name], other[name]];
      return a.length === b.length && a.every((/** @type {number} */ value, /** @type {number} */ i) => value === b[i]);
    })
  );
}
