/** Takes and other recordings: play, loop, trim, export, download. */

import { deleteTake, deleteUpload, exportRecording, offer, perform } from "../actions";
import { type Child, type Node_, h } from "../dom";
import { editTakes, pictureOf } from "../film";
import { append } from "../model/film";
import { type Recording, type State, isJoined, update } from "../store";
import { strings } from "../strings";
import { button, checkbox, field, number, section, select } from "./parts";

export function takes(state: State): Node_ {
  const { takes: words, performances } = strings;
  const { server } = state;
  const list = server?.takes ?? [];
  const joined = isJoined(state);
  const logs = (server?.uploads ?? []).filter(({ kind }) => kind === "log");
  return h(
    "div",
    { class: "stack", key: "takes" },
    section(
      words.title,
      server?.recording != null && h("p", { class: "recording" }, words.recording(server.recording)),
      list.length === 0 && server?.recording == null && h("p", { class: "small" }, words.none),
      h(
        "ul",
        {},
        list.map(({ name, seconds, picture }) => joined ? h("li", { key: name }, name) : line(state, { kind: "take", name }, words.take(name, seconds), "", picture)),
      ),
    ),
    logs.length > 0 && section(words.uploads, h("ul", {}, logs.map(({ upload, name }) => line(state, { kind: "upload", name: upload }, name, "")))),
    joined ? h("p", { class: "small" }, words.elsewhere) : section(
      words.examples,
      h("ul", {}, Object.entries(performances).map(([name, title]) => line(state, { kind: "example", name }, title, ""))),
    ),
    !joined && (state.recording === null ? h("p", { class: "hint" }, words.select) : chosen(state, state.recording)),
  );
}

function same(one: Recording | null, other: Recording): boolean {
  return one?.kind === other.kind && one.name === other.name;
}

function line(state: State, recording: Recording, title: string, detail: string, picture = ""): Node_ {
  const url = pictureOf(picture);
  const playing = state.server?.source.kind === recording.kind && state.server.source.name === recording.name;
  return h(
    "li",
    { key: `${recording.kind} ${recording.name}` },
    h(
      "button",
      {
        type: "button",
        class: "line",
        "aria-pressed": String(same(state.recording, recording)),
        onclick: () => {
          update({ recording, trim: [null, null], exported: null });
        },
      },
      url !== "" && h("span", { class: "moving", style: `background-image: url(${url})`, key: "picture" }),
      h("span", { class: "name" }, title),
      h("small", {}, playing ? strings.takes.playing : detail),
    ),
  );
}

function chosen(state: State, recording: Recording): Child {
  const { takes: words } = strings;
  const take = recording.kind === "take" ? state.server?.takes.find(({ name }) => name === recording.name) : undefined;
  const upload = recording.kind === "upload" ? state.server?.uploads.find((each) => each.upload === recording.name) : undefined;
  const [from, to] = state.trim;
  const forms = ["", ...(state.greeting?.forms ?? [])];
  const exporting = state.busy.includes(strings.busy.export);
  return h(
    "div",
    { class: "chosen-take stack", key: "chosen" },
    h(
      "div",
      { class: "row" },
      button(words.play, () => {
        void perform(recording, true);
      }),
      take !== undefined &&
        state.character !== null &&
        button(words.toFilm, () => {
          if (state.character !== null) editTakes(append(state.film.present.takes, state.character, take.name));
        }),
      take !== undefined &&
        button(words.remove(take.name), () => {
          update({ recording: null });
          void deleteTake(take.name);
        }, { quiet: true, danger: true }),
      upload !== undefined &&
        button(words.removeUpload(upload.name), () => {
          update({ recording: null });
          void deleteUpload(upload.upload);
        }, { quiet: true, danger: true }),
    ),
    h(
      "details",
      {},
      h("summary", {}, strings.details),
      h("div", { class: "stack" }, checkbox(words.loop, state.loop, (loop) => {
        update({ loop });
      }),
    h(
      "div",
      { class: "pair" },
      field(
        words.from,
        number(from ?? 0, (value) => {
          update({ trim: [value > 0 ? value : null, to] });
        }, { min: 0, ...(take?.seconds == null ? {} : { max: take.seconds }), step: 0.1 }),
      ),
      field(
        words.to,
        number(to ?? take?.seconds ?? 0, (value) => {
          update({ trim: [from, value > 0 ? value : null] });
        }, { min: 0, step: 0.1 }),
      ),
    ),
      )),
    field(
      words.form,
      select(forms.map((form) => [form, words.forms[form] ?? form] as const), state.form, (form) => {
        update({ form });
      }),
    ),
    button(words.export, () => {
      void exportRecording();
    }, { primary: true, disabled: exporting }),
    state.exported !== null && exported(state.exported),
  );
}

function exported({ file, name, text }: NonNullable<State["exported"]>): Node_ {
  return h(
    "div",
    { class: "exported", key: "exported", role: "status", reveal: true },
    button(strings.takes.download(name), () => {
      void offer(file, name);
    }, { primary: true }),
    h("pre", { tabindex: 0 }, text),
  );
}
