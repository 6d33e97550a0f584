/** The lasting key of this screen, from its address after `#key=`; it is kept for an address without one. */

import { remember, remembered } from "../storage";

const KEPT = "puppetline.screen";

export function screenKey(): string {
  const given = new URLSearchParams(location.hash.slice(1)).get("key");
  if (given !== null) remember(KEPT, given);
  return given ?? remembered(KEPT) ?? "";
}

/** Fetch with the key; fails unless the server accepts it. */
export async function fetched(path: string, key: string): Promise<Response> {
  const reply = await fetch(path, { headers: { authorization: `Bearer ${key}` } });
  if (!reply.ok) throw new Error(`${path}: ${reply.status}`);
  return reply;
}
