/** Undo and redo of values that are replaced as a whole. */

export interface History<T> {
  readonly past: readonly T[];
  readonly present: T;
  readonly future: readonly T[];
}

/** Maximum number of steps that can be undone. */
export const MAX_STEPS = 200;

export function begin<T>(present: T): History<T> {
  return { past: [], present, future: [] };
}

/** Add a step; what was undone before is lost. */
export function commit<T>(history: History<T>, present: T): History<T> {
  return { past: [...history.past, history.present].slice(-MAX_STEPS), present, future: [] };
}

/** Replace the present without a step; a neighbour that equals it is no step any more. */
export function settle<T>({ past, future }: History<T>, present: T): History<T> {
  const isPresent = (value: T | undefined): boolean => JSON.stringify(value) === JSON.stringify(present);
  return { past: isPresent(past.at(-1)) ? past.slice(0, -1) : past, present, future: isPresent(future[0]) ? future.slice(1) : future };
}

export function undo<T>(history: History<T>): History<T> {
  const present = history.past.at(-1);
  if (present === undefined) return history;
  return { past: history.past.slice(0, -1), present, future: [history.present, ...history.future] };
}

export function redo<T>(history: History<T>): History<T> {
  const [present, ...future] = history.future;
  if (present === undefined) return history;
  return { past: [...history.past, history.present], present, future };
}
