/** A clock that a test turns. */

let now = 0;
let timers: { readonly id: number; readonly at: number; readonly work: () => void }[] = [];
let made = 0;

/** Let all that is ready happen. */
export const soon = (): Promise<void> => new Promise((resolve) => setImmediate(resolve));

/** Let the clock run, and all that waits for it. */
export async function pass(milliseconds: number): Promise<void> {
  const end = now + milliseconds;
  for (;;) {
    await soon();
    const next = timers.filter(({ at }) => at <= end).sort((a, b) => a.at - b.at || a.id - b.id)[0];
    if (next === undefined) break;
    timers = timers.filter(({ id }) => id !== next.id);
    now = Math.max(now, next.at);
    next.work();
  }
  now = end;
}

Object.assign(globalThis, {
  setTimeout: (work: () => void, milliseconds = 0) => {
    timers.push({ id: ++made, at: now + milliseconds, work });
    return made;
  },
  clearTimeout: (timer: number) => {
    timers = timers.filter(({ id }) => id !== timer);
  },
});
performance.now = () => now;
