// The sun's direct light (FORMAT.md, section 8): its path, levels of visibility, normals, and how shadows move.
'use strict';

// Visibility is kept in units of 1/84: a level is 12 of them, a twelfth of the way between two levels a whole number.
const SEEN = 84;
const OTHER = 258;

function readSun(c, path, seen) {
  expect(path > 0 && seen > 0 && seen <= 1024, `${path} times of the sun, ${seen} of its visibility`);
  const hours = c.list(path, () => c.f64("the sun's path")), times = c.list(seen, () => c.f64('times of visibility'));
  expect(ascends(hours, true) && ascends(times, true), 'times of the sun that are not strictly ascending in [0, 24]');
  const vectors = () => c.list(path, () => [c.f32('the sun'), c.f32('the sun'), c.f32('the sun')]);
  const direction = vectors(), irradiance = vectors();
  expect(direction.every(d => Math.hypot(...d) <= 1 + 1e-5), 'a direction of the sun longer than 1');
  expect(irradiance.every(e => e.every(x => x >= 0 && x <= LARGEST)), 'an irradiance of the sun that is not a finite number ≥ 0');
  return { hours, times, direction, irradiance, tables: readTables(c.take(c.count(1, 'bytes of tables'), 'tables')) };
}

// The palette, and per context the steps of the tANS decoder.
function readTables(bytes) {
  const c = new Cursor(bytes), palette = c.list(256, () => c.u16('the palette'));
  expect(palette.every(pattern => pattern < 4096), 'a pattern of more than twelve bits');
  const modes = c.list(162, () => tansSteps([c.u8('modes'), c.u8('modes'), c.u8('modes')], 7));
  const number = () => { const low = c.u8('patterns'); return low < 128 ? low : low & 127 | c.u8('patterns') << 7; };
  const patterns = c.list(81, () => {
    const frequencies = new Array(OTHER + 1).fill(0), n = number();
    for (let k = 0, symbol = 0; k < n; k++, symbol++) {
      symbol += number();
      expect(symbol <= OTHER, 'a symbol that there is not');
      frequencies[symbol] = number();
      expect(frequencies[symbol] > 0, 'a symbol that does not occur');
    }
    return tansSteps(frequencies, 10);
  });
  expect(c.at === c.end, 'tables of the sun that are too long');
  return { palette, modes, patterns };
}

// By state: symbol, number of bits and base, in one number each of three arrays.
function tansSteps(frequencies, bits) {
  const size = 1 << bits, symbols = new Uint16Array(size), count = new Uint8Array(size), base = new Uint16Array(size);
  expect(frequencies.reduce((a, b) => a + b) === size, 'frequencies of the sun that do not add up');
  let at = 0;
  frequencies.forEach((frequency, symbol) => {
    for (let k = 0; k < frequency; k++) {
      symbols[at] = symbol;
      at = at + size / 2 + size / 8 + 3 & size - 1;
    }
  });
  const next = frequencies.slice();
  for (let i = 0; i < size; i++) {
    const x = next[symbols[i]]++;
    count[i] = bits - (31 - Math.clz32(x));
    base[i] = (x << count[i]) - size;
  }
  return { symbols, count, base };
}

// The indices of the times before and after t, and how far it is from the one to the other.
function aroundTime(times, t) {
  let next = times.findIndex(time => time > t);
  if (next < 0) next = times.length;
  const before = Math.max(next - 1, 0), after = Math.min(next, times.length - 1), span = times[after] - times[before];
  return { before, after, part: span > 0 ? (t - times[before]) / span : 0 };
}

// Direction and irradiance at an hour; null where there is no sun.
function sunAt(sun, t) {
  const { hours } = sun;
  if (t < hours[0] || t > hours[hours.length - 1]) return null;
  const { before, after, part } = aroundTime(hours, t);
  const mix = list => [0, 1, 2].map(c => list[before][c] * (1 - part) + list[after][c] * part);
  return { direction: mix(sun.direction), irradiance: mix(sun.irradiance) };
}

// A section of stream 1: where its planes lie, and the normals.
function readTileSun(bundle, tile) {
  if (tile.sun) return tile.sun;
  const { at, length, word } = tile.levels, c = new Cursor(bundle.bytes, at, at + length), times = bundle.sun.times.length;
  const channels = word & 3, palette = word >>> 8 & 255;
  expect((word & ~0xff07) === 0 && channels !== 2 && palette <= 250 && (word & 4 || !palette), `word 0x${word.toString(16)} of the sun of tile ${nameOf(tile)}`);
  const sizes = c.list(channels * times, () => c.u16('planes of the sun'));
  const planes = sizes.map(size => size > 1 ? c.take(size, 'a plane of the sun') : size);
  const normals = word & 4 ? readNormals(c, palette, tile) : null;
  expect(c.end - c.at < 16 && bundle.bytes.subarray(c.at, c.end).every(byte => byte === 0), `the sun of tile ${nameOf(tile)} is too long`);
  return tile.sun = { channels, planes, normals, held: new Map() };
}

// Levels of one channel at one time; the two last read are kept.
function levelsOf(bundle, tile, channel, time) {
  const own = readTileSun(bundle, tile), texels = tile.width * tile.height;
  const plane = own.channels ? own.planes[channel * bundle.sun.times.length + time] : 1;
  if (typeof plane === 'number') return new Uint8Array(texels).fill(7 * plane);
  const key = channel * 1024 + time;
  if (!own.held.has(key)) {
    if (own.held.size >= 2 * own.channels) own.held.delete(own.held.keys().next().value);
    own.held.set(key, decodePlane(bundle.sun.tables, plane, tile.width, tile.height, tile));
  }
  return own.held.get(key);
}

const QUARTERS = [[0, 0], [1, 0], [0, 1], [1, 1]];

function decodePlane(tables, bytes, width, height, tile) {
  let at = 0;
  const end = 8 * bytes.length;
  const take = count => {
    const byte = at >> 3, word = bytes[byte] | bytes[byte + 1] << 8 | bytes[byte + 2] << 16, value = word >> (at & 7) & (1 << count) - 1;
    at += count;
    return value;
  };
  let state = take(7), stateOfPattern = take(10);
  const mode = context => {
    const { symbols, count, base } = tables.modes[context], symbol = symbols[state];
    state = base[state] + take(count[state]);
    return symbol;
  };
  const across = Math.ceil(width / 8), down = Math.ceil(height / 8), stride = 8 * across;
  const eights = new Uint8Array(across * down), fours = new Uint8Array(4 * across * down), levels = new Uint8Array(64 * across * down);
  const fill = (x, y, side) => { for (let row = y; row < y + side; row++) levels.fill(7, row * stride + x, row * stride + x + side); };
  for (let y = 0; y < down; y++) {
    for (let x = 0; x < across; x++) {
      const of = (dx, dy) => x + dx >= 0 && x + dx < across && y + dy >= 0 ? eights[(y + dy) * across + x + dx] : 0;
      const found = eights[y * across + x] = mode(of(-1, 0) + 3 * of(-1, -1) + 9 * of(0, -1) + 27 * of(1, -1));
      if (found === 1) fill(8 * x, 8 * y, 8);
    }
  }
  const wide = 2 * across, mixed = [];
  for (let y = 0; y < 2 * down; y++) for (let x = 0; x < wide; x++) fours[y * wide + x] = eights[(y >> 1) * across + (x >> 1)];
  for (let i = 0; i < eights.length; i++) {
    if (eights[i] === 2) for (const [dx, dy] of QUARTERS) mixed.push([2 * (i % across) + dx, 2 * Math.floor(i / across) + dy]);
  }
  for (const [x, y] of mixed) {
    const west = x > 0 ? fours[y * wide + x - 1] : 0, north = y > 0 ? fours[(y - 1) * wide + x] : 0;
    const east = x + 1 < wide ? fours[y * wide + x + 1] : 2, south = y + 1 < 2 * down ? fours[(y + 1) * wide + x] : 2;
    const found = fours[y * wide + x] = mode(81 + west + 3 * north + 9 * east + 27 * south);
    if (found === 1) fill(4 * x, 4 * y, 4);
  }
  const kind = (x, y) => { const level = x >= 0 && y >= 0 ? levels[y * stride + x] : 0; return level === 0 ? 0 : level === 7 ? 2 : 1; };
  for (const [bx, by] of mixed) {
    if (fours[by * wide + bx] !== 2) continue;
    for (const [dx, dy] of QUARTERS) {
      const x = 4 * bx + 2 * dx, y = 4 * by + 2 * dy;
      const { symbols, count, base } = tables.patterns[27 * kind(x - 1, y) + 9 * kind(x - 1, y + 1) + 3 * kind(x, y - 1) + kind(x + 1, y - 1)];
      const symbol = symbols[stateOfPattern];
      stateOfPattern = base[stateOfPattern] + take(count[stateOfPattern]);
      const pattern = symbol === 0 ? 0 : symbol === 1 ? 0xfff : symbol === OTHER ? take(12) : tables.palette[symbol - 2];
      for (let k = 0; k < 4; k++) levels[(y + (k >> 1)) * stride + x + (k & 1)] = pattern >> 3 * k & 7;
    }
  }
  const ended = state === 0 && stateOfPattern === 0 && at <= end && end - at < 8 && (at === end || bytes[bytes.length - 1] >> (at & 7) === 0);
  expect(ended, `levels of the sun of tile ${nameOf(tile)} do not end as they should`);
  if (stride === width && 8 * down === height) return levels;
  const cropped = new Uint8Array(width * height);
  for (let y = 0; y < height; y++) cropped.set(levels.subarray(y * stride, y * stride + width), y * width);
  return cropped;
}

// ---- Normals ----

const DIRECTIONS = { 250: [1, 0], 251: [2, 1], 252: [2, 2], 253: [4, 2], 254: [8, 3], 255: [16, 0] };

function readNormals(c, count, tile) {
  const palette = c.list(count, () => [0, 1, 2].map(() => {
    const bits = c.u16('normals');
    return (bits > 32767 ? bits - 65536 : bits) / 32767;
  }));
  const across = tile.width / 4, blocks = across * tile.height / 4, kinds = new Uint8Array(blocks);
  for (let i = 0; i < blocks;) {
    const same = c.u8('normals'), run = c.u8('normals'), kind = c.u8('normals');
    expect(same + run > 0 && i + same + run <= blocks && (same === 0 || i >= across), `runs of normals of tile ${nameOf(tile)}`);
    for (let k = 0; k < same; k++, i++) kinds[i] = kinds[i - across];
    kinds.fill(kind, i, i + run);
    i += run;
  }
  const out = new Float32Array(3 * tile.width * tile.height);
  kinds.forEach((kind, block) => {
    expect(kind >= 250 || kind < count, `a normal that the palette of tile ${nameOf(tile)} lacks`);
    const of = kind < 250 ? () => palette[kind] : readBlockOfNormals(c, kind);
    for (let i = 0; i < 16; i++) {
      const x = 4 * (block % across) + (i & 3), y = 4 * Math.floor(block / across) + (i >> 2);
      out.set(of(i), 3 * (y * tile.width + x));
    }
  });
  return out;
}

function unit(v) { const length = Math.hypot(...v); return length > 0 ? v.map(x => x / length) : v; }

function readDirection(c) {
  const u = Math.max((c.u8('a normal') - 128) / 127, -1), v = Math.max((c.u8('a normal') - 128) / 127, -1);
  const y = 1 - Math.abs(u) - Math.abs(v), f = Math.max(-y, 0);
  return unit([u < 0 ? u + f : u - f, y, v < 0 ? v + f : v - f]);
}

function readBlockOfNormals(c, kind) {
  const [told, bits] = DIRECTIONS[kind];
  let ends = c.list(told, () => readDirection(c));
  if (kind === 252) ends = [0, 1, 2, 3].map(k => unit(ends[0].map((x, i) => x * (1 - k / 3) + ends[1][i] * k / 3)));
  const choice = c.take(2 * bits, 'normals');
  const number = i => { const at = bits * i, word = choice[at >> 3] | choice[(at >> 3) + 1] << 8; return word >> (at & 7) & (1 << bits) - 1; };
  return i => ends[bits ? number(i) : Math.min(i, told - 1)];
}

// ---- Moving shadows ----

// The codebook, which the page brings along.
let codebook = null;

// What a codeword adds at step s of an interval, 4 × 4 texels in sevenths.
function codeword(number, s) {
  const out = new Int8Array(16), bit = k => number >> k & 1;
  const step = bit(12) ? 12 - s : s;
  if (s === 0 || s === 12) return out;
  for (let i = 0; i < 16; i++) {
    let x = i & 3, y = i >> 2;
    if (bit(13)) [x, y] = [y, x];
    if (bit(14)) x = 3 - x;
    if (bit(15)) y = 3 - y;
    const at = 4 * y + x, byte = codebook[88 * (number & 2047) + 8 * (step - 1) + (at >> 1)];
    const value = (at & 1 ? byte >> 4 : byte & 15) - 7;
    out[i] = bit(11) ? -value : value;
  }
  return out;
}

// The part of an interval of one channel in a section of stream 2.
function shadowPart(bundle, tile, plane, planes) {
  const { at, length } = tile.shadows, c = new Cursor(bundle.bytes, at, at + length);
  if (!tile.borders) {
    const borders = c.list(c.end - c.at >= 4 * planes ? planes : refuse(`moving shadows of tile ${nameOf(tile)}`), () => c.u32('moving shadows'));
    const rest = length - 4 * planes - 2 * borders[planes - 1];
    const good = borders.every((border, i) => i === 0 || borders[i - 1] <= border) && rest >= 0 && rest < 16;
    expect(good && bundle.bytes.subarray(c.end - rest, c.end).every(byte => byte === 0), `moving shadows of tile ${nameOf(tile)}`);
    tile.borders = borders;
  }
  const from = plane ? tile.borders[plane - 1] : 0, first = at + 4 * planes;
  return new Cursor(bundle.bytes, first + 2 * from, first + 2 * tile.borders[plane]);
}

// Applies an interval's codewords to what is seen at steps `step` and `step` + 1, in units of 1/84.
function moveShadows(bundle, tile, c, step, seen) {
  if (c.at === c.end) return;
  const wrong = () => refuse(`a part of the moving shadows of tile ${nameOf(tile)}`);
  const across = Math.ceil(tile.width / 32), groups = across * Math.ceil(tile.height / 32), sizes = c.take(groups, 'groups of shadows');
  if (groups % 2 && c.u8('groups of shadows') !== 0) wrong();
  for (let group = 0; group < groups; group++) {
    if (!sizes[group]) continue;
    const own = new Cursor(bundle.bytes, c.skip(2 * sizes[group], 'a group of shadows'), c.at), modes = own.u32('modes of shadows');
    let told = 0;
    for (let i = 0; i < 16; i++) told += [0, 0, 1, 2][modes >>> 2 * i & 3];
    const numbers = own.take(2 * Math.ceil(told / 4), 'numbers of shadows');
    let nibble = 0;
    const next = () => { const at = nibble++; return numbers[at >> 1] >> 4 * (at & 1) & 15; };
    for (let i = 0; i < 16; i++) {
      const x = 32 * (group % across) + 8 * (i & 3), y = 32 * Math.floor(group / across) + 8 * (i >> 2), mode = modes >>> 2 * i & 3;
      if (mode === 1) addCodeword(tile, own.u16('a codeword'), step, seen, x, y, 2);
      if (mode < 2) continue;
      const first = next(), counts = mode === 2 ? [0, 1, 2, 3].map(k => first >> k & 1) : [first & 3, first >> 2, 0, 0];
      if (mode === 3) { const second = next(); counts[2] = second & 3; counts[3] = second >> 2; }
      counts.forEach((count, k) => {
        for (let n = 0; n < count; n++) addCodeword(tile, own.u16('a codeword'), step, seen, x + 4 * (k & 1), y + 4 * (k >> 1), 1);
      });
    }
    if (own.at !== own.end) wrong();
  }
  if (c.at !== c.end) wrong();
}

function addCodeword(tile, number, step, seen, x0, y0, scale) {
  for (let end = 0; end < 2; end++) {
    const values = codeword(number, step + end), out = seen[end];
    for (let y = y0; y < Math.min(y0 + 4 * scale, tile.height); y++) {
      for (let x = x0; x < Math.min(x0 + 4 * scale, tile.width); x++) {
        const i = y * tile.width + x, value = values[4 * ((y - y0) / scale | 0) + ((x - x0) / scale | 0)];
        out[i] = Math.min(Math.max(out[i] + 12 * value, 0), SEEN);
      }
    }
  }
}

// What a tile sees of the sun around t: per channel two planes in units of 1/84, and how far t is from the one to the other.
// `key` changes when the planes do.
function seenOf(bundle, tile, t) {
  const own = readTileSun(bundle, tile), times = bundle.sun.times, { before, after, part } = aroundTime(times, t);
  const moves = tile.shadows && before < after, step = moves ? Math.min(Math.floor(12 * part), 11) : 0, channels = Math.max(own.channels, 1);
  const key = 16 * before + step + (before < after ? 0 : 15), share = moves ? 12 * part - step : part;
  if (own.key === key) return { planes: own.seen, share, key };
  own.seen = Array.from({ length: channels }, (_, channel) => {
    const ends = [before, after].map(time => levelsOf(bundle, tile, channel, time));
    if (!moves) return ends.map(levels => levels.map(level => 12 * level));
    const planes = [step, step + 1].map(s => ends[0].map((level, i) => 12 * level + (ends[1][i] - level) * s));
    moveShadows(bundle, tile, shadowPart(bundle, tile, channel * (times.length - 1) + before, channels * (times.length - 1)), step, planes);
    return planes;
  });
  own.key = key;
  return { planes: own.seen, share, key };
}

// The sun on a tile at t; null where there is none.
function sunOf(bundle, tile, t) {
  const sun = sunAt(bundle.sun, t), own = readTileSun(bundle, tile);
  return sun && own.normals ? { ...sun, ...seenOf(bundle, tile, t), normals: own.normals } : null;
}

// Its light on texel i in channel c.
function sunTexel({ planes, share, normals, direction, irradiance }, tile, i, c) {
  const [a, b] = planes[planes.length > 1 ? c : 0];
  const cosine = normals[3 * i] * direction[0] + normals[3 * i + 1] * direction[1] + normals[3 * i + 2] * direction[2];
  return (a[i] * (1 - share) + b[i] * share) / SEEN * Math.max(cosine, 0) * irradiance[c];
}
