/** Requests to the server, and what the page shows meanwhile. */

import { Connection, Refusal } from "./connection";
import { update } from "./store";

export const connection = new Connection();

export const download = (id: string): Promise<Blob> => connection.download(id);

/** Do work while the page shows `text`. If the work fails, the page shows the error, and the result is null. */
export async function doing<T>(text: string, work: () => Promise<T>): Promise<T | null> {
  update(({ busy, since }) => ({ busy: [...busy, text], since: { ...since, [text]: performance.now() }, notice: null }));
  try {
    return await work();
  } catch (error) {
    if (error instanceof Refusal || (error instanceof Error && error.message !== "")) {
      update({ notice: { level: "error", text: error.message } });
    }
    return null;
  } finally {
    update(({ busy }) => ({ busy: busy.toSpliced(busy.indexOf(text), 1) }));
  }
}

export const request = <T>(text: string, what: string, values: object = {}): Promise<T | null> =>
  doing(text, () => connection.request<T>(what, values));

/** Pauses before what has failed is tried again, in milliseconds. */
const PAUSES = [1000, 4000, 16_000];

/** Do work that may fail for a while, such as loading a picture, at most four times. */
export async function tried<T>(work: () => Promise<T>): Promise<T> {
  for (const pause of PAUSES) {
    try {
      return await work();
    } catch {
      await new Promise((resolve) => setTimeout(resolve, pause));
    }
  }
  return work();
}
