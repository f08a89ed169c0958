// The page: what it shows, what its controls do, and what it says of a texel.
'use strict';

const $ = id => document.getElementById(id);
const NAMES = { decoded: 'decoded', reference: 'reference', difference: '×8 difference', bits: 'bits per tile' };
// Seconds of a day that plays.
const DAY_SECONDS = 48;
const clock = hour => { const minutes = Math.round(60 * hour) % 1440; return `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, '0')}`; };
const digits = x => x === 0 ? '0' : Math.abs(x) >= 1000 || Math.abs(x) < 0.001 ? x.toExponential(2) : x.toPrecision(3);
// The hour that an address asks for, as `hour=18.5` or `hour=18:30`, if it does.
function hourOf(hash) {
  const found = hash.replace(/%3a/i, ':').match(/\bhour=(\d+)(?::([0-5]?\d)|(\.\d*))?(?=&|$)/);
  return found && mod(Number(found[1] + (found[3] ?? '')) + Number(found[2] ?? 0) / 60, 24);
}
const luminance = ([r, g, b]) => 0.2126 * r + 0.7152 * g + 0.0722 * b;

// Bytes by name: of the page itself, or of the server it came from.
async function dataOf(name) {
  const element = $(`data-${name}`);
  if (element) {
    const text = element.textContent;
    element.remove();
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const binary = atob(text), bytes = new Uint8Array(binary.length);
    for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
    return bytes;
  }
  const answer = await fetch(`data/${name}`);
  if (!answer.ok) refuse(`the server does not have ${name} (${answer.status})`);
  return new Uint8Array(await answer.arrayBuffer());
}

class Viewer {
  async open() {
    this.meta = JSON.parse($('meta').textContent);
    this.canvas = $('view');
    const gl = this.gl = this.canvas.getContext('webgl2', { antialias: true, alpha: false, powerPreference: 'high-performance' });
    if (!gl) refuse('this browser has no WebGL 2');
    this.canvas.addEventListener('webglcontextlost', event => { event.preventDefault(); this.stop(new Error('the browser took back the graphics card; load the page again')); });
    // Whether the page has all data in it.
    this.whole = $('data-bundle') !== null;
    const bundle = this.bundle = openBundle(await dataOf('bundle'));
    if (bundle.tiles.some(tile => tile.shadows)) codebook = await dataOf('words');
    this.decoder = new Decoder(gl, bundle, { unpack: location.hash.includes('unpack') });
    // `hour` is what is shown; `clock`, by which the day plays, goes on between the hours of references.
    this.state = { hour: hourOf(location.hash) ?? 12, clock: 0, view: 'decoded', space: 'atlas', page: 0, playing: false, walks: false, pinned: false, game: false, exposure: 0 };
    this.scene = this.meta.scene_file ? await Scene.open(gl, await dataOf('scene'), bundle.pages.length) : null;
    if (this.scene?.draws.length) this.state.space = 'scene';
    this.pages = this.decoder.pages.map((page, i) => ({ ...page, bits: this.bitsOf(i) }));
    this.references = new Map();
    this.masks = [];
    this.atlas = compile(gl, COVER, PAGE_FRAGMENT);
    this.small = this.decoder.target(96, 54, gl.RGBA16F);
    this.depth(this.small);
    this.setCameras();
    this.build();
    this.listen();
    this.decode();
    this.fit();
    $('message').textContent = '';
    for (const id of ['top', 'bottom']) $(id).hidden = false;
    this.redraw();
    this.frame();
  }

  stop(problem) {
    this.state && (this.state.playing = false);
    this.stopped = true;
    $('message').className = 'wrong';
    $('message').textContent = `${this.meta?.title ?? 'bundle'}: ${problem.message}`;
  }

  // A depth buffer for a target.
  depth(target) {
    const { gl } = this, buffer = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, target.width, target.height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, buffer);
  }

  // Per tile a colour by its bits per texel and frame: blue is none, yellow as many as the largest tiles have, or more.
  bitsOf(page) {
    const { gl } = this, { columns, rows } = this.bundle.pages[page], { tiles } = this.bundle, data = new Uint8Array(4 * columns * rows);
    const area = tile => tile.ownWidth * tile.ownHeight, large = tiles.reduce((most, tile) => Math.max(most, area(tile)), 0) / 2;
    const most = tiles.filter(tile => area(tile) >= large).reduce((most, tile) => Math.max(most, this.bitsOfTile(tile)), 1e-9);
    for (const tile of tiles) {
      const x = Math.min(this.bitsOfTile(tile) / most, 1);
      if (tile.page === page) data.set([255 * x, 40 + 180 * x, 130 - 90 * x, 255], 4 * (tile.row * columns + tile.column));
    }
    this.mostBits = most;
    const texture = this.decoder.texture(gl.TEXTURE_2D, gl.RGBA8, columns, rows);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, columns, rows, gl.RGBA, gl.UNSIGNED_BYTE, data);
    return texture;
  }
  bytesOfTile(tile) { return [tile.features, tile.planes, tile.levels, tile.shadows].reduce((sum, part) => sum + (part?.length ?? 0), 0); }
  bitsOfTile(tile) { return 8 * this.bytesOfTile(tile) / (tile.ownWidth * tile.ownHeight * this.bundle.hours.length); }

  setCameras() {
    if (!this.scene) { this.cameras = []; return; }
    const told = this.meta.cameras.map(camera => new Camera(camera.name, camera.position, camera.look_at, camera.fov));
    this.cameras = [...told, ...this.scene.cameras];
    if (!this.cameras.length) this.cameras.push(this.scene.overview());
    this.camera = this.cameras[0].copy();
  }

  // ---- What is on the page ----

  choice(id, names, pick, chosen) {
    $(id).replaceChildren(...names.map(([key, text, title]) => {
      const button = document.createElement('button');
      button.textContent = text;
      if (title) button.title = title;
      button.dataset.key = key;
      button.onclick = () => { pick(key); this.redraw(); };
      return button;
    }));
    (this.choices ??= []).push(() => { for (const button of $(id).children) button.setAttribute('aria-pressed', String(button.dataset.key === String(chosen()))); });
  }

  build() {
    const { state, bundle, meta } = this;
    document.title = `${bundle.scene}: the day`;
    $('title').textContent = bundle.scene;
    const spaces = this.scene?.draws.length ? [['scene', 'scene', 'M']] : [];
    bundle.pages.forEach((_, i) => spaces.push([`atlas ${i}`, bundle.pages.length > 1 ? `page ${i + 1}` : 'atlas', 'M']));
    this.choice('spaces', spaces, key => { [state.space, state.page] = [key.split(' ')[0], Number(key.split(' ')[1] ?? state.page)]; this.fit(); }, () => state.space === 'scene' ? 'scene' : `atlas ${state.page}`);
    this.shown = VIEWS.filter(view => meta.reference.hours.length || view === 'decoded' || view === 'bits');
    this.choice('views', this.shown.map(view => [view, NAMES[view], 'V']), view => this.setView(view), () => state.view);
    this.choice('cameras', this.cameras.map((camera, i) => [i, camera.name, String(i + 1)]), i => this.setCamera(Number(i)), () => this.at);
    if (this.scene?.draws.length) this.choice('modes', [['false', 'orbit', 'O'], ['true', 'walk', 'O: then W A S D Q E']], walks => { state.walks = walks === 'true'; }, () => state.walks);
    $('game').hidden = !this.scene?.draws.length;
    this.at = 0;
    this.buildMarks();
    const lit = bundle.tiles.filter(tile => tile.means || tile.levels).length, { length } = bundle.bytes;
    const texels = bundle.pages.reduce((sum, page) => sum + page.width * page.height, 0);
    const planes = bundle.tiles.some(tile => tile.planes), by = this.decoder.bptc ? 'by the hardware' : location.hash.includes('unpack') ? 'in JavaScript, as the address asks' : 'in JavaScript, because this device lacks BC7';
    const unpacked = planes ? 'planes are unpacked in JavaScript' : `BC7 blocks are unpacked ${by}`;
    const facts = [
      `${meta.title}: bundle version ${bundle.version}, ${length.toLocaleString('en')} bytes, ${bundle.hours.length} frames, ${bundle.pages.length} page(s), ${bundle.tiles.length} tiles of which ${lit} have light; ${(8 * length / texels / bundle.hours.length).toFixed(3)} bits per texel and frame.`,
      `Decoded by the GPU in a fragment shader at the time shown; ${unpacked}. \`compress view\` verified its checksums; this page does not.`,
      this.scene ? `${Math.round(this.scene.triangles).toLocaleString('en')} triangles; ${Math.round(this.scene.unmapped).toLocaleString('en')} of them, and backs of surfaces, have no texels: they are lit by an ambient term, the 10th percentile of the tiles' means plus a sixth of the sun. “As game” (G) shows only what the bundle gives an engine: there they are unlit, black, and need texels or light of the engine, such as probes; backs show the texels of their front. No sky, gloss or visible emission.` : 'There is no scene.glb beside the bundle: only the atlas is shown.',
      meta.reference.note,
      bundle.sun ? "The sun's direct light is a separate stream: it moves between the frames." : "The sun's direct light is in the maps, or omitted.",
    ];
    $('facts').replaceChildren(...facts.map(fact => { const p = document.createElement('p'); p.textContent = fact; return p; }));
  }

  // Frames, hours, and the switches of light groups on the slider.
  buildMarks() {
    const marks = [], mark = (kind, hour, text) => {
      const element = document.createElement(kind);
      element.style.left = `${hour / 24 * 100}%`;
      if (text !== undefined) element.textContent = text;
      marks.push(element);
      return element;
    };
    for (const hour of this.bundle.hours) mark('i', hour).className = 'set';
    for (let hour = 0; hour <= 24; hour += 3) { mark('i', hour); mark('span', hour, hour); }
    const switches = new Map(), note = (hour, text) => switches.set(hour, [...switches.get(hour) ?? [], text]);
    for (const { name, on } of this.bundle.groups) {
      for (const [from, to] of on) {
        if (from === 0 && to === 24) continue;
        note(from, `${name} on at ${clock(from)}`);
        note(to, `${name} off at ${clock(to)}`);
      }
    }
    for (const [hour, texts] of switches) mark('b', hour).title = texts.join('\n');
    $('marks').replaceChildren(...marks);
  }

  // ---- What is shown ----

  // Whether the view shows references, of which there are some hours only.
  refers() { return ['reference', 'difference'].includes(this.state.view); }

  setHour(hour) {
    const { state } = this, before = state.hour;
    state.clock = mod(hour, 24);
    state.hour = this.refers() ? nearestOf(this.meta.reference.hours, state.clock) : state.clock;
    if (state.hour !== before) {
      this.decode();
      this.missing = null;
    }
    if (this.refers() && !this.missing) this.loadReference(state.hour).catch(problem => this.miss(state.hour, problem));
    this.redraw();
  }

  // A reference that does not come is told; the rest goes on. It is asked for again when its hour or view is chosen again.
  miss(hour, problem) {
    if (hour !== this.state.hour) return;
    this.missing = `did not come: ${problem.message}`;
    this.redraw();
  }

  decode() {
    const { state, decoder } = this;
    decoder.decode(state.hour);
    this.ambient = this.ambientAt(state.hour);
    this.stale = true;
  }

  // The 10th percentile of all tiles' means, so that lamps do not count, plus a sixth of the sun.
  ambientAt(hour) {
    const { bundle } = this, moment = momentOf(bundle, hour);
    const means = bundle.tiles.filter(tile => tile.means).map(tile => meansAt(tile, moment));
    const low = means.sort((a, b) => luminance(a) - luminance(b))[Math.floor(means.length / 10)] ?? [0, 0, 0], sun = bundle.sun && sunAt(bundle.sun, moment.t);
    return low.map((x, c) => x + (sun ? sun.irradiance[c] * Math.max(sun.direction[1], 0) / 6 : 0));
  }

  setView(view) {
    const { state } = this;
    state.view = view;
    this.missing = null;
    this.setHour(state.playing ? state.clock : state.hour);
  }

  // Brings the reference of the hour shown to the GPU. One that comes when another hour is shown is left.
  async loadReference(hour = this.state.hour) {
    const { gl, state, pages } = this;
    if (this.referenceShown === hour) return;
    const all = await Promise.all(pages.map((_, i) => this.reference(hour, i)));
    if (state.hour !== hour) return;
    pages.forEach((page, i) => {
      page.reference ??= this.decoder.texture(gl.TEXTURE_2D, gl.RGB9_E5, page.width, page.height);
      page.referenceScale = all[i].scale;
      gl.bindTexture(gl.TEXTURE_2D, page.reference);
      for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.LINEAR);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, page.width, page.height, gl.RGB, gl.UNSIGNED_INT_5_9_9_9_REV, all[i].texels);
    });
    this.referenceShown = hour;
    this.redraw();
  }

  // A page at an hour of the references, kept for the curve of a texel and a tile's PSNR: texels of light × `scale`.
  reference(hour, page) {
    const { references, meta } = this, key = `reference-${meta.reference.sets[meta.reference.hours.indexOf(hour)]}-${page}`;
    if (!references.has(key)) {
      // What came with the page cannot be had again.
      if (!this.whole && references.size >= 64) references.delete(references.keys().next().value);
      const read = this.readReference(key, this.bundle.pages[page]);
      references.set(key, read);
      read.catch(() => { if (references.get(key) === read) references.delete(key); });
    }
    return references.get(key);
  }

  async readReference(key, { width, height }) {
    const bytes = await dataOf(key);
    expect(bytes.length === 4 + 4 * width * height, `a reference of ${bytes.length} bytes`);
    const scale = new DataView(bytes.buffer, bytes.byteOffset).getFloat32(0, true);
    expect(scale > 0 && scale < Infinity, `a reference times ${scale}`);
    return { scale, texels: new Uint32Array(bytes.buffer, bytes.byteOffset + 4, width * height) };
  }

  setCamera(i) {
    if (!this.cameras[i]) return;
    this.at = i;
    this.camera = this.cameras[i].copy();
    this.state.space = 'scene';
    this.stale = true;
  }

  // The page in the middle of the window.
  fit() {
    const { width, height } = this.bundle.pages[this.state.page], [w, h] = [innerWidth, innerHeight - 150];
    const zoom = Math.max(width / w, height / h);
    this.window = { zoom, x: (w - width / zoom) / 2, y: 60 + (h - height / zoom) / 2 };
    this.stale = true;
  }

  // Brings the exposure to the picture, unless it is pinned.
  expose() {
    const { gl, state, small } = this;
    if (state.pinned || state.view === 'bits' || !this.stale) return;
    // While the day plays, four times a second are enough for what costs a picture of its own.
    if (state.playing && performance.now() - this.exposedAt < 250) return;
    this.stale = false;
    this.exposedAt = performance.now();
    const out = new Float32Array(4 * small.width * small.height), found = [], { scale } = this.decoder;
    if (state.space === 'scene') {
      gl.bindFramebuffer(gl.FRAMEBUFFER, small.frame);
      gl.viewport(0, 0, small.width, small.height);
      this.scene.draw(this.camera, this.canvas.width, this.canvas.height, 1, { ...this.drawn(), view: 'decoded' });
      gl.readPixels(0, 0, small.width, small.height, gl.RGBA, gl.FLOAT, out);
      for (let i = 0; i < out.length; i += 4) if (out[i + 3] > 0.5) found.push(luminance(out.subarray(i, i + 3)) / scale);
    } else {
      for (const tile of this.bundle.tiles) if (tile.page === state.page && tile.means) found.push(0.5 * luminance(this.meanOf(tile)) / Math.PI);
    }
    state.exposure = automaticExposure(found);
  }

  meanOf(tile) {
    const moment = momentOf(this.bundle, this.state.hour), sun = this.bundle.sun && sunAt(this.bundle.sun, moment.t);
    return allMeansAt(this.bundle, tile, moment).map((mean, c) => mean + (sun ? sun.irradiance[c] / 4 : 0));
  }

  drawn() { return { ...this.state, scale: this.decoder.scale, ambient: this.ambient, pages: this.pages }; }

  redraw() { this.dirty = true; }

  frame(now = performance.now()) {
    if (this.stopped) return;
    try {
      const seconds = Math.min((now - (this.last ?? now)) / 1000, 0.5);
      this.last = now;
      this.pass(seconds);
      if (this.dirty) this.paint();
      this.dirty = false;
    } catch (problem) {
      this.stop(problem);
    }
    requestAnimationFrame(now => this.frame(now));
  }

  // Lets time pass.
  pass(seconds) {
    this.walk(seconds);
    if (this.state.playing) this.setHour(this.state.clock + 24 * seconds / DAY_SECONDS);
  }

  resize() {
    const ratio = Math.min(devicePixelRatio || 1, 2), width = Math.max(Math.round(innerWidth * ratio), 1), height = Math.max(Math.round(innerHeight * ratio), 1);
    if (this.canvas.width === width && this.canvas.height === height) return;
    Object.assign(this.canvas, { width, height });
    this.stale = true;
  }

  paint() {
    this.resize();
    // Until the reference is there, the picture stays as it is.
    if (!this.refers() || this.referenceShown === this.state.hour) {
      this.expose();
      this.drawTo(null, this.canvas.width, this.canvas.height);
    }
    this.tell();
    this.follow();
  }

  drawTo(frame, width, height) {
    const { gl, state } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.viewport(0, 0, width, height);
    if (state.space === 'scene') return this.scene.draw(this.camera, width, height, 0, this.drawn());
    const { program, at } = this.atlas, page = this.pages[state.page], ratio = this.canvas.width / innerWidth, { zoom, x, y } = this.window;
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.CULL_FACE);
    gl.useProgram(program);
    gl.bindVertexArray(this.decoder.vertices);
    [page.texture, page.reference ?? page.texture, page.bits].forEach((texture, unit) => { gl.activeTexture(gl.TEXTURE0 + unit); gl.bindTexture(gl.TEXTURE_2D, texture); });
    ['map', 'reference', 'bits'].forEach((name, unit) => gl.uniform1i(at[name], unit));
    gl.uniform1f(at.scale, this.decoder.scale);
    gl.uniform1f(at.referenceScale, page.referenceScale ?? 1);
    gl.uniform1f(at.exposure, state.exposure);
    gl.uniform1i(at.view, VIEWS.indexOf(state.view));
    gl.uniform4f(at.window, x * ratio, y * ratio, zoom / ratio, height);
    gl.uniform2i(at.pageSize, page.width, page.height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  tell() {
    const { state, meta } = this;
    $('time').textContent = clock(state.hour);
    $('hour').value = Math.round(60 * state.hour) % 1440;
    $('play').textContent = state.playing ? '❚❚' : '▶';
    $('play').setAttribute('aria-label', state.playing ? 'Pause (space)' : 'Play (space)');
    $('exposure').value = state.exposure;
    $('ev').textContent = `${state.exposure.toFixed(1)} EV`;
    for (const [id, on] of [['pin', state.pinned], ['game', state.game]]) $(id).setAttribute('aria-pressed', String(on));
    for (const choice of this.choices) choice();
    const on = this.bundle.groups.filter(group => isOn(group.on, mod(state.hour, 24))).map(group => group.name);
    const parts = [on.length ? `on: ${on.join(', ')}` : 'no light group on'];
    if (this.refers()) parts.push(`reference of ${clock(state.hour)}, ${this.referenceShown === state.hour ? meta.reference.precision : this.missing ?? 'which is on its way'}`);
    if (state.view === 'bits') parts.push(`blue: no bits, yellow: ${this.mostBits.toFixed(2)} bits per texel and frame, or more`);
    if (state.space === 'scene' && this.scene.unmapped > 0) parts.push(state.game ? 'what has no texels is unlit, as in a game without other light' : 'what has no texels is lit by an ambient term');
    $('state').textContent = parts.join(' · ');
  }

  // ---- One texel ----

  // What of the page lies under a place of the window, in CSS pixels; `bare` is a surface without texels.
  pick(x, y) {
    const { gl, state } = this;
    if (state.space === 'atlas') {
      const { zoom, x: left, y: top } = this.window;
      return { page: state.page, x: Math.floor((x - left) * zoom), y: Math.floor((y - top) * zoom) };
    }
    const one = this.one ??= this.decoder.target(1, 1, this.decoder.gl.getExtension('EXT_color_buffer_float') ? gl.RGBA32F : gl.RGBA16F), out = new Float32Array(4);
    if (!this.one.depth) { this.depth(one); one.depth = true; }
    const ratio = this.canvas.width / innerWidth;
    gl.bindFramebuffer(gl.FRAMEBUFFER, one.frame);
    gl.viewport(-Math.floor(x * ratio), -(this.canvas.height - 1 - Math.floor(y * ratio)), this.canvas.width, this.canvas.height);
    this.scene.draw(this.camera, this.canvas.width, this.canvas.height, 2, this.drawn());
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.FLOAT, out);
    const page = Math.round(out[0]) - 1;
    if (page < 0) return out[3] > 0.5 ? { bare: true } : null;
    return { page, x: Math.floor(out[1] * this.pages[page].width), y: Math.floor(out[2] * this.pages[page].height) };
  }

  async inspect(place) {
    const { bundle, meta } = this, page = place && bundle.pages[place.page];
    this.closePanel();
    if (place?.bare) {
      $('texel').textContent = 'no texels here';
      $('curve').hidden = true;
      $('inspect').hidden = false;
      return;
    }
    if (!place || place.x < 0 || place.y < 0 || place.x >= page.width || place.y >= page.height) return;
    const [column, row] = [place.x, place.y].map(at => Math.floor(at / PAYLOAD));
    const tile = bundle.tiles.find(tile => tile.page === place.page && tile.column === column && tile.row === row);
    const [x, y] = [place.x - PAYLOAD * column + 1, place.y - PAYLOAD * row + 1];
    const hours = [...new Set([...bundle.knots, ...Array.from({ length: 97 }, (_, i) => Math.min(i / 4, 23.999))])].sort((a, b) => a - b);
    const light = hours.map(hour => decodeTexel(bundle, tile, hour, x, y));
    const panel = this.panel = { place, tile, x, y, hours, light, points: [], hour: null, whole: false, quality: '', of: null };
    $('curve').hidden = $('inspect').hidden = false;
    this.follow();
    for (const hour of meta.reference.hours) {
      try {
        const reference = await this.reference(hour, place.page);
        panel.points.push([hour, lightOf(reference, place.y * page.width + place.x)]);
      } catch (problem) {
        panel.problem = `the reference of ${clock(hour)} did not come: ${problem.message}`;
      }
      if (this.panel !== panel) return;
    }
    panel.hour = null;
    await this.judge(panel);
    panel.whole = true;
    this.follow();
  }

  // The panel shows the texel at the time shown.
  follow() {
    const { panel, bundle, meta, state } = this;
    if (!panel || panel.hour === state.hour) return;
    panel.hour = state.hour;
    const { place, tile, x, y, points } = panel, now = decodeTexel(bundle, tile, state.hour, x, y);
    this.plot(panel.hours, panel.light, points);
    const lines = [`texel ${place.x}, ${place.y} of page ${place.page}, tile ${tile.column}, ${tile.row}`, `${clock(state.hour)}: E = ${now.map(digits).join(', ')} (R, G, B; unit of the lightmaps)`,
      `${this.bytesOfTile(tile).toLocaleString('en')} bytes, ${this.bitsOfTile(tile).toFixed(3)} bits per texel and frame`];
    if (!meta.reference.hours.length) lines.push('no reference at hand');
    if (panel.quality) lines.push(panel.quality);
    if (panel.problem) lines.push(panel.problem);
    if (points.length) lines.push(`lines: decoded; circles: reference at ${points.map(([hour]) => clock(hour)).join(', ')}`);
    $('texel').textContent = lines.join('\n');
    // A whole tile takes long: once time stands still.
    clearTimeout(panel.timer);
    if (panel.whole) panel.timer = setTimeout(() => this.judge(panel), 300);
  }

  async judge(panel) {
    const { meta, state } = this;
    if (!meta.reference.hours.length || this.panel !== panel || state.playing) return;
    const hour = nearestOf(meta.reference.hours, state.hour);
    if (panel.of === hour) return;
    panel.of = hour;
    panel.quality = await this.quality(panel.tile, hour).catch(problem => `the tile at ${clock(hour)} cannot be judged: ${problem.message}`);
    panel.hour = null;
    this.redraw();
  }

  closePanel() {
    if (this.panel) {
      clearTimeout(this.panel.timer);
      forgetTexels(this.panel.tile);
    }
    this.panel = null;
    $('inspect').hidden = true;
  }

  // The tile's PSNR at an hour of the references, over its valid texels, peak = the largest value there.
  async quality(tile, hour) {
    const { meta, bundle } = this, reference = await this.reference(hour, tile.page), page = bundle.pages[tile.page];
    const asked = this.masks[tile.page] ??= dataOf(`mask-${tile.page}`).catch(problem => {
      this.masks[tile.page] = null;
      throw problem;
    });
    const mask = await asked, decoded = decodeTile(bundle, tile, hour);
    let squares = 0, count = 0, peak = 0;
    for (let y = 0; y < tile.ownHeight; y++) {
      for (let x = 0; x < tile.ownWidth; x++) {
        const at = (PAYLOAD * tile.row + y) * page.width + PAYLOAD * tile.column + x;
        if (!(mask[at >> 3] >> (at & 7) & 1)) continue;
        lightOf(reference, at).forEach((e, c) => {
          squares += (e - decoded[3 * ((y + 1) * tile.width + x + 1) + c]) ** 2;
          peak = Math.max(peak, e);
          count++;
        });
      }
    }
    if (!count || !peak) return `at ${clock(hour)} the tile is black, or has no valid texels`;
    return `tile at ${clock(hour)}: PSNR ${(10 * Math.log10(peak * peak / Math.max(squares / count, 1e-30))).toFixed(1)} dB against the reference (${meta.reference.precision})`;
  }

  // Irradiance by hour: lines are decoded, circles the reference.
  plot(hours, light, points) {
    const canvas = $('curve'), g = canvas.getContext('2d'), { width, height } = canvas, colours = ['#ff7b6b', '#7fdc8a', '#7aa8ff'];
    const top = Math.max(...light.flat(), ...points.flatMap(([, e]) => e), 1e-12) * 1.05, px = hour => 50 + hour / 24 * (width - 60), py = e => height - 24 - e / top * (height - 36);
    g.clearRect(0, 0, width, height);
    g.font = '16px system-ui';
    g.fillStyle = '#9aa3b2';
    g.strokeStyle = '#3b424f';
    g.fillText(digits(top), 2, 16);
    for (let hour = 0; hour <= 24; hour += 6) {
      g.beginPath();
      g.moveTo(px(hour), 8);
      g.lineTo(px(hour), height - 22);
      g.stroke();
      g.fillText(hour, px(hour) - 8, height - 4);
    }
    g.lineWidth = 2;
    colours.forEach((colour, c) => {
      g.strokeStyle = colour;
      g.beginPath();
      hours.forEach((hour, i) => g.lineTo(px(hour), py(light[i][c])));
      g.stroke();
      for (const [hour, e] of points) {
        g.beginPath();
        g.arc(px(hour), py(e[c]), 4, 0, 7);
        g.stroke();
      }
    });
    g.strokeStyle = '#d9a441';
    g.beginPath();
    g.moveTo(px(this.state.hour), 8);
    g.lineTo(px(this.state.hour), height - 22);
    g.stroke();
  }

  // ---- Mouse, touch, keys ----

  listen() {
    const { canvas, state } = this, held = new Map();
    let moved = 0;
    canvas.onpointerdown = event => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, [event.clientX, event.clientY]); if (held.size === 1) moved = 0; canvas.focus(); };
    canvas.onpointermove = event => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY], [dx, dy] = [now[0] - before[0], now[1] - before[1]], other = [...held].find(([id]) => id !== event.pointerId)?.[1];
      moved += Math.abs(dx) + Math.abs(dy);
      held.set(event.pointerId, now);
      if (other) {
        const gap = at => Math.hypot(at[0] - other[0], at[1] - other[1]);
        this.nearer(gap(before) / Math.max(gap(now), 1), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
        this.shift(dx / 2, dy / 2);
      } else if (event.buttons & 6 || event.shiftKey || state.space === 'atlas') this.shift(dx, dy);
      else this.camera.turn((state.walks ? -1 : 1) * dx * 0.005, (state.walks ? 1 : -1) * dy * 0.005, !state.walks);
      this.stale = true;
      this.redraw();
    };
    canvas.onpointerup = canvas.onpointercancel = event => {
      held.delete(event.pointerId);
      if (event.type === 'pointerup' && moved < 5 && held.size === 0 && event.button === 0) this.inspect(this.pick(event.clientX, event.clientY)).catch(problem => this.stop(problem));
    };
    canvas.oncontextmenu = event => event.preventDefault();
    canvas.onwheel = event => { event.preventDefault(); this.nearer(1.0015 ** event.deltaY, event.clientX, event.clientY); };
    addEventListener('resize', () => { this.fit(); this.redraw(); });
    this.keys = new Set();
    addEventListener('keyup', event => this.keys.delete(event.key.toLowerCase()));
    addEventListener('blur', () => this.keys.clear());
    addEventListener('keydown', event => this.key(event));
    $('hour').oninput = () => { state.playing = false; this.setHour(Number($('hour').value) / 60); };
    $('play').onclick = () => this.play();
    $('exposure').oninput = () => { state.exposure = Number($('exposure').value); state.pinned = true; this.redraw(); };
    $('pin').onclick = () => this.pin();
    $('game').onclick = () => this.asGame();
    $('more').onclick = () => this.about();
    addEventListener('hashchange', () => {
      const hour = hourOf(location.hash);
      if (hour !== null) this.setHour(hour);
    });
    for (const button of document.querySelectorAll('.close')) button.onclick = () => button.parentElement.id === 'inspect' ? this.closePanel() : this.about();
  }

  play() {
    this.state.playing = !this.state.playing;
    this.state.clock = this.state.hour;
    if (this.panel) this.panel.hour = null;
    this.redraw();
  }

  about() {
    $('about').hidden = !$('about').hidden;
    $('more').setAttribute('aria-expanded', String(!$('about').hidden));
  }

  pin() {
    this.state.pinned = !this.state.pinned;
    this.stale = true;
    this.redraw();
  }

  // Shows what has no texels as an engine does, or lit by the ambient term.
  asGame() {
    if ($('game').hidden) return;
    this.state.game = !this.state.game;
    this.stale = true;
    this.redraw();
  }

  nearer(factor, x, y) {
    if (this.state.space === 'atlas') {
      const w = this.window, zoom = Math.min(Math.max(w.zoom * factor, 0.02), 100);
      Object.assign(w, { x: x - (x - w.x) * w.zoom / zoom, y: y - (y - w.y) * w.zoom / zoom, zoom });
    } else if (this.state.walks) this.camera.move(0, 0, (1 - factor) * this.scene.radius * 0.2);
    else this.camera.zoom(factor);
    this.stale = true;
    this.redraw();
  }

  shift(dx, dy) {
    if (this.state.space === 'atlas') { this.window.x += dx; this.window.y += dy; return; }
    const step = 2 * this.camera.distance * Math.tan(this.camera.fov * Math.PI / 360) / innerWidth;
    this.camera.move(-dx * step, dy * step, 0);
  }

  walk(seconds) {
    const has = key => this.keys.has(key) ? 1 : 0, [right, up, ahead] = [has('d') - has('a'), has('e') - has('q'), has('w') - has('s')];
    if (!(right || up || ahead) || this.state.space !== 'scene') return;
    const step = seconds * Math.max(this.scene.radius * 0.12, 0.5) * (this.keys.has('shift') ? 4 : 1);
    this.camera.move(right * step, up * step, ahead * step);
    this.stale = true;
    this.redraw();
  }

  key(event) {
    const { state } = this, key = event.key.toLowerCase();
    // Sliders have arrows of their own; that of time cannot go by minutes where there are some hours only.
    const typed = event.target.matches?.('input') && key.startsWith('arrow') && !(this.refers() && event.target === $('hour'));
    if (event.ctrlKey || event.metaKey || event.altKey || typed || event.target.matches?.('button') && [' ', 'enter'].includes(key)) return;
    const next = way => {
      if (!event.shiftKey && !this.refers()) return state.hour + way / 12;
      const all = this.refers() ? this.meta.reference.hours : this.bundle.hours, hours = way > 0 ? all : [...all].reverse();
      return hours.find(hour => way * (hour - state.hour) > 1e-6) ?? hours[0];
    };
    const steps = {
      ' ': () => this.play(), arrowleft: () => this.setHour(next(-1)), arrowright: () => this.setHour(next(1)),
      v: () => this.setView(this.shown[(this.shown.indexOf(state.view) + 1) % this.shown.length]), o: () => { state.walks = !state.walks; }, p: () => this.pin(), g: () => this.asGame(), i: () => this.about(),
      m: () => this.turnPage(), '+': () => this.brighten(0.5), '=': () => this.brighten(0.5), '-': () => this.brighten(-0.5),
      escape: () => {
        this.closePanel();
        if (!$('about').hidden) this.about();
      },
    };
    if ('wasdqe'.includes(key) || key === 'shift') this.keys.add(key);
    else if (key >= '1' && key <= '9') this.setCamera(Number(key) - 1);
    else if (steps[key]) { steps[key](); event.preventDefault(); }
    this.redraw();
  }

  brighten(ev) {
    this.state.exposure += ev;
    this.state.pinned = true;
  }

  // Scene, then each page.
  turnPage() {
    const buttons = [...$('spaces').children], at = buttons.findIndex(button => button.getAttribute('aria-pressed') === 'true');
    buttons[(at + 1) % buttons.length].click();
  }
}

function nearestOf(hours, hour) {
  const away = x => Math.min(mod(x - hour, 24), mod(hour - x, 24));
  return hours.reduce((best, x) => away(x) < away(best) ? x : best, hours[0]);
}

// The light of texel i of a reference: three mantissas of nine bits and an exponent of five.
function lightOf({ texels, scale }, i) {
  const bits = texels[i], step = 2 ** ((bits >>> 27) - 24) / scale;
  return [bits & 511, bits >>> 9 & 511, bits >>> 18 & 511].map(mantissa => mantissa * step);
}

const viewer = new Viewer();
const opened = viewer.open().catch(problem => viewer.stop(problem));
