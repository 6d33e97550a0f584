/** Rows of the scene's tables: each keeps its key while it is edited, wherever its time puts it. */

const keys = new WeakMap<object, string>();
let made = 0;

/** What tells a row from the others of its table. */
export function keyOf(row: object): string {
  const known = keys.get(row) ?? `row${++made}`;
  keys.set(row, known);
  return known;
}

/** Replace, add or remove (with null) a row of a list by its number; rows with a time stay in the order of their times. */
export function withItem<T extends { readonly at?: number }>(rows: readonly T[], index: number, row: T | null): readonly T[] {
  const before = rows[index];
  if (row !== null && before !== undefined) keys.set(row, keyOf(before));
  const changed = row === null ? rows.toSpliced(index, 1) : rows.toSpliced(index, 1, row);
  return changed.toSorted((a, b) => (a.at ?? 0) - (b.at ?? 0));
}

/** Give the rows of all tables the keys that those of the same numbers had before: the server has sent them anew. */
export function keepKeys<T extends object>(before: T, after: T): void {
  for (const [name, rows] of Object.entries(after)) {
    const old: unknown = before[name as keyof T];
    if (Array.isArray(rows) && Array.isArray(old)) rows.forEach((row: object, i) => old[i] !== undefined && keys.set(row, keyOf(old[i] as object)));
  }
}
