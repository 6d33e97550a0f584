/** The page: joins the state, the stream, the 3D view and the panels. */

import { connect, download, edit, openFiles, pickPart, record, redo, removeSelected, sampled, save, select, sessionToken, undo } from "./actions";
import { Client } from "../../../../integrations/web/puppetline.js";
import { address } from "./connection";
import { draw, h } from "./dom";
import { play, position } from "./film";
import { JAW, addHandle, addJaw, freeName, handlesOf, jawPoint } from "./model/puppet";
import { banner } from "./panels/banner";
import { empty } from "./panels/empty";
import { covers } from "./panels/film";
import { figure } from "./panels/figure";
import { header } from "./panels/header";
import { meters } from "./panels/meters";
import { performer } from "./panels/performer";
import { status } from "./panels/status";
import { movePlayhead, strip } from "./panels/strip";
import { tabs } from "./panels/tabs";
import { finishLimb, toolHint, toolbar } from "./panels/toolbar";
import { playSounds } from "./sound";
import { type State, current, shownPuppet, subscribe, update } from "./store";
import { strings } from "./strings";
import { Viewer } from "./viewer/viewer";

const root = document.body;

const place = document.createElement("div");
place.className = "viewer";

const viewer = new Viewer(place, {
  download,
  arrived: () => {
    render(current());
  },
  picked: (part) => {
    if (part === null) select(null);
    else pickPart(part);
  },
  moved: edit,
  resting: () => {
    if (!current().atRest) update({ atRest: true });
  },
  placed: (inside, surface) => {
    const { tool, drawn, character } = current();
    const puppet = shownPuppet(current());
    if (puppet === null) return;
    if (tool === "limb") {
      update({ drawn: [...drawn, inside] });
      return;
    }
    if (tool === "jaw") {
      const bounds = character === null ? null : viewer.bounds(character);
      const point = bounds === null ? inside : jawPoint(puppet, bounds, inside, surface);
      const [hinge] = drawn;
      if (hinge === undefined) {
        update({ drawn: [point] });
        return;
      }
      edit(addJaw(puppet, hinge, point));
      select({ kind: "limb", name: JAW });
      update({ tool: "select", drawn: [] });
      return;
    }
    const name = freeName(strings.limbs.newHandle, handlesOf(puppet).map((handle) => handle.name));
    edit(addHandle(puppet, name, surface));
    select({ kind: "handle", name });
    update({ tool: "select" });
  },
});

let joints: Float32Array | null = null;
let channels: Readonly<Record<string, number>> = {};
let jointsOf: string | null = null;
let unfollow: (() => void)[] = [];
let client: Client | null = null;

/** Receive the stream; a new session of the server has a new token. */
function follow({ connected, server, character }: State): void {
  if (connected !== "open" || server === null) return;
  if (client?.token !== sessionToken()) {
    client?.close();
    client = new Client(address("/stream"), { token: sessionToken() });
    viewer.follow(client, []);
    jointsOf = null;
  }
  viewer.follow(client, server.characters);
  if (character === jointsOf) return;
  for (const end of unfollow) end();
  [joints, channels, jointsOf, unfollow] = [null, {}, character, []];
  if (character === null) return;
  unfollow = [
    client.subscribe(`${character}/joints`, (message) => {
      if (message.kind !== "joints") return;
      joints = message.body;
      scheduleFigure();
    }),
    client.subscribe(`${character}/channels`, (message) => {
      if (message.kind !== "channels") return;
      channels = message.body;
      clearTimeout(silence);
      silence = setTimeout(() => {
        channels = {};
        scheduleFigure();
      }, SILENCE_MS);
      sampled(performance.now(), channels);
      scheduleFigure();
    }),
  ];
}

/** Time without a value after which meters show 0, in milliseconds. */
const SILENCE_MS = 1000;

let silence: ReturnType<typeof setTimeout> | undefined;

let figureScheduled = false;

/** The figure and the meters move with the performer, at most once per drawn frame. */
function scheduleFigure(): void {
  if (figureScheduled) return;
  figureScheduled = true;
  requestAnimationFrame(() => {
    figureScheduled = false;
    drawFigure(current());
  });
}

let timeScheduled = false;

/** The playhead moves while takes play. */
function scheduleTime(): void {
  const { server } = current();
  movePlayhead(current(), position(current()));
  playSounds(current(), (character, now) => viewer.serviceTime(character, now));
  if (timeScheduled || server?.timeline == null || server.timeline.paused) return;
  timeScheduled = true;
  requestAnimationFrame(() => {
    timeScheduled = false;
    scheduleTime();
  });
}

function drawFigure(state: State): void {
  const box = document.querySelector(".figure-box");
  if (box === null) return;
  draw(box, [
    figure(state, joints, (joint) => {
      viewer.emphasise(joint);
    }),
  ]);
  const others = document.querySelector(".meters-box");
  if (others !== null) draw(others, [meters(state, channels)]);
}

function render(state: State): void {
  const words = strings.viewer;
  const { character, server } = state;
  const started = server !== null && server.characters.length > 0 && character !== null && !state.adding;
  draw(root, [
    header(state),
    banner(state),
    started
      ? h(
          "main",
          { class: `studio ${state.drawer === null ? "" : `with-${state.drawer}`}`, key: "studio" },
          performer(state),
          h(
            "div",
            { class: "middle" },
            h("h1", { class: "hidden" }, `${strings.title}: ${character}`),
            h("div", { class: "place", key: "place", raw: true }),
            toolbar(state, () => {
              viewer.fit();
            }),
            toolHint(state),
            !viewer.has(character) && h("p", { class: "preparing", key: "preparing" }, words.preparing(character)),
          ),
          tabs(state, viewer.bounds(character)),
          strip(state),
        )
      : empty(state),
    status(state, viewer.drawnPerSecond),
    covers(state),
    state.dropping && h("div", { class: "dropping", key: "dropping" }, h("p", {}, strings.empty.drop), h("p", { class: "small" }, strings.empty.dropHint)),
  ]);
  drawFigure(state);
  scheduleTime();
  const slot = document.querySelector(".place");
  if (slot !== null && place.parentElement !== slot) slot.append(place);
  if (character !== null) viewer.label(words.label(character));
  viewer.refresh(state);
}

async function toggleRecording(): Promise<void> {
  const { server, character, count } = current();
  if (server !== null && character !== null && server.source.kind !== "none") await record(server.recording === null && count === null);
}

function keys(event: KeyboardEvent): void {
  const typing = event.target instanceof HTMLInputElement && event.target.type !== "checkbox" && event.target.type !== "range";
  const command = event.ctrlKey || event.metaKey;
  const key = event.key.toLowerCase();
  if (command && key === "s") {
    const { character } = current();
    if (character !== null) void save(character);
  } else if (typing) return;
  else if (command && key === "z") (event.shiftKey ? redo : undo)();
  else if (command && key === "y") redo();
  else if (key === "r" && !command && !(event.target instanceof HTMLSelectElement)) void toggleRecording();
  else if (key === " " && !(event.target instanceof HTMLElement && event.target.matches("button, input, select, summary, video"))) void play();
  else if (key === "escape") update({ selection: null, joint: null, channel: null, target: null, finding: null, tool: "select", drawn: [], clip: null, drawer: null, asking: null });
  else if (key === "enter" && current().drawn.length >= 2 && event.target === document.activeElement) finishLimb();
  else if (key === "delete" || key === "backspace") removeSelected();
  else return;
  event.preventDefault();
}

function listen(): void {
  document.addEventListener("keydown", keys);
  document.addEventListener("dragover", (event) => {
    event.preventDefault();
    if (!current().dropping) update({ dropping: true });
  });
  document.addEventListener("dragleave", (event) => {
    if (event.relatedTarget === null) update({ dropping: false });
  });
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    update({ dropping: false });
    void openFiles([...(event.dataTransfer?.files ?? [])]);
  });
}

/** What tests read: the state, and positions as they are shown. */
Object.assign(window, { studio: { state: current, viewer } });

subscribe((state) => {
  follow(state);
  render(state);
});
listen();
render(current());
connect();
