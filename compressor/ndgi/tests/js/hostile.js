// Run by node behind the page's scripts: changed bundles are refused, or give finite light. Arguments: a bundle, the number of changes.
'use strict';

const [path, rounds] = process.argv.slice(2), original = new Uint8Array(require('fs').readFileSync(path));
// Lehmer's generator: the same changes every time.
let state = 20250321;
const random = n => { state = state * 48271 % 2147483647; return state % n; };
const header = new DataView(original.buffer).getUint32(12, true), found = { decoded: 0, refused: 0 };
for (let round = 0; round < Number(rounds); round++) {
  const bytes = original.slice(), view = new DataView(bytes.buffer);
  for (let n = 1 + random(4); n > 0; n--) {
    // Most of them in the tiles' sections: no checksum is looked at.
    const at = random(4) ? header + random(bytes.length - header) : 8 + random(header - 8), kind = random(4);
    if (kind < 2) bytes[at] ^= 1 << random(8);
    else if (kind === 2) bytes[at] = [0, 255, 127, 128][random(4)];
    else if (at + 4 <= bytes.length) view.setUint32(at, [0, 1, 0xffffffff, 0x7fffffff, 0x10000, 16][random(6)], true);
  }
  try {
    const bundle = openBundle(round % 10 ? bytes : bytes.slice(0, random(bytes.length)));
    for (const hour of [12, 5.93, 20.3]) {
      for (const tile of bundle.tiles) {
        if (!decodeTile(bundle, tile, hour).every(light => Number.isFinite(light) && light >= 0)) throw new TypeError(`change ${round}: light that is not finite`);
      }
    }
    found.decoded++;
  } catch (problem) {
    // Nothing but the readers' own errors.
    if (problem.constructor !== Error) throw problem;
    found.refused++;
  }
}
console.log(JSON.stringify(found));
if (found.decoded < rounds / 10 || found.refused < rounds / 10) throw new Error('hardly any changed bundle was decoded, or refused');
