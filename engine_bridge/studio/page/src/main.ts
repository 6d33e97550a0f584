/** The page: joins the state, the stream, the 3D view and the panels. */

import { connect, edit, pickPart, sampled, select, show } from "./actions";
import { Client } from "../../../../integrations/web/puppetline.js";
import { address } from "./connection";
import { draw } from "./dom";
import { rememberedFace } from "./face";
import { editScene, position } from "./film";
import { openFiles } from "./files";
import { keys } from "./keys";
import { figure } from "./panels/figure";
import { meters } from "./panels/meters";
import { withRow } from "./model/scene";
import { showFilm } from "./panels/shown_film";
import { movePlayhead } from "./panels/strip";
import { put } from "./placing";
import { planFilm, shownMoment } from "./plan";
import { connection, download, tried } from "./requests";
import { playSounds } from "./sound";
import { type State, current, isWorking, subscribe, update } from "./store";
import { strings } from "./strings";
import { page } from "./view";
import { Viewer } from "./viewer/viewer";

const root = document.body;

const place = document.createElement("div");
place.className = "viewer";

const viewer = new Viewer(place, {
  download: (id) => tried(() => download(id)),
  arrived: () => {
    render(current());
  },
  picked: (part) => {
    if (part === null) select(null);
    else pickPart(part);
  },
  moved: edit,
  chosen: show,
  standing: (draft) => {
    update({ draft });
  },
  stood: ({ name, ...change }) => {
    editScene({ character: withRow(current().film.present.scene, name, change) }, { draft: null });
  },
  drawn: (name, picture) => {
    update(({ portraits }) => ({ portraits: { ...portraits, [name]: picture } }));
  },
  resting: () => {
    if (!current().atRest) update({ atRest: true });
  },
  placed: (inside, surface) => {
    const { character } = current();
    put(inside, surface, character === null ? null : viewer.bounds(character));
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
  if (client?.token !== connection.token) {
    client?.close();
    client = new Client(address("/stream"), { token: connection.token });
    viewer.follow(client, []);
    jointsOf = null;
  }
  viewer.follow(client, server.characters);
  const followed = viewer.rests ? null : character;
  if (followed === jointsOf) return;
  for (const end of unfollow) end();
  [joints, channels, jointsOf, unfollow] = [null, {}, followed, []];
  if (followed === null) return;
  unfollow = [
    client.subscribe(`${followed}/joints`, (message) => {
      if (message.kind !== "joints") return;
      joints = message.body;
      scheduleFigure();
    }),
    client.subscribe(`${followed}/channels`, (message) => {
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
  const { server, plan } = current();
  const moment = shownMoment(current());
  movePlayhead(current(), position(current()));
  showFilm(current(), moment);
  viewer.film(moment, plan?.film?.size);
  playSounds(current(), (character, now) => viewer.serviceTime(character, now));
  const runs = server?.recording != null || (server?.timeline != null && !server.timeline.paused);
  if (timeScheduled || !runs) return;
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
  const { character } = state;
  draw(root, page(state, viewer));
  drawFigure(state);
  const slot = document.querySelector(".place");
  if (slot !== null && place.parentElement !== slot) slot.append(place);
  if (character !== null) viewer.label(state.face === "film" ? strings.viewer.filmLabel : strings.viewer.label(character));
  viewer.refresh(state);
  scheduleTime();
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
  void planFilm();
});
/** What waits says for how long. */
setInterval(() => {
  if (current().busy.length > 0 || isWorking(current())) update({});
}, 1000);

listen();
update({ face: rememberedFace() });
render(current());
connect();
