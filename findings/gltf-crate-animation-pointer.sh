#!/usr/bin/env bash
# The crate gltf 1.4.1 refuses every file that animates a property by KHR_animation_pointer.
#
# Expected: an extension that is used and not required does not keep a reader from the rest of the file: glTF 2.0, section
# "Specifying extensions". KHR_animation_pointer (ratified) demands that a channel of its kind has no `target.node`.
# Khronos' validator (2.0.0-dev.3.10) finds no error in the file below.
# Seen: the crate's JSON types have `node` as a field that must be there, so parsing ends with "missing field `node`", and the
# meshes cannot be read either. The same file without the animation is read. A program that wants the meshes has to take the
# animations out of the JSON first.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
cargo init --quiet --name finding --vcs none .
cargo add --quiet gltf@=1.4.1
cat >src/main.rs <<'RUST'
const FILE: &str = r#"{
  "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
  "nodes": [{ "name": "lamp" }],
  "materials": [{ "name": "blinking" }],
  "buffers": [{ "byteLength": 16, "uri": "data:application/octet-stream;base64,AAAAAAAAgD8AAAAAAACAPw==" }],
  "bufferViews": [{ "buffer": 0, "byteLength": 8 }, { "buffer": 0, "byteOffset": 8, "byteLength": 8 }],
  "accessors": [
    { "bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR", "min": [0], "max": [1] },
    { "bufferView": 1, "componentType": 5126, "count": 2, "type": "SCALAR" }],
  "extensionsUsed": ["KHR_animation_pointer"],
  "animations": [{
    "samplers": [{ "input": 0, "output": 1 }],
    "channels": [{ "sampler": 0, "target": { "path": "pointer",
      "extensions": { "KHR_animation_pointer": { "pointer": "/materials/0/pbrMetallicRoughness/metallicFactor" } } } }]
  }]
}"#;
fn main() {
    if std::env::args().len() > 1 {
        return println!("{FILE}");
    }
    let name = |file: &[u8]| match gltf::Gltf::from_slice(file) {
        Ok(gltf) => format!("read, {} node", gltf.nodes().count()),
        Err(error) => format!("refused: {error}"),
    };
    println!("as it is:          {}", name(FILE.as_bytes()));
    let start = FILE.find("\"animations\"").unwrap();
    let without = format!("{}\n}}", FILE[..start].trim_end().trim_end_matches(','));
    println!("without animation: {}", name(without.as_bytes()));
}
RUST
npm install --prefix . --no-audit --no-fund --silent gltf-validator@2.0.0-dev.3.10
cargo build --quiet --release
target/release/finding file >in.gltf
cat >validate.js <<'JS'
const validator = require('gltf-validator');
validator.validateBytes(new Uint8Array(require('fs').readFileSync('in.gltf'))).then(report => console.log(`validator: ${report.issues.numErrors} errors`));
JS
node validate.js | tee validated
grep -q '^validator: 0 errors$' validated
target/release/finding | tee seen
grep -q '^as it is: *refused: .*missing field `node`' seen
grep -q '^without animation: read, 1 node$' seen
echo "as described"
