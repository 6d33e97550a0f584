/** A screen without an interface: the visitors' at `/kiosk`, and the characters alone at `/stage`. */

import { Client } from "../../../../../integrations/web/puppetline.js";
import { address } from "../connection";
import { draw } from "../dom";
import type { ScreenSettings, ServiceReport } from "../messages";
import { keepAwake } from "./awake";
import { Characters } from "./characters";
import { fetched, screenKey } from "./key";
import { kiosk } from "./kiosk";
import { type Seen, newest, noticed, phaseOf } from "./phase";

/** Interval at which the settings are fetched, without a service too, and at which the words are drawn, in milliseconds. */
const SETTINGS_MS = 2000;
const AWAY_MS = 400;
const WORDS_MS = 250;

/** Time after which a request for the settings is given up, so that they do not pile up without a network, in milliseconds. */
const REQUEST_MS = 5000;

const query = new URLSearchParams(location.search);
const isKiosk = location.pathname === "/kiosk";
const key = screenKey();

const place = document.createElement("div");
place.className = "characters";
const over = document.createElement("div");
over.className = "over";
document.body.className = isKiosk ? "kiosk" : query.has("transparent") ? "stage transparent" : "stage";
document.body.append(place, over);

const client = new Client(address("/stream"), { token: key });
const characters = new Characters(place, client, key, query.get("character"), isKiosk);

let settings: ScreenSettings | null = null;
let report: ServiceReport | null = null;
let seen: Seen | null = null;
let recordedSince: number | null = null;
let problem = "";

client.subscribe("service/status", ({ body }) => {
  const fresh = body as unknown as ServiceReport;
  seen = noticed(fresh, report, seen, performance.now());
  report = fresh;
  show();
});

/** The server may have restarted, perhaps with another page, and the network or the materials may have changed. */
async function refresh(): Promise<void> {
  try {
    const fresh = (await (await fetched("/screen", key, REQUEST_MS)).json()) as ScreenSettings;
    if (settings !== null && settings.version !== fresh.version) location.reload();
    [settings, problem] = [fresh, ""];
    characters.dress(fresh.models);
    client.retry(); // without the pause after each failure; or the key is valid again
  } catch (error) {
    problem = error instanceof Error && error.message.endsWith("401") ? "401" : "offline";
  }
}

function show(): void {
  const now = performance.now();
  const screen = settings?.kiosk ?? null;
  if (!isKiosk || screen === null) {
    draw(over, [problem === "401" && isKiosk && "This screen's key is not valid any more. Open the address that the terminal shows."]);
    return;
  }
  const { style } = document.documentElement;
  for (const name of ["background", "color", "accent"] as const) style.setProperty(`--${name}`, screen[name]);
  const connected = client.state === "connected" && problem === "";
  const phase = report === null ? { kind: "attract" as const } : phaseOf(report, seen, now);
  document.body.dataset.phase = phase.kind;
  recordedSince = phase.kind === "recording" ? (recordedSince ?? now) : null;
  const recorded = recordedSince === null ? 0 : (now - recordedSince) / 1000;
  const making = report?.clips.some(({ seconds_left }) => seconds_left === null) ?? false;
  characters.working = making;
  draw(over, kiosk(screen, { phase, film: report === null ? null : newest(report), making, recorded, connected }));
}

/** What tests and measurements read. */
Object.assign(window, { screenShows: { characters, report: () => report, state: () => client.state } });

async function refreshAgain(): Promise<void> {
  await refresh();
  setTimeout(() => void refreshAgain(), client.state === "connected" && problem === "" ? SETTINGS_MS : AWAY_MS);
}

setInterval(show, WORDS_MS);
void refreshAgain();
show();
keepAwake(() => {
  client.retry();
});
