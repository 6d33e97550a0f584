// decode.mjs FILE: decode messages with the JavaScript client; in FILE, each has its length (4 bytes) before it. OUT of each:
// the message, with arrays as {type, base64}, or {refused: why}; printed as one JSON list. Frames of controls that follow a
// scene are also evaluated.

import { readFile } from "node:fs/promises";
import { Scene, WireError, decode, evaluate } from "../../integrations/web/puppetline.js";

function plain(_key, value) {
  if (typeof value === "bigint") return value.toString();
  if (ArrayBuffer.isView(value)) {
    const bytes = Buffer.from(value.buffer, value.byteOffset, value.byteLength);
    return { type: value.constructor.name, base64: bytes.toString("base64") };
  }
  return value;
}

const file = await readFile(process.argv[2]);
const decoded = [];
let scene = null;
for (let at = 0; at < file.length; at += 4 + file.readUInt32LE(at)) {
  try {
    const message = decode(file.subarray(at + 4, at + 4 + file.readUInt32LE(at)));
    if (message.body instanceof Scene) scene = message.body;
    if (message.kind === "controls" && scene) message.evaluated = evaluate(scene, message.body);
    decoded.push(message);
  } catch (error) {
    if (!(error instanceof WireError)) throw error;
    decoded.push({ refused: error.message });
  }
}
console.log(JSON.stringify(decoded, plain));
