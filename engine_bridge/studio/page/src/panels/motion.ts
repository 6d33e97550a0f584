/** Settings of the motion of the whole character: mirroring, scale, walking, smoothing. */

import { changePlan, edit } from "../actions";
import { type Node_, h } from "../dom";
import type { Puppet, Retarget, Root } from "../model/puppet";
import { type State, shownPuppet } from "../store";
import { strings } from "../strings";
import { checkbox, field, number, section, select, slider } from "./parts";
import { smoothing } from "./smoothing";

export function motion(state: State): Node_ {
  const puppet = shownPuppet(state);
  if (puppet === null) return h("div", { key: "motion" }, h("p", { class: "small" }, strings.viewer.waiting));
  return h("div", { class: "stack", key: "motion" }, (puppet.limb ?? []).length > 0 && bodyPlan(state), body(puppet), root(puppet), smoothing(state, puppet));
}

const DIRECTIONS = ["x", "-x", "y", "-y", "z", "-z"] as const;

const along = (direction: string): string => direction.replace("-", "");

function body(puppet: Puppet): Node_ {
  const { motion: words } = strings;
  const retarget = puppet.retarget ?? {};
  const change = (values: Retarget): void => {
    edit({ ...puppet, retarget: { ...retarget, ...values } });
  };
  const scale = retarget.scale ?? "auto";
  const { up = "y", front = "z", turn = 0 } = puppet.character;
  const stand = (values: Puppet["character"]): void => {
    edit({ ...puppet, character: { ...puppet.character, ...values } });
  };
  return section(
    words.body,
    field(
      words.up,
      select(DIRECTIONS.map((each) => [each, words.direction(each)] as const), up, (direction) => {
        stand(along(direction) === along(front) ? { up: direction, front: along(direction) === "z" ? "y" : "z" } : { up: direction });
      }),
    ),
    field(
      words.front,
      select(
        DIRECTIONS.filter((each) => along(each) !== along(up)).map((each) => [each, words.direction(each)] as const),
        front,
        (direction) => {
          stand({ front: direction });
        },
      ),
      words.frontHint,
    ),
    slider(words.turn, turn, { min: -180, max: 180, step: 1 }, (degrees) => {
      stand({ turn: degrees });
    }),
    checkbox(words.mirror, retarget.mirror ?? false, (mirror) => {
      change({ mirror });
    }),
    checkbox(words.handsMeet, retarget.hands_meet ?? true, (hands_meet) => {
      change({ hands_meet });
    }),
    slider(words.armSpace, retarget.arm_space ?? 0, { min: -45, max: 45, step: 1 }, (arm_space) => {
      change({ arm_space });
    }),
    h("p", { class: "small" }, words.armSpaceHint),
    checkbox(`${words.scale}: ${words.automatic.toLowerCase()}`, scale === "auto", (on) => {
      change({ scale: on ? "auto" : 1 });
    }),
    scale !== "auto" &&
      field(
        words.scale,
        number(scale, (value) => {
          change({ scale: value });
        }, { min: 0.001, step: 0.1 }),
        words.scaleHint,
      ),
  );
}

/** The choice of a body plan, which says how the limbs follow the performer. */
function bodyPlan(state: State): Node_ {
  const { motion: words } = strings;
  const plan = (state.character === null ? null : state.plans[state.character]) ?? "";
  const choices = [...(plan === "" ? [["", words.planNone] as const] : []), ...Object.entries(words.plans)];
  return section(
    words.plan,
    field(
      words.plan,
      select(choices, plan, (chosen) => {
        if (chosen !== "") void changePlan(chosen);
      }),
      words.planHint,
    ),
  );
}

const AXES = ["x", "z", "xz", "xyz"] as const;

function root(puppet: Puppet): Node_ {
  const { motion: words } = strings;
  const shown = puppet.root ?? null;
  const change = (values: Root): void => {
    edit({ ...puppet, root: { ...shown, ...values } });
  };
  return section(
    words.root,
    checkbox(words.walks, shown !== null, (on) => {
      edit({ ...puppet, root: on ? {} : null });
    }),
    shown !== null && [
      checkbox(words.turns, shown.turns ?? true, (turns) => {
        change({ turns });
      }),
      checkbox(words.feet, (shown.feet ?? "lock") === "lock", (on) => {
        change({ feet: on ? "lock" : "free" });
      }),
      field(
        words.rootAxes,
        select(AXES.map((axes) => [axes, words.walkAxes[axes]] as const), (shown.axes ?? "xz") as (typeof AXES)[number], (axes) => {
          change({ axes });
        }),
      ),
    ],
  );
}
