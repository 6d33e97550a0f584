/** Files that are dropped or chosen: meshes, recordings, videos, music and pictures. */

import { perform } from "./actions";
import { ask, editScene } from "./film";
import type { UploadReply } from "./messages";
import { connection, doing, request } from "./requests";
import { current, update } from "./store";
import { strings } from "./strings";

/** Open files: a mesh or puppet becomes a character, a recording or video the performer, a sound the music, a picture the place. */
export async function openFiles(files: readonly File[]): Promise<void> {
  // a puppet file finds its mesh among the uploads
  const ordered = [...files].sort((a, b) => Number(a.name.endsWith(".toml")) - Number(b.name.endsWith(".toml")));
  const puppet = ordered.some(({ name }) => name.endsWith(".toml"));
  for (const file of ordered) {
    const uploaded = await upload(file);
    if (uploaded === null) return;
    if (uploaded.kind === "log") await perform({ kind: "upload", name: uploaded.upload });
    else if (uploaded.kind === "video") await performVideo(uploaded.upload);
    else if (uploaded.kind === "puppet") await opened("open_puppet", { upload: uploaded.upload });
    else if (uploaded.kind === "sound") editScene({ music: { file: uploaded.file } });
    else if (uploaded.kind === "picture") editScene({ background: { picture: uploaded.file } });
    else if (!puppet) await opened("open_character", { upload: uploaded.upload });
  }
}

const upload = (file: File): Promise<UploadReply | null> => doing(strings.busy.upload(file.name), () => connection.upload(file));

/** A video needs what a webcam needs. */
async function performVideo(name: string): Promise<void> {
  if (current().server?.installed.includes("camera") === true) await perform({ kind: "upload", name });
  else ask("camera", () => perform({ kind: "upload", name }));
}

export const openExample = (name: string): Promise<void> => opened("open_example", { name });

async function opened(what: string, values: object): Promise<void> {
  const reply = await request<{ character: string }>(strings.busy.open, what, values);
  if (reply === null) return;
  update({ character: reply.character, selection: null, adding: false, atRest: false, tab: "limbs" });
}

/** Let the user choose files; the chooser shows those with these suffixes. */
export function chooseFiles(suffixes: readonly string[], use: (files: readonly File[]) => Promise<void> = openFiles): void {
  const input = document.createElement("input");
  input.type = "file";
  input.multiple = true;
  input.accept = suffixes.join();
  input.onchange = () => {
    void use([...(input.files ?? [])]);
  };
  input.click();
}

/** Let the user choose a sound or a picture for the film; `use` gets its path from the scene file. */
export function chooseMedia(kind: "sound" | "picture", use: (file: string) => void): void {
  chooseFiles(current().greeting?.suffixes[kind] ?? [], async ([file]) => {
    const uploaded = file === undefined ? null : await upload(file);
    if (uploaded?.kind === kind) use(uploaded.file);
  });
}
