/** All available sources: examples, recordings, sensors, and ports with what arrives there. Those above stay where they are. */

import { isKinect, lookAgain, perform, performKinect, performLive, performWebcam } from "../actions";
import { type Child, type Node_, h } from "../dom";
import { chooseFiles } from "../files";
import type { Device, Port } from "../messages";
import { type State, update } from "../store";
import { strings } from "../strings";
import { button, checkbox } from "./parts";

export function sources(state: State): Node_ {
  const { sources: words } = strings;
  const found = state.sources;
  return h(
    "div",
    { class: "sources stack", key: "sources" },
    button(`‹ ${strings.performer.done}`, () => {
      update({ choosing: false });
    }, { quiet: true, back: true }),
    you(state),
    examples(state),
    recordings(state),
    button(words.again, () => {
      void lookAgain();
    }, { disabled: found === null }),
    h(
      "details",
      {},
      h("summary", {}, strings.details),
      h(
        "div",
        { class: "stack" },
        group(words.devices, found === null ? h("p", { class: "small" }, words.listening) : devices(found.devices)),
        group(words.ports, found === null ? h("p", { class: "small" }, words.listening) : found.ports.map(port)),
      ),
    ),
  );
}

/** What performs now, in words. */
export function chosenSource({ server }: State): string {
  const { source } = server ?? {};
  if (source === undefined || source.kind === "none") return strings.performer.none;
  return source.kind === "example" ? (strings.performances[source.name] ?? source.name) : source.text;
}

/** The webcam and the Kinect, in two large buttons. */
export function you({ server, busy, faces }: State): Node_ {
  const { sources: words } = strings;
  const looking = busy.includes(strings.busy.devices);
  const performs = (scheme: string): boolean => server?.source.kind === "live" && server.source.uri.startsWith(scheme);
  return group(
    words.you,
    button(words.webcam, () => {
      void performWebcam();
    }, { key: "webcam", disabled: looking, pressed: performs("camera:") }),
    checkbox(words.faces, faces, (on) => {
      update({ faces: on });
      if (performs("camera:")) void performWebcam();
    }, looking),
    button(words.kinect, () => {
      void performKinect();
    }, { key: "kinect", disabled: looking, pressed: server?.source.kind === "live" && isKinect(server.source.uri) }),
  );
}

export function examples({ server }: State): Node_ {
  const { sources: words, performances } = strings;
  return group(
    words.examples,
    h(
      "div",
      { class: "row" },
      Object.entries(performances).map(([name, title]) =>
        button(title, () => {
          void perform({ kind: "example", name });
        }, { pressed: server?.source.kind === "example" && server.source.name === name }),
      ),
    ),
  );
}

export function recordings({ server, greeting }: State): Node_ {
  const { sources: words } = strings;
  const uploads = (server?.uploads ?? []).filter(({ kind }) => kind === "log" || kind === "video");
  return group(
    words.recordings,
    uploads.map(({ upload, name }) =>
      button(name, () => {
        void perform({ kind: "upload", name: upload });
      }, { key: upload, pressed: server?.source.kind === "upload" && server.source.name === name }),
    ),
    button(words.drop, () => {
      chooseFiles([...(greeting?.suffixes.log ?? []), ...(greeting?.suffixes.video ?? [])]);
    }),
    h("p", { class: "small" }, words.dropHint),
  );
}

function devices(found: readonly Device[]): Child {
  const { sources: words } = strings;
  const usable = found.filter(({ uri }) => uri !== "");
  return [
    usable.length === 0 && h("p", { class: "small" }, words.noDevices),
    found.map(({ name, detail, fix, uri, ok }) =>
      h(
        "div",
        { class: "entry", key: name },
        h("p", {}, h("strong", {}, name), h("small", {}, detail, ok === false && fix !== "" ? ` ${fix}` : "")),
        uri !== "" &&
          button(words.use(name), () => {
            void performLive(uri);
          }),
      ),
    ),
  ];
}

function port({ uri, text, arriving, rate, refused, problem }: Port): Node_ {
  const { sources: words } = strings;
  const facts = [
    problem !== "" ? problem : arriving > 0 ? words.arriving(arriving, rate) : words.nothing,
    ...Object.entries(refused).map(([reason, n]) => words.refused(reason, n)),
  ];
  return h(
    "div",
    { class: "entry", key: uri },
    h("p", {}, h("strong", {}, text), h("small", {}, facts.join(". "))),
    button(words.use(uri), () => {
      void performLive(uri);
    }, { primary: arriving > 0 }),
  );
}

function group(title: string, ...children: readonly Child[]): Node_ {
  return h("section", { "aria-label": title }, h("h3", {}, title), children);
}
