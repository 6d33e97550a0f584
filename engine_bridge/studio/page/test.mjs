// Bundles the tests of modules without a document, and runs them in this node.
import { build } from "esbuild";
import { spawnSync } from "node:child_process";
import { mkdtemp, readdir, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";

const root = new URL(".", import.meta.url).pathname;
const folder = await mkdtemp(join(tmpdir(), "studio-"));
const files = (await readdir(`${root}test`)).filter((name) => name.endsWith(".test.ts"));
await build({
  entryPoints: files.map((name) => `${root}test/${name}`),
  outdir: folder,
  outExtension: { ".js": ".mjs" },
  bundle: true,
  format: "esm",
  platform: "node",
});
const built = files.map((name) => join(folder, name.replace(/\.ts$/, ".mjs")));
const { status } = spawnSync(process.execPath, ["--test", ...built], { stdio: "inherit" });
await rm(folder, { recursive: true });
process.exit(status ?? 1);
