/** Parts of sentences that several texts share. */

export const count = (n: number, one: string, many = `${one}s`): string => `${n.toLocaleString("en")} ${n === 1 ? one : many}`;

/** `take-3` as "Take 3, 6 seconds". */
export function takeTitle(name: string, seconds: number | null): string {
  const title = name.replace(/^take-(\d+)$/, "Take $1");
  return seconds === null ? title : `${title}, ${count(Math.max(1, Math.round(seconds)), "second")}`;
}

/** A rounded duration: "40 seconds", "2 minutes". */
export function duration(seconds: number): string {
  return seconds < 90 ? count(Math.max(1, Math.round(seconds)), "second") : count(Math.round(seconds / 60), "minute");
}
