/** The film's titles over the view while it plays. */

import { type State } from "../store";

/** Duration of a title and share of the view's height when none was chosen. */
const [SECONDS, SIZE] = [3, 0.09];

/** Show the titles of a second of the film, which changes in every image. */
export function showTitles({ film, server }: State, seconds: number): void {
  const box = document.querySelector<HTMLElement>(".shown-titles");
  if (box === null) return;
  const rows = server?.timeline == null ? [] : film.present.scene.title.filter(({ at = 0, seconds: long = SECONDS }) => at <= seconds && seconds < at + long);
  const written = JSON.stringify(rows);
  if (box.dataset.rows === written) return;
  box.dataset.rows = written;
  box.replaceChildren(
    ...rows.map(({ text, place = "middle", size = SIZE, color = "white", font = "plain" }) => {
      const title = document.createElement("p");
      title.className = `${place} ${font}`;
      title.textContent = text;
      title.style.fontSize = `${100 * size}cqh`;
      title.style.color = color;
      return title;
    }),
  );
}
