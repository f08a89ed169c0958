(async () => {
  await opened;
  const found = {}, { gl } = viewer, [width, height] = SHOWN.size, { camera } = SHOWN;
  const target = viewer.decoder.target(width, height, gl.RGBA8), wide = viewer.decoder.target(width, height, gl.RGBA16F);
  viewer.depth(target);
  viewer.depth(wide);
  viewer.camera = new Camera('preview', camera.position, camera.look_at, camera.fov);
  viewer.canvas.width = width;
  viewer.canvas.height = height;
  const exposed = hour => {
    viewer.setHour(hour);
    viewer.stale = true;
    viewer.expose();
    return viewer.state.exposure;
  };
  found.exposure_off_by_night = Math.abs(exposed(0) - SHOWN_BY_NIGHT.exposure);
  // And as if all were painted black.
  const materials = new Set(viewer.scene.draws.map(draw => draw.material)), paint = factor => materials.forEach(material => { material.base = material.base.map((x, i) => i < 3 ? factor * x : x); });
  paint(1 / 64);
  found.exposure_off_in_black = Math.abs(exposed(0) - SHOWN_BY_NIGHT.exposure - 6);
  paint(64);
  found.exposure_off = Math.abs(exposed(12) - SHOWN.exposure);
  viewer.state.exposure = SHOWN.exposure;
  viewer.state.pinned = true;

  // The preview, and where a surface with texels is in view.
  const sheet = new OffscreenCanvas(width, height).getContext('2d');
  sheet.drawImage(await createImageBitmap(new Blob([await files('preview')], { type: 'image/png' })), 0, 0);
  const preview = sheet.getImageData(0, 0, width, height).data, places = new Float32Array(4 * width * height), shown = new Uint8Array(4 * width * height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, wide.frame);
  gl.viewport(0, 0, width, height);
  viewer.scene.draw(viewer.camera, width, height, 2, viewer.drawn());
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, places);
  const near = (i, j) => Math.abs(places[4 * i + 1] - places[4 * j + 1]) + Math.abs(places[4 * i + 2] - places[4 * j + 2]) < 0.03 && places[4 * j] > 0.5;
  const inner = [];
  for (let y = 2; y < height - 2; y++) {
    for (let x = 2; x < width - 2; x++) {
      const i = y * width + x;
      if (places[4 * i] > 0.5 && [-2, -1, 1, 2].every(d => near(i, i + d) && near(i, i + d * width))) inner.push(i);
    }
  }
  found.pixels = inner.length;
  const compare = () => {
    viewer.drawTo(target.frame, width, height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, shown);
    const off = inner.flatMap(i => {
      const other = (height - 1 - Math.floor(i / width)) * width + i % width;
      return [0, 1, 2].map(c => Math.abs(shown[4 * i + c] - preview[4 * other + c]));
    }).sort((a, b) => a - b);
    return { mean: off.reduce((a, b) => a + b, 0) / off.length, p99: off[Math.floor(off.length * 0.99)], most: off[off.length - 1] };
  };
  found.decoded = compare();
  viewer.state.view = 'reference';
  await viewer.loadReference();
  found.reference = compare();
  found.gl_error = gl.getError();

  report(found);
})().catch(problem => report({ problem: String(problem.stack) }));
