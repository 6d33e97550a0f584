/** What lets a screen go on by itself, after its display slept, its network was away, or its graphics card has failed. */

/** Time that the browser has to give a lost drawing surface back, in milliseconds; then the page is loaded again. */
const LOST_MS = 3000;

/** Load the page again soon; return the timer, with which that can be prevented. */
export function reloadSoon(): ReturnType<typeof setTimeout> {
  return setTimeout(() => {
    location.reload();
  }, LOST_MS);
}

/**
 * Keep the display on, and reconnect as soon as the page is seen again. The browser lets the display sleep whenever the
 * page was hidden. Without HTTPS, only a browser on the machine of the service can keep it on.
 */
export function keepAwake(reconnect: () => void): void {
  const seen = (): void => {
    if (document.visibilityState !== "visible") return;
    reconnect();
    if ("wakeLock" in navigator) navigator.wakeLock.request("screen").catch(() => undefined); // for example an empty battery
  };
  document.addEventListener("visibilitychange", seen);
  window.addEventListener("online", reconnect);
  seen();
}

/** Load the page again if its drawing surface is lost and not given back. */
export function reloadIfLost(canvas: HTMLCanvasElement): void {
  let timer: ReturnType<typeof setTimeout> | undefined;
  canvas.addEventListener("webglcontextlost", () => {
    timer = reloadSoon();
  });
  canvas.addEventListener("webglcontextrestored", () => {
    clearTimeout(timer);
  });
}
