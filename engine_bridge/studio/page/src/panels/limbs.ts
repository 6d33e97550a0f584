/** Limbs and handles: the list of all, and the settings of the selected one. */

import { edit, mirrorSelected, pickPart, pickTarget, removeSelected, select as choose } from "../actions";
import { type Child, type Node_, h } from "../dom";
import type { AxisSet } from "../messages";
import { CHANNELS, morphsOf, withBend, withMorph, withMove, withoutBend, withoutMorph, withoutMove } from "../model/channels";
import {
  type Handle,
  type Limb,
  type Part,
  type Puppet,
  addPoint,
  handleJoints,
  handleNamed,
  handlesOf,
  limbNamed,
  limbsOf,
  move,
  otherSide,
  pointJoints,
  remove,
  rename,
  withHandle,
  withHandleJoints,
  withLimb,
} from "../model/puppet";
import { JOINTS, type Joint, sideOf, spoken } from "../model/skeleton";
import type { Vector } from "../model/vector";
import { type State, shownCharacter, shownPuppet } from "../store";
import { strings } from "../strings";
import { button, checkbox, field, number, section, select, text } from "./parts";

type Bounds = readonly [Vector, Vector] | null;

export function limbs(state: State, bounds: Bounds): Node_ {
  const puppet = shownPuppet(state);
  const { selection } = state;
  if (puppet === null) return h("div", { key: "limbs" }, h("p", { class: "small" }, strings.viewer.waiting));
  if (selection === null) return list(state, puppet);
  return h(
    "div",
    { class: "stack", key: "part" },
    button(`‹ ${strings.limbs.back}`, () => {
      choose(null);
    }, { quiet: true, back: true }),
    selection.kind === "limb" ? limb(puppet, selection, bounds) : handle(puppet, selection.name, bounds),
  );
}

function list(state: State, puppet: Puppet): Node_ {
  const { limbs: words } = strings;
  const notes = shownCharacter(state)?.notes ?? [];
  const entry = (part: Part, detail: string): Node_ =>
    h(
      "li",
      { key: `${part.kind} ${part.name}` },
      h(
        "button",
        {
          type: "button",
          class: "line",
          onclick: () => {
            pickPart(part);
          },
        },
        h("span", { class: `mark ${part.kind} ${sideOf(part.name)}`, "aria-hidden": "true" }),
        h("span", { class: "name" }, part.name),
        h("small", {}, detail),
      ),
    );
  const [allLimbs, allHandles] = [limbsOf(puppet), handlesOf(puppet)];
  return h(
    "div",
    { class: "stack", key: "list" },
    h("p", { class: "hint" }, words.selectHint),
    allLimbs.length > 0 &&
      section(
        words.limbs,
        h("ul", {}, allLimbs.map(({ name, points }) => entry({ kind: "limb", name }, words.points(points.length)))),
      ),
    allHandles.length > 0 &&
      section(
        words.handles,
        h(
          "ul",
          {},
          allHandles.map((each) => {
            const joints = handleJoints(each);
            return entry({ kind: "handle", name: each.name }, joints.length === 0 ? words.stays : words.mean(joints));
          }),
        ),
      ),
    targets(state, puppet),
    allLimbs.length + allHandles.length === 0 && h("p", {}, words.none),
    notes.length > 0 &&
      h("details", { key: "notes" }, h("summary", {}, words.notes), h("ul", { class: "notes" }, notes.map((note) => h("li", {}, note)))),
  );
}

/** The morph targets of the mesh: a channel that was chosen before moves the one that is clicked. */
function targets(state: State, puppet: Puppet): Child {
  const { channels: words } = strings;
  const names = shownCharacter(state)?.targets ?? [];
  if (names.length === 0) return null;
  return section(
    words.targets,
    h(
      "ul",
      {},
      names.map((name) => {
        const morphs = morphsOf(puppet).filter(({ target }) => target === name);
        return h(
          "li",
          { key: `target ${name}` },
          h(
            "button",
            {
              type: "button",
              class: "line",
              "aria-pressed": String(state.target === name),
              onclick: () => {
                pickTarget(name);
              },
            },
            h("span", { class: "mark target", "aria-hidden": "true" }),
            h("span", { class: "name" }, name),
            h("small", {}, morphs.map(({ channel }) => words.name(channel)).join(", ")),
          ),
          morphs.map(({ channel, gain }) =>
            h(
              "div",
              { class: "row", key: channel },
              field(
                words.gain(channel),
                number(gain ?? 1, (value) => {
                  edit(withMorph(puppet, name, channel, value));
                }, { min: -20, max: 20, step: 0.1 }),
              ),
              button(words.unmap, () => {
                edit(withoutMorph(puppet, name, channel));
              }, { quiet: true, label: words.unmapTarget(channel, name) }),
            ),
          ),
        );
      }),
    ),
  );
}

const AXES = ["x", "-x", "y", "-y", "z", "-z"] as const;

/** The channel that bends a limb, how far, and about which axis. */
function bend(puppet: Puppet, { name, bend: shown }: Limb): Child {
  const { channels: words, limbs: labels } = strings;
  const change = (values: object): void => {
    edit(withLimb(puppet, name, (old) => ({ ...old, ...(old.bend == null ? {} : { bend: { ...old.bend, ...values } }) })));
  };
  const channel = shown?.channel ?? "";
  return [
    channelField(words.bends, channel, (chosen) => {
      edit(chosen === "" ? withoutBend(puppet, name) : withBend(puppet, name, chosen));
    }),
    shown != null && [
      field(labels.bend(channel), number(shown.degrees, (degrees) => {
        change({ degrees });
      }, { min: -180, max: 180, step: 1 })),
      field(
        words.axis,
        select(AXES.map((axis) => [axis, strings.motion.direction(axis)] as const), (shown.axis ?? "x"), (axis) => {
          change({ axis });
        }),
      ),
    ],
  ];
}

/** The channel that moves a handle, and how far. */
function moves(puppet: Puppet, { name, channel, moves: way }: Handle): Child {
  const { channels: words } = strings;
  return [
    channelField(words.moves, channel ?? "", (chosen) => {
      edit(chosen === "" ? withoutMove(puppet, name) : withMove(puppet, name, chosen));
    }),
    channel != null &&
      coordinates(words.way, way ?? [0, 0, 0], (moved) => {
        edit(withHandle(puppet, name, (old) => ({ ...old, moves: moved })));
      }),
  ];
}

function channelField(label: string, channel: string, change: (channel: string) => void): Node_ {
  const { channels: words } = strings;
  const choices = [...new Set([...CHANNELS, ...(channel === "" ? [] : [channel])])];
  return field(label, select([["", words.nothing], ...choices.map((each): [string, string] => [each, words.name(each)])], channel, change));
}

function limb(puppet: Puppet, part: Part & { kind: "limb" }, bounds: Bounds): Child {
  const { limbs: words } = strings;
  const shown = limbNamed(puppet, part.name);
  if (shown === undefined) return null;
  const change = (made: (limb: Limb) => Limb): void => {
    edit(withLimb(puppet, part.name, made));
  };
  const parents = limbsOf(puppet).filter(({ name }) => name !== part.name);
  return [
    nameField(puppet, part, limbsOf(puppet).map(({ name }) => name)),
    field(
      words.follow,
      select(
        [
          ["direction", words.direction],
          ["turn", words.turn],
        ],
        shown.follow ?? "direction",
        (follow) => {
          change((old) => ({ ...old, follow }));
        },
      ),
    ),
    gainField(shown.gain ?? 1, (gain) => {
      change((old) => ({ ...old, gain }));
    }),
    bend(puppet, shown),
    field(
      words.parent,
      select(
        [["", words.parentNone], ...parents.map(({ name }): [string, string] => [name, name])],
        shown.parent ?? "",
        (parent) => {
          change((old) => ({ ...old, parent: parent === "" ? null : parent }));
        },
      ),
    ),
    h("h3", {}, words.points(shown.points.length)),
    h(
      "ol",
      { class: "points" },
      shown.points.map((point, i) => {
        const here: Part = { kind: "limb", name: part.name, point: i };
        const joints = pointJoints(shown.joints[i] ?? []);
        const many = joints.length > 1;
        return h(
          "li",
          { key: String(i), class: part.point === i ? "chosen" : null },
          button(words.point(i + 1), () => {
            choose(here);
          }, { pressed: part.point === i }),
          select(
            [...(many ? [["", words.mean(joints)] as const] : []), ...JOINTS.map((joint) => [joint, spoken(joint)] as const)],
            many ? "" : (joints[0] ?? ""),
            (joint) => {
              if (joint === "") return;
              change((old) => ({ ...old, joints: old.joints.with(i, joint) }));
            },
            words.joint(i + 1),
          ),
          part.point === i && position(puppet, here, point),
        );
      }),
    ),
    h(
      "div",
      { class: "row" },
      button(words.addPoint, () => {
        const after = part.point ?? shown.points.length - 1;
        edit(addPoint(puppet, part.name, after));
        choose({ kind: "limb", name: part.name, point: after + 1 });
      }),
      part.point !== undefined &&
        shown.points.length > 2 &&
        button(words.removePoint, () => {
          choose({ kind: "limb", name: part.name });
          edit(remove(puppet, part));
        }),
    ),
    ends(part, bounds),
  ];
}

/** Controls that cannot be used for a service that was started elsewhere. */
function handle(puppet: Puppet, name: string, bounds: Bounds): Child {
  const { limbs: words } = strings;
  const shown = handleNamed(puppet, name);
  if (shown === undefined) return null;
  const part: Part = { kind: "handle", name };
  const change = (made: (handle: Handle) => Handle): void => {
    edit(withHandle(puppet, name, made));
  };
  const joints = handleJoints(shown);
  const many = joints.length > 1;
  const axes = shown.axes ?? "xyz";
  return [
    nameField(puppet, part, handlesOf(puppet).map((each) => each.name)),
    field(
      words.handleJoint,
      select(
        [["", words.noJoint], ...(many ? [["many", words.mean(joints)] as const] : []), ...JOINTS.map((joint) => [joint, spoken(joint)] as const)],
        many ? "many" : (joints[0] ?? ""),
        (joint: "" | "many" | Joint) => {
          if (joint !== "many") edit(withHandleJoints(puppet, name, joint === "" ? [] : [joint]));
        },
      ),
    ),
    gainField(shown.gain ?? 1, (gain) => {
      change((old) => ({ ...old, gain }));
    }),
    moves(puppet, shown),
    h(
      "fieldset",
      {},
      h("legend", {}, words.axes),
      (["x", "y", "z"] as const).map((axis) =>
        checkbox(words.axis[axis], axes.includes(axis), (on) => {
          const chosen = ["x", "y", "z"].filter((each) => (each === axis ? on : axes.includes(each))).join("");
          change((old) => ({ ...old, axes: chosen as AxisSet }));
        }),
      ),
    ),
    position(puppet, part, shown.position),
    ends(part, bounds),
  ];
}

function nameField(puppet: Puppet, part: Part, taken: readonly string[]): Node_ {
  return field(
    strings.limbs.name,
    text(part.name, (name) => {
      if (name === part.name || taken.includes(name)) return;
      edit(rename(puppet, part, name));
      choose({ ...part, name });
    }),
  );
}

function gainField(gain: number, change: (gain: number) => void): Node_ {
  return field(strings.limbs.gain, number(gain, change, { min: -20, max: 20, step: 0.1 }), strings.limbs.gainHint);
}

function position(puppet: Puppet, part: Part, point: Vector): Node_ {
  return coordinates(strings.limbs.position, point, (moved) => {
    edit(move(puppet, part, moved));
  });
}

function coordinates(label: string, vector: Vector, change: (vector: Vector) => void): Node_ {
  return h(
    "div",
    { class: "coordinates", role: "group", "aria-label": label },
    (["x", "y", "z"] as const).map((axis, k) =>
      number(vector[k] ?? 0, (value) => {
        const [x, y, z] = vector.with(k, value);
        change([x ?? 0, y ?? 0, z ?? 0]);
      }, { label: strings.limbs.coordinate(label, axis) }),
    ),
  );
}

/** Buttons for a whole part: copy it to the other side, or delete it. */
function ends(part: Part, bounds: Bounds): Node_ {
  const { limbs: words } = strings;
  const sideless = otherSide(part.name) === null;
  return h(
    "div",
    { class: "row end" },
    button(words.mirror, () => {
      if (bounds !== null) mirrorSelected(bounds);
    }, { disabled: sideless, ...(sideless ? { hint: words.mirrorNone } : {}) }),
    button(words.remove(part.name), () => {
      choose({ kind: part.kind, name: part.name });
      removeSelected();
    }, { danger: true }),
  );
}
