(async () => {
  await opened;
  const found = {}, { gl } = viewer, [width, height] = SHOWN.size, { camera } = SHOWN, wait = () => new Promise(requestAnimationFrame);
  const target = viewer.decoder.target(width, height, gl.RGBA8), wide = viewer.decoder.target(width, height, gl.RGBA16F);
  viewer.depth(target);
  viewer.depth(wide);
  viewer.camera = new Camera('preview', camera.position, camera.look_at, camera.fov);
  viewer.canvas.width = width;
  viewer.canvas.height = height;
  viewer.stale = true;
  viewer.expose();
  found.exposure_off = Math.abs(viewer.state.exposure - SHOWN.exposure);
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
  viewer.state.view = 'decoded';
  found.gl_error = gl.getError();

  // What the page does for its visitor.
  const press = key => dispatchEvent(new KeyboardEvent('keydown', { key }));
  window.dispatchEvent(new Event('resize'));
  const at = inner[inner.length >> 1];
  await viewer.inspect({ page: 0, x: Math.floor(places[4 * at + 1] * viewer.pages[0].width), y: Math.floor(places[4 * at + 2] * viewer.pages[0].height) });
  found.texel = document.getElementById('texel').textContent;
  const before = viewer.state.hour;
  press('ArrowRight');
  found.steps = Math.abs(viewer.state.hour - before - 1 / 12) < 1e-6;
  press(' ');
  await wait(); await wait(); await wait();
  found.plays = viewer.state.playing && viewer.state.hour !== before + 1 / 12;
  press(' ');
  found.views = true;
  for (const name of ['reference', '×8 difference', 'bits per tile', 'decoded']) {
    const button = [...document.querySelectorAll('#views button')].find(button => button.textContent === name);
    button.click();
    await wait(); await wait();
    found.views &&= button.getAttribute('aria-pressed') === 'true';
  }
  [...document.querySelectorAll('#spaces button')][1].click();
  await wait(); await wait();
  const picked = viewer.pick(viewer.window.x + 10.5 / viewer.window.zoom, viewer.window.y + 20.5 / viewer.window.zoom);
  found.atlas = viewer.state.space === 'atlas' && picked.x === 10 && picked.y === 20;
  const pinned = viewer.state.pinned;
  press('p');
  found.pins = viewer.state.pinned === !pinned;
  found.black_is_told = document.getElementById('facts').textContent.includes('no texels');
  // As narrow as a phone nothing is wider than the window.
  document.body.style.width = '390px';
  document.getElementById('top').style.width = document.getElementById('bottom').style.width = '390px';
  found.fits_a_phone = ['top', 'bottom'].every(id => document.getElementById(id).scrollWidth <= 390);
  found.gl_error ||= gl.getError();
  report(found);
})().catch(problem => report({ problem: String(problem.stack) }));
