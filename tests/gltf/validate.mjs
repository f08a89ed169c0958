// Validates glTF files with Khronos' validator: node validate.mjs FOLDER FILE…, where FOLDER has it among its node_modules.
// Errors and warnings are printed; errors make the exit code 1.
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { resolve } from "node:path";

const [folder, ...files] = process.argv.slice(2);
const validator = createRequire(resolve(folder, "package.json"))("gltf-validator");
let errors = 0;
for (const file of files) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), { maxIssues: 100 });
  errors += report.issues.numErrors;
  for (const { severity, code, message, pointer } of report.issues.messages) {
    // 0 is an error, 1 a warning; the rest are remarks.
    if (severity < 2) {
      console.log(`${file}: ${severity === 0 ? "error" : "warning"} ${code} at ${pointer}: ${message}`);
    }
  }
}
console.log(`${files.length} files, ${errors} errors`);
process.exit(errors > 0 ? 1 : 0);
