let at = 'before the first';
(async () => {
  await opened;
  viewer.stopped = true;
  codebook = await files('words');
  const found = { scalar: 0, unpacked: 0, bptc: null, half: 0, texels: 0, gl_error: 0, same_bits: null };
  const note = (key, value, of) => { if (value > (found[key] ?? -1)) { found[key] = value; found[key + '_of'] = of; } };
  const gl = document.createElement('canvas').getContext('webgl2');
  // Compiled once for all decoders: that takes longer than most bundles.
  const programs = new Map();
  for (const name of NAMES_OF_BUNDLES) {
    const bytes = await files(name), light = new Float32Array((await files(name + '.light')).buffer);
    const decoders = { unpacked: { unpack: true, float: true }, half: {} };
    if (gl.getExtension('EXT_texture_compression_bptc')) decoders.bptc = { float: true };
    // What hardware unpacks does not depend on the network.
    if (name === 'contents-64') delete decoders.bptc;
    const open = Object.entries(decoders).map(([key, options]) => [key, new Decoder(gl, openBundle(bytes), options)]), bundle = openBundle(bytes);
    for (const [, decoder] of open) decoder.programs = programs;
    // Wide networks take software renderers long: four hours, a set, one beside a switch, one past noon and one before midnight.
    const wide = ['contents-32', 'contents-64'].includes(name);
    for (let hour = 0; hour < (wide ? 7 : HOURS.length); hour += wide ? 2 : 1) {
      for (let i = 0; i < bundle.tiles.length; i++) {
        const tile = bundle.tiles[i], expected = expectedOf(bundle, light, hour, tile), of = at = `${name}, tile ${i} at ${HOURS[hour]}`;
        found.texels += tile.ownWidth * tile.ownHeight;
        // All hours of a few texels would hide what single texels show: whole tiles, the large ones at two hours.
        if (tile.width * tile.height < 2000 || hour < 2) note('scalar', differenceOf(bundle, HOURS[hour], tile, decodeTile(bundle, tile, HOURS[hour]), expected), of);
        const read = {};
        for (const [key, decoder] of open) {
          // Below the smallest normal half the steps are as there.
          const least = key === 'half' ? 2 ** -14 / decoder.scaleAt(momentOf(bundle, HOURS[hour])) : 1e-30;
          note(key, differenceOf(bundle, HOURS[hour], tile, read[key] = decoder.readTile(decoder.bundle.tiles[i], HOURS[hour]), expected, least), of);
        }
        if (read.bptc) found.same_bits = found.same_bits !== false && read.bptc.every((e, i) => e === read.unpacked[i]);
      }
    }
    found.gl_error ||= gl.getError();
  }
  report(found);
})().catch(problem => report({ problem: String(problem.stack), at }));
