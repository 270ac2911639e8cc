// Usage: node validate.mjs FILE.glb…
// Prints every error and warning of the Khronos glTF validator; exits 1 if a file has errors or cannot be read.
import { readFile } from "node:fs/promises";
import validator from "gltf-validator";

const files = process.argv.slice(2);
if (files.length === 0) {
  console.error("usage: node validate.mjs FILE.glb…");
  process.exit(2);
}
const severities = ["error", "warning"];
let failed = false;
for (const file of files) {
  try {
    const bytes = new Uint8Array(await readFile(file));
    const { issues } = await validator.validateBytes(bytes, { uri: file, maxIssues: 100 });
    for (const { severity, code, message, pointer } of issues.messages) {
      if (severity < severities.length) {
        console.log(`${file}: ${severities[severity]}: ${code}: ${message} (${pointer ?? "file"})`);
      }
    }
    console.log(`${file}: ${issues.numErrors} errors, ${issues.numWarnings} warnings`);
    failed ||= issues.numErrors > 0;
  } catch (error) {
    console.log(`${file}: error: ${error.message ?? error}`);
    failed = true;
  }
}
process.exit(failed ? 1 : 0);
