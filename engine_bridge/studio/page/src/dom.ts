/** Views are functions of the state that return nodes; `draw` changes the document where it differs from them. */

type Handler = (event: never) => void;
type Value = string | number | boolean | null | undefined | Handler;

export interface Attributes {
  readonly [name: string]: Value;
  readonly key?: string;
  /** `draw` does not change its children. */
  readonly raw?: boolean;
  /** It is scrolled into view when it appears. */
  readonly reveal?: boolean;
  /** A dialog that covers the page: what is behind it cannot be reached until it is gone. */
  readonly modal?: boolean;
}

export interface Node_ {
  readonly tag: string;
  readonly attributes: Attributes;
  readonly children: readonly (Node_ | string)[];
}

export type Child = Node_ | string | false | null | undefined | readonly Child[];

/** Describe an element. Attributes whose names begin with "on" are handlers; `key` keeps an element among its siblings. */
export function h(tag: string, attributes: Attributes = {}, ...children: readonly Child[]): Node_ {
  return { tag, attributes, children: flat(children) };
}

function flat(children: readonly Child[]): (Node_ | string)[] {
  return children.flatMap((child): (Node_ | string)[] => {
    if (child === false || child === null || child === undefined) return [];
    return typeof child === "string" || "tag" in child ? [child] : flat(child);
  });
}

const SVG = "http://www.w3.org/2000/svg";
const SVG_TAGS = new Set(["svg", "g", "path", "line", "circle", "text", "title", "rect"]);
const drawn = new WeakMap<Node, Node_>();

/** Make the children of an element equal to nodes; elements that stay keep their focus, value and scroll position. */
export function draw(parent: Element, children: readonly Child[]): void {
  const nodes = flat(children);
  const old = [...parent.childNodes];
  const keyed = new Map<string, ChildNode>();
  for (const child of old) {
    const key = drawn.get(child)?.attributes.key;
    if (key !== undefined) keyed.set(key, child);
  }
  const focused = document.activeElement;
  const free = old.filter((child) => drawn.get(child)?.attributes.key === undefined);
  nodes.forEach((node, index) => {
    const candidate =
      typeof node !== "string" && node.attributes.key !== undefined ? keyed.get(node.attributes.key) : free.shift();
    const stays = matches(candidate, node);
    const element = stays ? candidate : create(node);
    change(element, node);
    const place = parent.childNodes[index] ?? null;
    if (place !== element) parent.insertBefore(element, place);
    if (!stays && typeof node !== "string" && node.attributes.reveal === true) {
      (element as Element).scrollIntoView({ block: "nearest" });
    }
    if (typeof node !== "string" && node.attributes.modal === true) cover(element as HTMLDialogElement);
  });
  for (const left of [...parent.childNodes].slice(nodes.length)) {
    if (left instanceof HTMLDialogElement) left.close(); // the focus goes back to where it was
    left.remove();
  }
  // what is moved among its siblings loses the focus
  if (focused !== document.activeElement && focused instanceof HTMLElement && parent.contains(focused)) focused.focus();
}

/** Let a dialog cover the page, also after it was moved among its siblings. */
function cover(dialog: HTMLDialogElement): void {
  if (dialog.matches(":modal")) return;
  dialog.close();
  dialog.showModal();
}

function matches(element: ChildNode | undefined, node: Node_ | string): element is ChildNode {
  if (element === undefined) return false;
  return typeof node === "string" ? element.nodeType === Node.TEXT_NODE : drawn.get(element)?.tag === node.tag;
}

function create(node: Node_ | string): ChildNode {
  if (typeof node === "string") return document.createTextNode(node);
  return SVG_TAGS.has(node.tag) ? document.createElementNS(SVG, node.tag) : document.createElement(node.tag);
}

function change(element: ChildNode, node: Node_ | string): void {
  if (typeof node === "string") {
    if (element.nodeValue !== node) element.nodeValue = node;
    return;
  }
  const target = element as Element & Record<string, unknown>;
  const before = drawn.get(element)?.attributes ?? {};
  drawn.set(element, node);
  // the children first: a select has its value only when it has its options
  if (node.attributes.raw !== true) draw(target, node.children);
  for (const name of Object.keys(before)) if (!(name in node.attributes)) set(target, name, null);
  for (const [name, value] of Object.entries(node.attributes)) if (before[name] !== value) set(target, name, value);
}

function set(element: Element & Record<string, unknown>, name: string, value: Value): void {
  if (name === "key" || name === "raw" || name === "reveal" || name === "modal") return;
  if (["value", "checked", "disabled", "muted"].includes(name)) element[name] = value ?? (name === "value" ? "" : false);
  else if (name === "style") (element as unknown as HTMLElement).style.cssText = String(value ?? ""); // as an attribute, the policy forbids it
  else if (name.startsWith("on")) element[name] = value ?? null;
  else if (value === null || value === undefined || value === false) element.removeAttribute(name);
  else element.setAttribute(name, value === true ? "" : String(value));
}
