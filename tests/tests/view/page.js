// What the page shows as it opens, and does for its visitor.
(async () => {
  await opened;
  const found = {}, { gl, state, canvas, meta } = viewer, frames = async n => { for (let i = 0; i < n; i++) await new Promise(requestAnimationFrame); };
  const sheet = new OffscreenCanvas(canvas.width, canvas.height).getContext('2d', { willReadFrequently: true });
  // The colours of a rectangle of the canvas.
  const look = (width, height) => { sheet.drawImage(canvas, 0, 0); return sheet.getImageData(0, 0, width, height).data; };
  const button = (group, name) => [...document.querySelectorAll(`#${group} button`)].find(button => button.textContent === name);
  const press = (key, where = window) => { const event = new KeyboardEvent('keydown', { key, bubbles: true, cancelable: true }); where.dispatchEvent(event); return event; };
  const move = hour => { $('hour').value = 60 * hour; $('hour').dispatchEvent(new Event('input')); };
  await frames(2);
  const first = look(canvas.width, canvas.height);
  found.opens = $('state').textContent !== '' && canvas.width >= innerWidth && new Set(new Uint32Array(first.buffer)).size > 20;
  found.facts = $('facts').textContent;

  // A texel of the atlas a pixel: what every view shows of each at some hours, in codes of 255.
  const { width, height } = viewer.pages[0], light = new Float32Array((await files('light')).buffer), [tile] = viewer.bundle.tiles;
  button('spaces', 'atlas').click();
  viewer.window = { zoom: canvas.width / innerWidth, x: 0, y: 0 };
  const code = e => {
    const x = 0.5 * e / Math.PI * 2 ** state.exposure, y = x > 0.7 ? 1 - 0.3 * Math.exp((0.7 - x) / 0.3) : x;
    return 255 * (y > 0.0031308 ? 1.055 * y ** (1 / 2.4) - 0.055 : 12.92 * y);
  };
  // A channel as RGB9E5 has it.
  const rounded = (e, brightest) => {
    const step = 2 ** (Math.floor(Math.log2(brightest)) - 8);
    return brightest > 0 ? step * Math.round(e / step) : 0;
  };
  found.views = {};
  for (const [name, of] of Object.entries({ decoded: (e, r) => e, reference: (e, r) => r, '×8 difference': (e, r, brightest) => 8 * Math.abs(e - rounded(r, brightest)) })) {
    button('views', name).click();
    for (const hour of [20, 0, 12]) {
      move(hour);
      await frames(3);
      const shown = look(width, height), decoded = decodeTile(viewer.bundle, tile, hour), from = 3 * width * height * meta.reference.hours.indexOf(hour);
      let mean = 0, bright = 0;
      for (let y = 0; y < height; y++) {
        for (let x = 0; x < width; x++) {
          const reference = light.subarray(from + 3 * (y * width + x)), brightest = Math.max(reference[0], reference[1], reference[2]);
          for (let c = 0; c < 3; c++) {
            const expected = code(of(decoded[3 * ((y + 1) * tile.width + x + 1) + c], reference[c], brightest));
            mean += Math.abs(shown[4 * (y * width + x) + c] - expected) / (3 * width * height);
            bright = Math.max(bright, expected);
          }
        }
      }
      const pressed = button('views', name).getAttribute('aria-pressed') === 'true' && document.querySelectorAll('#views [aria-pressed=true]').length === 1;
      found.views[`${name} at ${hour}`] = pressed && state.hour === hour && bright > 20 ? mean : null;
    }
  }
  button('views', 'bits per tile').click();
  await frames(2);
  found.bits = look(width, height).every((value, i) => Math.abs(value - [255, 220, 40, 255][i % 4]) <= 1);

  // With references, time goes by their hours: by slider, by keys, and as the day plays.
  button('views', 'reference').click();
  move(11);
  await frames(3);
  found.snaps = state.hour === 12 && viewer.referenceShown === 12 && $('hour').value === '720' && $('time').textContent === '12:00';
  const hours = [];
  const steps = [['ArrowRight'], ['ArrowLeft'], ['ArrowLeft', $('hour')], ['ArrowLeft'], ['ArrowLeft'], ['ArrowLeft']];
  for (const [key, where] of steps) {
    hours.push(press(key, where).defaultPrevented && state.hour);
    await frames(2);
    hours.push(viewer.referenceShown);
  }
  found.steps_by_references = hours.join(' ') === '15 15 12 12 9 9 6 6 0 0 20 20';
  move(9);
  viewer.play();
  const played = new Set();
  for (let i = 0; i < 48; i++) {
    viewer.pass(0.5);
    played.add(state.hour);
  }
  viewer.play();
  found.plays_by_references = [...played].join(' ') === meta.reference.hours.filter(hour => hour >= 9 && hour <= 20).join(' ');

  // What comes late is not shown. (Three mantissas of 256 and an exponent of 16 are 1, 1, 1.)
  const late = [], { references } = viewer, ONE = 0x84020100;
  viewer.references = new Map();
  viewer.readReference = async key => {
    if (key === `reference-${meta.reference.hours.indexOf(20)}-0`) await new Promise(done => late.push(done));
    return { scale: 1 / luminance(viewer.meanOf(tile)), texels: new Uint32Array(width * height).fill(ONE) };
  };
  move(6);
  await frames(2);
  const kept = look(width, height);
  move(20);
  await frames(2);
  const same = look(width, height).every((value, i) => value === kept[i]);
  found.waits = same && viewer.referenceShown === 6 && $('time').textContent === '20:00' && $('state').textContent.includes('on its way');
  move(12);
  await frames(2);
  late.forEach(done => done());
  await frames(2);
  found.late = late.length === 1 && viewer.referenceShown === 12 && state.hour === 12;
  delete viewer.readReference;
  viewer.references = references;

  // Time and its keys with what is decoded; a texel; the atlas.
  button('views', 'decoded').click();
  press('ArrowRight');
  found.steps = Math.abs(state.hour - 12 - 1 / 12) < 1e-6;
  const before = state.hour;
  press(' ');
  await frames(3);
  found.plays = state.playing && state.hour > before && state.hour < before + 6;
  press(' ');
  found.pauses = !state.playing;
  const picked = viewer.pick(viewer.window.x + 10.5 / viewer.window.zoom, viewer.window.y + 20.5 / viewer.window.zoom);
  found.atlas = state.space === 'atlas' && picked.x === 10 && picked.y === 20;
  button('spaces', 'scene').click();
  await frames(2);
  const seen = viewer.pick(innerWidth / 2, innerHeight / 2);
  found.picks = state.space === 'scene' && seen?.page === 0 && seen.x >= 0 && seen.x < width && seen.y >= 0 && seen.y < height;
  // As a game what has no texels is black, and what has some is as before; by key and by button.
  const { draws } = viewer.scene, wasPinned = state.pinned, drawn = async () => { viewer.redraw(); await frames(2); return look(canvas.width, canvas.height); };
  const middle = data => [0, 1, 2].map(c => data[4 * (Math.floor(canvas.height / 2) * canvas.width + Math.floor(canvas.width / 2)) + c]);
  const tells = (pressed, text) => $('game').getAttribute('aria-pressed') === String(pressed) && $('state').textContent.includes(text);
  state.pinned = true;
  const mapped = draws.map(draw => draw.mapped), usual = await drawn();
  found.as_game = !state.game && !$('game').hidden && press('g').defaultPrevented && state.game && (await drawn()).every((value, i) => value === usual[i]);
  viewer.scene.unmapped = 1;
  draws.forEach(draw => { draw.mapped = false; });
  found.as_game &&= middle(await drawn()).every(code => code === 0) && tells(true, 'unlit');
  $('game').focus();
  found.as_game &&= document.activeElement === $('game') && $('game').textContent === 'as game';
  $('game').click();
  found.as_game &&= middle(await drawn()).some(code => code > 0) && tells(false, 'ambient term');
  // The exposure is that of what has light.
  const [unlit] = draws;
  draws.forEach((draw, i) => { draw.mapped = mapped[i] && draw !== unlit; });
  const exposed = game => { Object.assign(state, { game, pinned: false }); viewer.stale = true; viewer.expose(); return state.exposure; };
  const [asGame, without] = [exposed(true), (viewer.scene.draws = draws.filter(draw => draw !== unlit), exposed(false))];
  viewer.scene.draws = draws;
  found.exposure_as_game = Math.abs(asGame - without);
  draws.forEach((draw, i) => { draw.mapped = mapped[i]; });
  viewer.scene.unmapped = 0;
  state.pinned = wasPinned;
  await viewer.inspect(seen);
  found.texel = $('texel').textContent;
  // The panel follows the time; addresses take hours of a clock, and later ones too.
  found.hashes = [['#hour=18:30', 18.5], ['#unpack&hour=18%3A06', 18.1], ['#hour=9.25', 9.25], ['#hour=25', 1], ['#hour=noon', null], ['', null]].every(([hash, hour]) => hour === null ? hourOf(hash) === null : Math.abs(hourOf(hash) - hour) < 1e-9);
  location.hash = '#hour=18:30';
  for (let i = 0; i < 100 && state.hour !== 18.5; i++) await frames(1);
  await frames(2);
  found.follows = state.hour === 18.5 && $('texel').textContent.includes('18:30: E = ') && $('time').textContent === '18:30';
  await viewer.inspect({ bare: true });
  found.bare = $('texel').textContent === 'no texels here' && !$('inspect').hidden && !viewer.panel;
  press('Escape');
  found.closes = $('inspect').hidden;
  // Tab is the browser's; M turns the page.
  const tab = press('Tab');
  found.tabs = !tab.defaultPrevented && state.space === 'scene' && press('m').defaultPrevented && state.space === 'atlas';
  // A reference that does not come is told, and asked for again.
  const { references: there } = viewer;
  viewer.references = new Map();
  viewer.referenceShown = null;
  viewer.readReference = async () => { throw Error('gone'); };
  button('views', 'reference').click();
  await frames(3);
  found.misses = !viewer.stopped && $('state').textContent.includes('did not come: gone') && viewer.references.size === 0;
  await viewer.inspect(seen);
  found.misses &&= $('texel').textContent.includes('did not come: gone') && $('message').textContent === '';
  viewer.closePanel();
  delete viewer.readReference;
  viewer.references = there;
  button('views', 'reference').click();
  await frames(3);
  found.misses &&= viewer.referenceShown === state.hour;
  button('views', 'decoded').click();
  const { pinned } = state;
  press('p');
  found.pins = state.pinned === !pinned;

  // What came with the page stays, however much that is, and comes once if it is asked for twice at the same time.
  const one = btoa(String.fromCharCode(0, 0, 128, 63) + '\0'.repeat(4 * width * height)), more = Array.from({ length: 100 }, (_, i) => 100 + i);
  for (const set of more) {
    const element = document.createElement('script');
    Object.assign(element, { type: 'text/plain', id: `data-reference-${set}-0`, textContent: one });
    document.body.append(element);
    meta.reference.sets.push(set);
    meta.reference.hours.push(12 + set / 1000);
  }
  const ask = () => Promise.all(more.map(set => viewer.reference(12 + set / 1000, 0)));
  await Promise.all([ask(), ask()]);
  found.keeps = (await ask()).every(reference => reference.scale === 1 && reference.texels.length === width * height);

  // As narrow as a phone nothing is wider than the window.
  document.body.style.width = '390px';
  $('top').style.width = $('bottom').style.width = '390px';
  found.fits_a_phone = ['top', 'bottom'].every(id => $(id).scrollWidth <= 390);
  found.gl_error = gl.getError();
  report(found);
})().catch(problem => report({ problem: String(problem.stack) }));
