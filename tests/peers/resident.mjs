// resident.mjs: run scripts of this folder, each as a process of its own would, but load their libraries only once.
//
// A request is a line of JSON on standard input, {"script", "arguments"}; its answer is a line of JSON on standard output,
// {"output", "error"}: what the script printed, and null or why it failed.

import { createInterface } from "node:readline";

let printed = "";
console.log = (text) => (printed += `${text}\n`);

let count = 0;
for await (const line of createInterface({ input: process.stdin })) {
  const request = JSON.parse(line);
  process.argv.splice(2, Infinity, ...request.arguments);
  printed = "";
  let error = null;
  try {
    await import(`./${request.script}?${count++}`); // another query runs the script again
  } catch (failure) {
    error = failure.stack;
  }
  process.stdout.write(`${JSON.stringify({ output: printed, error })}\n`);
}
