// decode.mjs FOLDER: decode each message FOLDER/*.bin with the JavaScript client. OUT of each: the message, with arrays as
// {type, base64}, or {refused: why}; printed as one JSON object by file name. Frames of controls are also evaluated, if the
// folder has a scene.bin.

import { readFile, readdir } from "node:fs/promises";
import { join } from "node:path";
import { Scene, WireError, decode, evaluate } from "../../integrations/web/puppetline.js";

function plain(_key, value) {
  if (typeof value === "bigint") return value.toString();
  if (ArrayBuffer.isView(value)) {
    const bytes = Buffer.from(value.buffer, value.byteOffset, value.byteLength);
    return { type: value.constructor.name, base64: bytes.toString("base64") };
  }
  return value;
}

const folder = process.argv[2];
const files = (await readdir(folder)).filter((name) => name.endsWith(".bin"));
const decoded = {};
for (const name of files) {
  try {
    decoded[name] = decode(await readFile(join(folder, name)));
  } catch (error) {
    if (!(error instanceof WireError)) throw error;
    decoded[name] = { refused: error.message };
  }
}
const scene = decoded["scene.bin"]?.body;
for (const message of Object.values(decoded)) {
  if (message.kind === "controls" && scene instanceof Scene) message.evaluated = evaluate(scene, message.body);
}
console.log(JSON.stringify(decoded, plain));
