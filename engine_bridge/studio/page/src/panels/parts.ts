/** Building blocks of panels. */

import { type Child, type Node_, h } from "../dom";

export interface Options {
  readonly primary?: boolean;
  readonly disabled?: boolean;
  readonly pressed?: boolean;
  readonly quiet?: boolean;
  readonly danger?: boolean;
  readonly label?: string;
  readonly hint?: string;
  readonly back?: boolean;
  readonly key?: string;
  /** A class for narrow windows. */
  readonly name?: string;
}

export function button(text: Child, onclick: () => void, options: Options = {}): Node_ {
  const { primary, disabled, pressed, quiet, danger, back, label, hint, key, name } = options;
  return h(
    "button",
    {
      type: "button",
      class: [primary && "primary", quiet && "quiet", danger && "danger", back && "back", name].filter(Boolean).join(" ") || null,
      disabled: disabled === true,
      "aria-pressed": pressed === undefined ? null : String(pressed),
      "aria-label": label,
      title: hint ?? label,
      onclick,
      ...(key === undefined ? {} : { key }),
    },
    text,
  );
}

/** Buttons of which exactly one is on. */
export function choice<T extends string>(label: string, values: readonly (readonly [T, string])[], chosen: T, choose: (value: T) => void): Node_ {
  return h(
    "div",
    { class: "choice", role: "group", "aria-label": label },
    values.map(([value, text]) =>
      button(text, () => {
        choose(value);
      }, { pressed: value === chosen }),
    ),
  );
}

export function field(label: string, control: Node_, hint?: string): Node_ {
  if (hint === undefined) return h("label", { class: "field" }, h("span", {}, label), control);
  const id = `hint-${label.toLowerCase().replaceAll(/\W+/g, "-")}`;
  const described = { ...control, attributes: { ...control.attributes, "aria-describedby": id } };
  return h("div", { class: "field" }, h("label", { class: "field" }, h("span", {}, label), described), h("small", { id }, hint));
}

export function checkbox(label: string, checked: boolean, change: (on: boolean) => void, disabled = false): Node_ {
  const onchange = (event: Event): void => {
    change((event.target as HTMLInputElement).checked);
  };
  return h("label", { class: "check" }, h("input", { type: "checkbox", checked, disabled, onchange }), h("span", {}, label));
}

export function select<T extends string>(values: readonly (readonly [T, string])[], chosen: T, choose: (value: T) => void, label?: string): Node_ {
  const onchange = (event: Event): void => {
    choose((event.target as HTMLSelectElement).value as T);
  };
  return h(
    "select",
    { value: chosen, onchange, "aria-label": label },
    values.map(([value, text]) => h("option", { value, key: value }, text)),
  );
}

export function number(value: number, change: (value: number) => void, limits: { min?: number; max?: number; step?: number; label?: string } = {}): Node_ {
  const onchange = (event: Event): void => {
    const input = event.target as HTMLInputElement;
    const { badInput, rangeUnderflow, rangeOverflow } = input.validity; // a step is only for the arrows
    if (input.value !== "" && !badInput && !rangeUnderflow && !rangeOverflow) change(input.valueAsNumber);
    else input.value = String(value);
  };
  const { min, max, step, label } = limits;
  return h("input", { type: "number", value: String(round(value)), min, max, step: step ?? "any", onchange, "aria-label": label });
}

/** A slider with its value beside it, by default the number: `slide` while it moves, `change` when it is released. */
export function slider(
  label: string,
  value: number,
  limits: { min: number; max: number; step: number },
  change: (value: number) => void,
  slide: (value: number) => void = () => undefined,
  shown = String(round(value)),
): Node_ {
  const of = (event: Event): number => (event.target as HTMLInputElement).valueAsNumber;
  return h(
    "label",
    { class: "slider" },
    h("span", {}, label),
    h("input", {
      type: "range",
      ...limits,
      value: String(value),
      "aria-valuetext": shown,
      oninput: (event: Event) => {
        slide(of(event));
      },
      onchange: (event: Event) => {
        change(of(event));
      },
    }),
    h("output", {}, shown),
  );
}

export function section(title: string, ...children: readonly Child[]): Node_ {
  return h("section", { "aria-label": title }, h("h2", {}, title), children);
}

/** Text that can be changed; `change` gets what was entered, if anything was. */
export function text(value: string, change: (value: string) => void): Node_ {
  return h("input", {
    type: "text",
    value,
    maxlength: 64,
    spellcheck: "false",
    onchange: (event: Event) => {
      const input = event.target as HTMLInputElement;
      const entered = input.value.trim();
      if (entered === "") input.value = value;
      else change(entered);
    },
  });
}

/** A text with its label; `change` gets what was entered, also nothing. */
export function entry(label: string, value: string, change: (value: string) => void): Node_ {
  const onchange = (event: Event): void => {
    const input = event.target as HTMLInputElement;
    const entered = input.value.trim();
    input.value = value; // until the state has the new one
    if (entered !== value) change(entered);
  };
  return field(label, h("input", { type: "text", value, maxlength: 120, onchange }));
}

/** Four significant digits. */
function round(value: number): number {
  return Number(value.toPrecision(4));
}
