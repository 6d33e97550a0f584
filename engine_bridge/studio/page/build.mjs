// Builds the page into dist/: the page and the screen, each a script, a style sheet and a document, all from this folder
// and integrations/web; and the player of a .glb, which documents contain.
import { build } from "esbuild";
import { copyFile, cp, mkdir, rm } from "node:fs/promises";

const root = new URL(".", import.meta.url).pathname;
await rm(`${root}dist`, { recursive: true, force: true });
await mkdir(`${root}dist/assets`, { recursive: true });
const options = {
  bundle: true,
  target: "es2022",
  minify: true,
  legalComments: "eof",
  nodePaths: [`${root}node_modules`], // integrations/web imports three from here
  logLevel: "warning",
};
await build({ ...options, entryPoints: [`${root}src/start.ts`], outfile: `${root}dist/assets/studio.js`, format: "esm" });
await build({ ...options, entryPoints: [`${root}src/screen/start.ts`], outfile: `${root}dist/assets/screen.js`, format: "esm" });
await build({ ...options, entryPoints: [`${root}src/player.ts`], outfile: `${root}dist/player.js`, format: "iife" });
for (const name of ["style", "screen"]) {
  await build({ entryPoints: [`${root}${name}.css`], outfile: `${root}dist/assets/${name}.css`, bundle: true, minify: true, external: ["/typefaces/*"] });
}
await cp(`${root}pictures`, `${root}dist/assets`, { recursive: true });
for (const name of ["index", "screen"]) await copyFile(`${root}${name}.html`, `${root}dist/${name}.html`);
