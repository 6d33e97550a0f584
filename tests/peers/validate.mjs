// validate.mjs FILE...: print {file: {errors, warnings, infos, hints, messages}} as the Khronos validator sees the files.

import { readFile } from "node:fs/promises";
import { dirname, resolve } from "node:path";
import validator from "gltf-validator";

async function validate(file) {
  const report = await validator.validateBytes(new Uint8Array(await readFile(file)), {
    uri: file,
    maxIssues: 0, // no limit
    externalResourceFunction: async (uri) =>
      new Uint8Array(await readFile(resolve(dirname(file), decodeURIComponent(uri)))),
  });
  const { numErrors, numWarnings, numInfos, numHints, messages } = report.issues;
  return { errors: numErrors, warnings: numWarnings, infos: numInfos, hints: numHints, messages };
}

const reports = {};
for (const file of process.argv.slice(2)) reports[file] = await validate(file);
console.log(JSON.stringify(reports));
