// Run by node behind the page's scripts: bundles decode as the crate decodes them. Arguments: the folder of bundles and of their light, hours.
'use strict';

const fs = require('fs');
const [folder, ...HOURS] = process.argv.slice(2).map((argument, i) => i ? Number(argument) : argument);
const read = name => new Uint8Array(fs.readFileSync(`${folder}/${name}`));
const names = fs.readdirSync(folder).filter(name => name.endsWith('.ndgi'));
codebook = read('words.bin');

let texels = 0, worst = [0, ''];
for (const name of names) {
  const bundle = openBundle(read(name)), light = new Float32Array(read(`${name}.light`).buffer);
  for (let hour = 0; hour < HOURS.length; hour++) {
    for (const [i, tile] of bundle.tiles.entries()) {
      // (Wide networks take long: whole tiles at two hours, else small ones.)
      if (tile.features && tile.width * tile.height > 4000 && hour > 1) continue;
      const off = differenceOf(bundle, HOURS[hour], tile, decodeTile(bundle, tile, HOURS[hour]), expectedOf(bundle, light, hour, tile));
      texels += tile.ownWidth * tile.ownHeight;
      if (!(off <= worst[0])) worst = [off, `${name}, tile ${i} at ${HOURS[hour]}`];
    }
  }
}
console.log(`${names.length} bundles, ${texels} texels; largest difference ${worst[0]} (${worst[1]})`);
// Of max(E, mean/100), as FORMAT.md, section 6, has it for single precision.
if (!(worst[0] <= 3e-4) || texels < 1e5) throw new Error('decoded light differs');
