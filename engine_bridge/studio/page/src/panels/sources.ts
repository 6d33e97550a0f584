/** All available sources: examples, recordings, sensors, and ports with what arrives there. */

import { lookAgain, perform, performLive } from "../actions";
import { type Child, type Node_, h } from "../dom";
import type { Device, Port } from "../messages";
import { type State, update } from "../store";
import { strings } from "../strings";
import { chooseFiles } from "./empty";
import { button } from "./parts";

const EXAMPLES = Object.keys(strings.performances);

export function sources(state: State): Node_ {
  const { sources: words, performances } = strings;
  const { server } = state;
  const found = state.sources;
  const logs = (server?.uploads ?? []).filter(({ kind }) => kind === "log");
  return h(
    "div",
    { class: "sources stack", key: "sources" },
    button(`‹ ${strings.performer.done}`, () => {
      update({ choosing: false });
    }, { quiet: true, back: true }),
    group(words.you, you(state)),
    group(
      words.examples,
      h(
        "div",
        { class: "row" },
        (found?.examples ?? EXAMPLES).map((name) =>
          button(performances[name] ?? name, () => {
            void perform({ kind: "example", name });
          }, { pressed: server?.source.kind === "example" && server.source.name === name }),
        ),
      ),
    ),
    group(
      words.recordings,
      logs.map(({ upload, name }) =>
        button(name, () => {
          void perform({ kind: "upload", name: upload });
        }, { key: upload, pressed: server?.source.kind === "upload" && server.source.name === upload }),
      ),
      button(words.drop, () => {
        chooseFiles(state.greeting?.suffixes.log ?? []);
      }),
      h("p", { class: "small" }, words.dropHint),
    ),
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

/** The webcam and the Kinect, in two large buttons. */
function you({ sources: found, server }: State): Child {
  const { sources: words } = strings;
  if (found === null) return h("p", { class: "small" }, words.listening);
  const webcam = found.devices.find(({ uri }) => uri.startsWith("camera:"));
  const kinect = found.devices.find(({ uri }) => uri !== "" && !uri.startsWith("camera:"));
  return [
    button(words.webcam, () => {
      if (webcam === undefined) return;
      if (server?.installed.includes("camera") === true) void performLive(webcam.uri);
      else update({ asking: "camera" });
    }, { key: "webcam", disabled: webcam === undefined }),
    webcam === undefined && h("p", { class: "small" }, words.noWebcam),
    kinect !== undefined
      ? button(words.kinect, () => {
          void performLive(kinect.uri);
        }, { key: "kinect" })
      : h("details", { key: "no-kinect" }, h("summary", {}, words.plugKinect), h("p", { class: "small" }, words.kinectHelp)),
  ];
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
