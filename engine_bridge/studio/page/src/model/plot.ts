/** Lines of a small plot. */

export interface Frame {
  readonly width: number;
  readonly height: number;
}

/** The smallest and largest of several series, a little apart if they are equal. */
export function range(...series: readonly (readonly number[])[]): [number, number] {
  let [low, high] = [Infinity, -Infinity];
  for (const values of series) {
    for (const value of values) {
      if (!Number.isFinite(value)) continue;
      low = Math.min(low, value);
      high = Math.max(high, value);
    }
  }
  if (low > high) return [0, 1];
  return low === high ? [low - 0.5, high + 0.5] : [low, high];
}

/** The path of a series through a frame, time to the right and values upwards; gaps where a value is not finite. */
export function path(
  times: readonly number[],
  values: readonly number[],
  [from, to]: readonly [number, number],
  [low, high]: readonly [number, number],
  { width, height }: Frame,
): string {
  let pen = "M";
  let made = "";
  times.forEach((time, i) => {
    const value = values[i] ?? Number.NaN;
    if (!Number.isFinite(value)) {
      pen = "M";
      return;
    }
    const x = ((time - from) / (to - from)) * width;
    const y = height - ((value - low) / (high - low)) * height;
    made += `${pen}${x.toFixed(1)} ${y.toFixed(1)}`;
    pen = "L";
  });
  return made;
}
