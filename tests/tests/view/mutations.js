(async () => {
  await opened;
  viewer.stopped = true;
  codebook = await files('words');
  // Lehmer's generator: the same mutations every time.
  let state = 20250321;
  const random = n => { state = state * 48271 % 2147483647; return state % n; };
  const originals = [];
  for (const name of NAMES_OF_BUNDLES) {
    const bytes = await files(name);
    if (bytes.length < 60000) originals.push(bytes);
  }
  const found = { opened: 0, refused: 0, strange: [], gl_error: 0, originals: originals.length, drawn: 0 };
  const gl = document.createElement('canvas').getContext('webgl2');
  for (let i = 0; i < 2000; i++) {
    let bytes = originals[i % originals.length].slice();
    const view = () => new DataView(bytes.buffer), header = view().getUint32(12, true), kind = random(8);
    if (kind === 0) bytes = bytes.slice(0, random(bytes.length));
    for (let n = 1 + random(4); kind > 0 && n > 0; n--) {
      // Half of them in header and index, where they do most.
      const at = random(2) ? random(bytes.length) : 8 + random(Math.min(header, bytes.length) - 8);
      if (kind < 5) bytes[at] ^= 1 << random(8);
      else if (kind === 5) bytes[at] = [0, 255, 127, 128][random(4)];
      else if (at + 4 <= bytes.length) view().setUint32(at, [0, 1, 0xffffffff, 0x7fffffff, 0x10000, 16][random(6)], true);
    }
    try {
      const bundle = openBundle(bytes);
      for (const hour of [12, 5.93, 20.3]) {
        for (const tile of bundle.tiles.slice(0, 3)) decodeTexel(bundle, tile, hour, random(tile.width), random(tile.height));
      }
      if (i % 20 === 0) {
        const decoder = new Decoder(gl, bundle);
        decoder.decode(12);
        decoder.pages.forEach(page => { gl.deleteFramebuffer(page.frame); gl.deleteTexture(page.texture); });
        found.drawn++;
      }
      found.opened++;
    } catch (problem) {
      if (problem.constructor === Error) found.refused++;
      else if (found.strange.length < 5) found.strange.push(`${i}: ${problem.stack}`);
    }
    found.gl_error ||= gl.getError();
  }
  report(found);
})().catch(problem => report({ problem: String(problem.stack) }));
