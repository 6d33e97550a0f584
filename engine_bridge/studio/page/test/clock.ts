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

/** Let time go by in which nothing runs, as in a tab that sleeps. */
export function sleep(milliseconds: number): void {
  now += milliseconds;
}

function stop(timer: number): void {
  timers = timers.filter(({ id }) => id !== timer);
}

Object.assign(globalThis, {
  setTimeout: (work: () => void, milliseconds = 0) => {
    timers.push({ id: ++made, at: now + milliseconds, work });
    return made;
  },
  setInterval: (work: () => void, milliseconds: number) => {
    const id = ++made;
    const wait = (): void => {
      timers.push({
        id,
        at: now + milliseconds,
        work: () => {
          wait();
          work();
        },
      });
    };
    wait();
    return id;
  },
  clearTimeout: stop,
  clearInterval: stop,
});
performance.now = () => now;
