/** The toolbar of the 3D view: the pose that is shown, the tools, and instructions for the chosen one. */

import { edit, select } from "../actions";
import { type Node_, h } from "../dom";
import { addLimb, freeName, limbsOf, otherSide } from "../model/puppet";
import { type State, type Tool, shownPuppet, update } from "../store";
import { strings } from "../strings";
import { button, checkbox, choice } from "./parts";

export function toolbar(state: State, fit: () => void): Node_ {
  const { viewer: words } = strings;
  if (state.face === "film") return h("div", { class: "toolbar", key: "toolbar" }, button(words.fitAll, fit, { quiet: true }));
  const tools: [Tool, string][] = [
    ["select", words.select],
    ["limb", words.addLimb],
    ["handle", words.addHandle],
    ["jaw", words.addJaw],
  ];
  return h(
    "div",
    { class: "toolbar", key: "toolbar" },
    choice(
      words.pose,
      [
        ["live", words.live],
        ["rest", words.rest],
      ],
      state.atRest ? "rest" : "live",
      (pose) => {
        update({ atRest: pose === "rest", tool: "select", drawn: [] });
      },
    ),
    choice(words.tools, tools, state.tool, (tool) => {
      update({ tool, drawn: [], bones: true, atRest: tool !== "select" || state.atRest });
    }),
    state.selection !== null && choice(
      words.dragging,
      [
        ["view", words.inView],
        ["surface", words.onSurface],
      ],
      state.dragging,
      (dragging) => {
        update({ dragging });
      },
    ),
    checkbox(words.bones, state.bones, (bones) => {
      update({ bones });
    }),
    button(words.fit, fit, { quiet: true }),
  );
}

/** Instructions for the chosen tool. */
export function toolHint(state: State): Node_ | false {
  const { viewer: words } = strings;
  const { tool, drawn, joint, channel, target, finding } = state;
  if (joint !== null) return hint(words.mapHint(joint), cancel({ joint: null }));
  if (finding !== null) return hint(rangeHint(state, finding), cancel({ finding: null }));
  if (channel !== null) return hint(strings.channels.mapHint(channel), cancel({ channel: null }));
  if (target !== null) return hint(strings.channels.targetHint(target), cancel({ target: null }));
  if (tool === "handle") return hint(words.handleHint, cancel({ tool: "select" }));
  if (tool === "jaw") return hint(words.jawHint(drawn.length), cancel({ tool: "select", drawn: [] }));
  if (tool !== "limb") return false;
  const finish = button(words.finish, finishLimb, { primary: true, disabled: drawn.length < 2 });
  return hint(words.limbHint(drawn.length), finish, cancel({ tool: "select", drawn: [] }));
}

/** What the performer does while a channel's range is measured; a mirrored character's left is the performer's right. */
function rangeHint(state: State, { channel, neutral }: NonNullable<State["finding"]>): string {
  const { channels: words } = strings;
  const mirrored = shownPuppet(state)?.retarget?.mirror === true;
  const own = mirrored ? (otherSide(channel) ?? channel) : channel;
  return words.hold(neutral === null ? (words.neutral[own] ?? words.anyNeutral) : (words.full[own] ?? words.anyFull(own)));
}

function hint(text: string, ...actions: readonly Node_[]): Node_ {
  return h("div", { class: "tool-hint", role: "status", key: "hint" }, h("span", {}, text), actions);
}

function cancel(change: Partial<State>): Node_ {
  return button(strings.viewer.cancel, () => {
    update(change);
  }, { quiet: true });
}

/** Add the limb whose points have been clicked. */
export function finishLimb(): void {
  update((state) => {
    const puppet = shownPuppet(state);
    if (puppet === null || state.drawn.length < 2) return {};
    const name = freeName(strings.limbs.newLimb, limbsOf(puppet).map((limb) => limb.name));
    queueMicrotask(() => {
      edit(addLimb(puppet, name, state.drawn));
      select({ kind: "limb", name });
    });
    return { tool: "select", drawn: [] };
  });
}
