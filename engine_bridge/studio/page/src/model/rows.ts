/** Rows of the film: its takes and those of the scene's tables. Each keeps its key while it is edited, wherever its time puts it. */

const keys = new WeakMap<object, string>();
let made = 0;

/** What tells a row from the others of its table. */
export function keyOf(row: object): string {
  const known = keys.get(row) ?? `row${++made}`;
  keys.set(row, known);
  return known;
}

/** Replace, add or remove (with null) a row of a list by its number; rows with a time stay in the order of their times. */
export function withItem<T extends { readonly at?: number | null }>(rows: readonly T[], index: number, row: T | null): readonly T[] {
  const before = rows[index];
  if (row !== null && before !== undefined) keys.set(row, keyOf(before));
  const changed = row === null ? rows.toSpliced(index, 1) : rows.toSpliced(index, 1, row);
  return changed.toSorted((a, b) => (a.at ?? 0) - (b.at ?? 0));
}

/** Give rows that the server has sent again the keys that they had: those of equal rows, and the rest in their order. */
export function keepKeys(before: readonly object[], after: readonly object[]): void {
  const left = new Map(before.map((row) => [row, JSON.stringify(row)]));
  const give = (row: object, old: object | undefined): boolean => {
    if (old !== undefined) keys.set(row, keyOf(old));
    return old !== undefined && left.delete(old);
  };
  const changed = after.filter((row) => {
    const text = JSON.stringify(row);
    return !give(row, [...left].find(([, each]) => each === text)?.[0]);
  });
  const rest = [...left.keys()];
  changed.forEach((row, i) => give(row, rest[i]));
}
