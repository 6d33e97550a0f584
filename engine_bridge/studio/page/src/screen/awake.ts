/** Keeps the display on: a browser lets it sleep again whenever the page was hidden. */

/** Ask now, and whenever the page is seen again. Without HTTPS, other machines than this one cannot ask. */
export function keepAwake(): void {
  const ask = (): void => {
    if (document.visibilityState !== "visible" || !("wakeLock" in navigator)) return;
    navigator.wakeLock.request("screen").catch(() => undefined); // for example an empty battery
  };
  document.addEventListener("visibilitychange", ask);
  ask();
}
