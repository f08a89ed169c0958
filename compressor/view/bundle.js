// Reads an NDGI bundle by FORMAT.md, version 5: header, index, resident block, and the time of day.
// What the format forbids is an Error. Checksums are not looked at. Nothing is allocated for what the file cannot hold.
'use strict';

const MAGIC = [0x4e, 0x44, 0x47, 0x49, 13, 10, 26, 10];
const PAYLOAD = 126;
const LARGEST = 3.4028234663852886e38;
// The viewer holds this many texels and pages at most: a bundle of empty tiles could ask for far more than its own size.
const MOST_TEXELS = 2 ** 25;
const MOST_PAGES = 256;

function refuse(what) { throw new Error(what); }
function expect(holds, what) { if (!holds) refuse(what); }

// Little-endian fields one after another, within [at, end).
class Cursor {
  constructor(bytes, at = 0, end = bytes.length) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    this.at = at;
    this.end = end;
  }
  skip(n, what) {
    expect(n >= 0 && n <= this.end - this.at, `byte ${this.at}: ${n} bytes of ${what} expected, ${this.end - this.at} left`);
    this.at += n;
    return this.at - n;
  }
  take(n, what) { const at = this.skip(n, what); return this.bytes.subarray(at, at + n); }
  u8(what) { return this.view.getUint8(this.skip(1, what)); }
  u16(what) { return this.view.getUint16(this.skip(2, what), true); }
  u32(what) { return this.view.getUint32(this.skip(4, what), true); }
  f32(what) { return this.view.getFloat32(this.skip(4, what), true); }
  f64(what) { return this.view.getFloat64(this.skip(8, what), true); }
  // Offsets and lengths: past 2^53 no file is.
  u64(what) {
    const at = this.skip(8, what);
    return this.view.getUint32(at, true) + 2 ** 32 * this.view.getUint32(at + 4, true);
  }
  text(what) {
    const bytes = this.take(this.count(1, `bytes of ${what}`), what);
    try { return new TextDecoder('utf-8', { fatal: true }).decode(bytes); } catch { return refuse(`${what} is not UTF-8`); }
  }
  // A number of things of at least `each` bytes, which must still fit.
  count(each, what) {
    const n = this.u32(what);
    expect(n * each <= this.end - this.at, `${n} ${what} announced, ${this.end - this.at} bytes left`);
    return n;
  }
  list(n, read) { return Array.from({ length: n }, read); }
}

function half(bits) {
  const sign = bits & 0x8000 ? -1 : 1, exponent = bits >> 10 & 31, fraction = bits & 1023;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -24 * fraction);
}

function ascends(hours, beyond) {
  return hours.every((hour, i) => hour >= 0 && (beyond ? hour <= 24 : hour < 24) && (i === 0 || hours[i - 1] < hour));
}

// Streams that are known; those of maps, of which a bundle has one.
const FEATURES = 0, SUN = 1, SHADOWS = 2, PLANES = 3;
const KNOWN = [FEATURES, SUN, SHADOWS, PLANES], MAPS = [FEATURES, PLANES];
// The section of the file that is known; and the flag of sections and streams that no reader may skip.
const RESIDENT = 0, REQUIRED = 1;

function openBundle(bytes) {
  const c = new Cursor(bytes);
  expect(bytes.length >= 80 && MAGIC.every((byte, i) => bytes[i] === byte), 'does not begin with the magic bytes of an NDGI bundle');
  c.at = 8;
  const version = c.u32('version');
  expect(version === 5, `bundle version ${version}; this page reads version 5: ${version < 5 ? 'compress its dataset again' : 'use a newer page'}`);
  const header = c.u32('header length'), length = c.u64('file length');
  expect(length === bytes.length, `has ${bytes.length} bytes; its header says ${length}: it is cut short, or damaged`);
  expect(header % 16 === 0 && header >= 80 && header <= Math.min(length, 2 ** 28), `header of ${header} bytes`);
  c.at = 32;
  c.end = header;
  const bundle = { bytes, version };
  expect(c.u32('side') === 128 & c.u32('border') === 1, 'tiles of another size than 128 with a border of 1');
  const n = c.count(8, 'frames'), between = c.count(8, 'hours between frames'), pages = c.count(8, 'pages'), groups = c.count(8, 'light groups');
  const streams = c.count(12, 'streams'), path = c.count(32, "times of the sun's path"), seen = c.count(8, 'times of visibility');
  const sections = c.count(24, 'sections of the file');
  expect(n > 0 && pages > 0 && streams > 0, 'no frames, pages or streams');
  expect(pages <= MOST_PAGES, `${pages} pages; this page shows ${MOST_PAGES} at most`);
  bundle.scene = c.text('scene');
  bundle.info = c.text('info');
  bundle.pages = c.list(pages, () => {
    const kind = c.u32('kind of a page'), width = c.u32('width'), height = c.u32('height');
    expect(kind < 2, `a page of kind ${kind}`);
    expect(Math.min(width, height) > 0 && Math.max(width, height) <= 2 ** 20, `page of ${width} × ${height} texels`);
    return { width, height, columns: Math.ceil(width / PAYLOAD), rows: Math.ceil(height / PAYLOAD) };
  });
  readTimes(c, bundle, n, between, groups);
  const kinds = readStreams(c, streams);
  expect(kinds.includes(PLANES) || bundle.groups.every(group => !group.apart), 'light groups that are apart from neural maps');
  const resident = readSections(c, sections, header);
  expect(kinds.includes(SUN) === (path + seen > 0) && (!kinds.includes(SHADOWS) || kinds.includes(SUN)), 'streams of the sun without its path, or the path alone');
  bundle.sun = path + seen > 0 ? readSun(c, path, seen) : null;
  readIndex(c, bundle, kinds, resident);
  return bundle;
}

function readTimes(c, bundle, n, between, groups) {
  bundle.hours = c.list(n, () => c.f64('hours'));
  const extra = c.list(between, () => c.f64('hours between frames'));
  bundle.knots = bundle.hours.concat(extra).sort((a, b) => a - b);
  expect(ascends(bundle.hours) && ascends(extra) && ascends(bundle.knots), 'hours that are not strictly ascending in [0, 24)');
  bundle.groups = c.list(groups, () => {
    const name = c.text('name of a light group'), count = c.count(16, 'intervals');
    const on = c.list(count, () => [c.f64('interval'), c.f64('interval')]);
    expect(on.every(ends => ends.every(hour => hour >= 0 && hour <= 24)), 'an on-interval outside [0, 24]');
    const states = c.take(n, 'states');
    const apart = c.u8('whether a light group is apart');
    expect(states.every(state => state < 2) && apart < 2, 'a state of a light group that is neither 0 nor 1');
    return { name, on, states, apart: apart === 1 };
  });
}

function readStreams(c, count) {
  const seen = new Set();
  const kinds = c.list(count, () => {
    const kind = c.u32('stream'), light = c.u32('light group'), flags = c.u32('flags'), known = KNOWN.includes(kind);
    expect(known || !(flags & REQUIRED), `required stream of unknown kind ${kind}`);
    expect(!known || light === 0 && flags === (MAPS.includes(kind) ? REQUIRED : 0), `a stream of kind ${kind}, light ${light}, flags ${flags}`);
    expect(!seen.has(`${kind} ${light}`), `a stream of kind ${kind} that occurs twice`);
    seen.add(`${kind} ${light}`);
    return kind;
  });
  expect(kinds.filter(kind => MAPS.includes(kind)).length === 1, 'no stream of maps, or two');
  return kinds;
}

// The table of the file's sections, which follow the header: where the resident block lies, and where all end.
function readSections(c, count, header) {
  const seen = new Set();
  let end = header, resident = null;
  for (let i = 0; i < count; i++) {
    const kind = c.u32('section'), flags = c.u32('flags'), length = c.u64('length');
    c.skip(8, 'checksum');
    expect(kind === RESIDENT || !(flags & REQUIRED), `required section of unknown kind ${kind}`);
    expect(!seen.has(kind) && (kind !== RESIDENT || flags === REQUIRED), `a section of kind ${kind}, flags ${flags}`);
    expect(length <= c.bytes.length - end, `a section of ${length} bytes in a file of ${c.bytes.length}`);
    seen.add(kind);
    if (kind === RESIDENT) resident = { at: end, length };
    end += Math.ceil(length / 16) * 16;
  }
  expect(resident, 'no resident block');
  return { ...resident, end };
}

// The index: payloads lie one after another behind the sections of the file and end with it.
function readIndex(c, bundle, kinds, resident) {
  const line = 8 + 16 * kinds.length;
  const count = bundle.pages.reduce((sum, page) => sum + page.columns * page.rows, 0);
  expect(count * line <= c.end - c.at, `${count} tiles, for whose index lines there is no room`);
  const texels = bundle.pages.reduce((sum, page) => sum + page.width * page.height, 0);
  expect(texels <= MOST_TEXELS, `${texels} texels; this page shows ${MOST_TEXELS} at most`);
  bundle.tiles = [];
  bundle.pages.forEach((page, number) => {
    for (let row = 0; row < page.rows; row++) {
      for (let column = 0; column < page.columns; column++) bundle.tiles.push(newTile(page, number, column, row));
    }
  });
  for (const tile of bundle.tiles) {
    tile.at = c.u64('offset');
    for (const kind of kinds) {
      const part = { length: c.u32('length'), word: c.u32('word') }, sum = c.u64('checksum');
      expect(part.length % 16 === 0 && (part.length > 0 || sum === 0 && part.word === 0), `index line of tile ${nameOf(tile)}`);
      expect(kind !== SHADOWS || part.word === 0, `word of the moving shadows of tile ${nameOf(tile)}`);
      tile.parts.push({ kind, ...part });
    }
  }
  expect(c.end - c.at < 16 && bundle.bytes.subarray(c.at, c.end).every(byte => byte === 0), 'more than zeros behind the index');
  const lit = bundle.tiles.filter(tile => tile.parts.find(part => MAPS.includes(part.kind)).length > 0);
  const lineOfResident = 8 + 8 * (bundle.knots.length + bundle.groups.filter(group => group.apart).length);
  expect(resident.length === lit.length * lineOfResident, `a resident block of ${resident.length} bytes; expected ${lit.length * lineOfResident}`);
  lit.forEach((tile, i) => readResident(bundle, tile, resident.at + i * lineOfResident));
  let at = resident.end;
  for (const tile of bundle.tiles) {
    expect(tile.at === at, `offset of tile ${nameOf(tile)}: ${tile.at}; expected ${at}`);
    for (const part of tile.parts) {
      part.at = at;
      at += part.length;
    }
    [tile.features, tile.levels, tile.shadows, tile.planes] = KNOWN.map(kind => tile.parts.find(part => part.kind === kind && part.length > 0) ?? null);
    expect(!tile.shadows || tile.levels, `moving shadows of tile ${nameOf(tile)}, which sees nothing of the sun`);
    if (tile.features) checkWord(bundle, tile);
    if (tile.planes) expect(tile.planes.word <= 64 * (1 + tile.lamps.length / 3), `word ${tile.planes.word} of tile ${nameOf(tile)}`);
  }
  expect(at === bundle.bytes.length, `payloads end at byte ${at} of ${bundle.bytes.length}`);
}

function newTile(page, number, column, row) {
  const own = [Math.min(PAYLOAD, page.width - PAYLOAD * column), Math.min(PAYLOAD, page.height - PAYLOAD * row)];
  const [width, height] = own.map(side => 4 * Math.ceil((side + 2) / 4));
  return { page: number, column, row, ownWidth: own[0], ownHeight: own[1], width, height, parts: [], means: null };
}

function nameOf(tile) { return `${tile.column}, ${tile.row} of page ${tile.page}`; }

// Means by knot, and the second frame's shares; then the means of each light group that is apart.
function readResident(bundle, tile, at) {
  const c = new Cursor(bundle.bytes, at), bits = new DataView(c.bytes.buffer, c.bytes.byteOffset).getUint32(c.skip(4, 'scale'), true);
  const exponent = bits >>> 23;
  expect((bits & 0x7fffff) === 0 && exponent > 0 && exponent < 255 && c.u32('zero') === 0, `scale of tile ${nameOf(tile)} is not a power of two`);
  const scale = 2 ** (exponent - 127), knots = bundle.knots.length, words = knots + bundle.groups.filter(group => group.apart).length;
  const means = new Float64Array(3 * words);
  tile.shares = new Float64Array(knots);
  tile.peaks = new Float64Array(words);
  for (let k = 0; k < words; k++) {
    for (let i = 0; i < 3; i++) {
      const bits = c.u16('mean');
      expect(bits < 0x7c00, `a mean of tile ${nameOf(tile)} that is not a finite number ≥ 0`);
      means[3 * k + i] = Math.min(half(bits) * scale, LARGEST);
    }
    const q = c.u8('peak'), share = c.u8('share');
    tile.peaks[k] = q ? Math.min(scale * 2 ** ((q - 130) / 5), LARGEST) : 0;
    if (k < knots) tile.shares[k] = share / 255;
  }
  [tile.means, tile.lamps] = [means.subarray(0, 3 * knots), means.subarray(3 * knots)];
}

// ---- Time (section 4) ----

function isOn(spans, t) {
  return spans.some(([from, to]) => from === 0 && to === 24 || (from <= to ? t > from && t < to : t > from || t < to));
}

// Whether a light group is on at an hour in [0, 24): at a frame's, as the frame shows it.
function isGroupOn(bundle, group, t) {
  const frame = bundle.hours.indexOf(t), { on, states } = bundle.groups[group];
  return frame < 0 ? isOn(on, t) : states[frame] === 1;
}

// x folded into [0, n). What lies there already keeps all its bits; a tiny negative number would be n by rounding.
function mod(x, n) {
  const rest = x % n;
  if (!(rest < 0)) return rest;
  return rest + n < n ? rest + n : 0;
}

// Sets a and b, knots i and j, and how far the hour is from the one to the other. Light groups that are apart do not count.
function momentOf(bundle, hour) {
  expect(Number.isFinite(hour), 'an hour that is not a number');
  const t = mod(hour, 24), { hours, knots } = bundle, groups = bundle.groups.filter(group => !group.apart), n = hours.length;
  const state = groups.map(group => isOn(group.on, t) ? 1 : 0);
  const same = hours.map((_, k) => groups.every((group, g) => group.states[k] === state[g]));
  let q = hours.findIndex(hour => hour >= t);
  if (q < 0) q = 0;
  const p = mod(q - 1, n);
  const at = set => { const knot = knots.indexOf(hours[set]); return { t, a: set, b: set, i: knot, j: knot, g: 0 }; };
  if (hours[q] === t) return at(q);
  if (same[p] && same[q] && p !== q) {
    const i = mod(knots.filter(knot => knot <= t).length - 1, knots.length), j = (i + 1) % knots.length;
    return { t, a: p, b: q, i, j, g: mod(t - knots[i], 24) / mod(knots[j] - knots[i], 24) };
  }
  if (same[p]) return at(p);
  if (same[q]) return at(q);
  const any = same.includes(true), away = k => { const gap = Math.abs(hours[k] - t); return Math.min(gap, 24 - gap); };
  let nearest = -1;
  for (let k = 0; k < n; k++) if ((same[k] || !any) && (nearest < 0 || away(k) < away(nearest))) nearest = k;
  return at(nearest);
}
