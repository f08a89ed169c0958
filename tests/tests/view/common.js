// Bundles and what they decode to, for all scripts of tests.

// What the decoder gives for the own texels of a tile.
function expectedOf(bundle, light, hour, tile) {
  const sizes = bundle.pages.map(page => 3 * page.width * page.height), all = sizes.reduce((a, b) => a + b);
  const from = hour * all + sizes.slice(0, tile.page).reduce((a, b) => a + b, 0), { width } = bundle.pages[tile.page];
  return (x, y, c) => light[from + 3 * ((PAYLOAD * tile.row + y) * width + PAYLOAD * tile.column + x) + c];
}

// The largest difference of a decoded tile, relative to max(E, mean/100).
function differenceOf(tile, decoded, expected) {
  const mean = [0, 0, 0];
  let worst = 0;
  for (const pass of [0, 1]) {
    for (let y = 0; y < tile.ownHeight; y++) {
      for (let x = 0; x < tile.ownWidth; x++) {
        for (let c = 0; c < 3; c++) {
          const e = expected(x, y, c);
          if (pass === 0) { mean[c] += e / tile.ownWidth / tile.ownHeight; continue; }
          const off = Math.abs(decoded[3 * ((y + 1) * tile.width + x + 1) + c] - e);
          if (off > 0 || Number.isNaN(off)) worst = Number.isNaN(off) ? Infinity : Math.max(worst, off / Math.max(e, mean[c] / 100, 1e-30));
        }
      }
    }
  }
  return worst;
}
