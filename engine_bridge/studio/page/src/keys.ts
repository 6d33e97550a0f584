/** The keys of the whole page. */

import { record, redo, removeSelected, save, undo } from "./actions";
import { closeFilm, play } from "./film";
import { finishLimb } from "./panels/toolbar";
import { takeKeys } from "./panels/strip";
import { current, update } from "./store";

async function toggleRecording(): Promise<void> {
  const { server, character, count } = current();
  if (server !== null && character !== null && server.source.kind !== "none") await record(server.recording === null && count === null);
}

/** Do what a key stands for, unless it is typed into a field. */
export function keys(event: KeyboardEvent): void {
  const typing = event.target instanceof HTMLInputElement && event.target.type !== "checkbox" && event.target.type !== "range";
  const command = event.ctrlKey || event.metaKey;
  const key = event.key.toLowerCase();
  const { face, clip, character, made, asking, help } = current();
  const covered = made !== null || asking !== null || help; // the keys of what is behind a dialog rest
  if (event.repeat || (covered && key !== "escape" && !(help && key === "?"))) return;
  if (command && key === "s") {
    if (face === "workshop" && character !== null) void save(character);
  } else if (typing) return;
  else if (command && key === "z") (event.shiftKey ? redo : undo)();
  else if (command && key === "y") redo();
  else if (key === "r" && !command && !(event.target instanceof HTMLSelectElement)) void toggleRecording();
  else if (key === " " && !(event.target instanceof HTMLElement && event.target.matches("input, select, summary, video, :focus-visible:is(button, [role='button'])"))) void play();
  else if (key === "?") update(({ help }) => ({ help: !help }));
  else if (key === "escape" && current().made !== null) closeFilm();
  else if (key === "escape") update({ help: false, selection: null, joint: null, channel: null, target: null, finding: null, tool: "select", drawn: [], clip: null, drawer: null, asking: null });
  else if (key === "enter" && current().drawn.length >= 2 && event.target === document.activeElement) finishLimb();
  else if (face === "film") {
    const isFree = !(event.target instanceof HTMLElement && event.target.matches("input, select, summary, video, [role='tab']"));
    if (clip !== null && isFree) takeKeys(event, clip);
    return;
  } else if (key === "delete" || key === "backspace") removeSelected();
  else return;
  event.preventDefault();
}
