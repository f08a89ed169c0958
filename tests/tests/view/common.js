// Bundles and what they decode to, for all scripts of tests.

// What the decoder gives for the own texels of a tile.
function expectedOf(bundle, light, hour, tile) {
  const sizes = bundle.pages.map(page => 3 * page.width * page.height), all = sizes.reduce((a, b) => a + b);
  const from = hour * all + sizes.slice(0, tile.page).reduce((a, b) => a + b, 0), { width } = bundle.pages[tile.page];
  return (x, y, c) => light[from + 3 * ((PAYLOAD * tile.row + y) * width + PAYLOAD * tile.column + x) + c];
}

// The largest difference of a decoded tile, relative to max(E, mean/100). The mean is what the network's output or the share of the sun is multiplied with, or that
// over the texels if it is more.
function differenceOf(bundle, hour, tile, decoded, expected, least = 1e-30) {
  const moment = momentOf(bundle, hour), sun = bundle.sun && tile.levels && sunAt(bundle.sun, moment.t), mean = [0, 0, 0];
  const each = visit => { for (let y = 0; y < tile.ownHeight; y++) for (let x = 0; x < tile.ownWidth; x++) for (let c = 0; c < 3; c++) visit(x, y, c, expected(x, y, c)); };
  each((x, y, c, e) => { mean[c] += e / tile.ownWidth / tile.ownHeight; });
  for (let c = 0; c < 3; c++) {
    const stored = tile.means ? (1 - moment.g) * tile.means[3 * moment.i + c] + moment.g * tile.means[3 * moment.j + c] : 0;
    mean[c] = Math.max(mean[c], stored, sun ? sun.irradiance[c] : 0);
  }
  let worst = 0;
  each((x, y, c, e) => {
    const off = Math.abs(decoded[3 * ((y + 1) * tile.width + x + 1) + c] - e);
    worst = Number.isNaN(off) ? Infinity : Math.max(worst, off > 0 ? off / Math.max(e, mean[c] / 100, least) : 0);
  });
  return worst;
}
