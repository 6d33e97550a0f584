/** Drags with a pointer. */

/**
 * Call a function while the pointer moves over an element, and another one when it is released. A browser that takes
 * the pointer away, such as for scrolling, ends the drag without it.
 */
export function untilRelease(element: EventTarget, drag: (event: PointerEvent) => void, released: () => void, cancelled: () => void): void {
  const ended = new AbortController();
  const on = (name: string, act: (event: PointerEvent) => void): void => {
    element.addEventListener(name, act as (event: Event) => void, { signal: ended.signal });
  };
  on("pointermove", drag);
  on("pointerup", () => {
    ended.abort();
    released();
  });
  on("pointercancel", () => {
    ended.abort();
    cancelled();
  });
}
