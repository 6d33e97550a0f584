/** The lasting key of this screen, from its address after `#key=`; it is kept for an address without one. */

import { remember, remembered } from "../storage";

const KEPT = "puppetline.screen";

export function screenKey(): string {
  const given = new URLSearchParams(location.hash.slice(1)).get("key");
  if (given !== null) remember(KEPT, given);
  return given ?? remembered(KEPT) ?? "";
}

/** Fetch with the key; fails unless the server accepts it, and after a time in milliseconds. */
export async function fetched(path: string, key: string, longest?: number): Promise<Response> {
  const signal = longest === undefined ? null : AbortSignal.timeout(longest);
  const reply = await fetch(path, { headers: { authorization: `Bearer ${key}` }, signal });
  if (!reply.ok) throw new Error(`${path}: ${reply.status}`);
  return reply;
}
