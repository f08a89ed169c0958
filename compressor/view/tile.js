// A tile's features and decoder (FORMAT.md, sections 2, 3, 5, 6), unpacked and decoded in plain JavaScript.
'use strict';

const GREY = [0x40, 0x20, 0x10, 8, 4, 2, 0x81, 0x40, 0, 0, 0, 0, 0, 0, 0, 0];

// What the word of the index says a tile has.
function contentsOf(word, tile) {
  const field = (at, bits) => word >>> at & (1 << bits) - 1;
  const side = field(4, 3) && 2 << field(4, 3), of = stored => 4 * Math.ceil(Math.ceil(stored * side / 128) / 4);
  const has = { uv: field(0, 1), ut: field(1, 1), vt: field(2, 1), gamma: field(3, 1) };
  const hidden = [16, 64, 32, 0][field(7, 1) + 2 * field(15, 1)];
  const gates = field(24, 6), inputs = (side ? 4 : 0) + 4 * has.uv + 2 * has.ut + 2 * has.vt + 4 * has.gamma + gates;
  return {
    ...has, hidden, gates, inputs, side, slices: field(8, 7), rows: field(16, 8), sparse: [field(30, 1), field(31, 1)],
    uvtWidth: side ? of(tile.width) : 0, uvtHeight: side ? of(tile.height) : 0,
  };
}

function checkWord(bundle, tile) {
  const word = tile.features.word, has = contentsOf(word, tile), { length } = tile.features;
  const known = has.hidden > 0 && !has.side === !has.slices && !(has.ut || has.vt) === !has.rows && (has.uv || !has.sparse[0]) && (has.side || !has.sparse[1]);
  expect(known && has.gates <= bundle.groups.length, `word 0x${word.toString(16)} of tile ${nameOf(tile)}`);
  const blocks = blocksOf(has, tile);
  const rest = 2 + 2 * bundle.hours.length + 2 * has.gates
    + 2 * has.rows * (has.ut * Math.ceil(tile.width / 2) + has.vt * Math.ceil(tile.height / 2)) + 2 * weightsOf(has).reduce((a, b) => a + b);
  const least = rest + blocks.reduce((sum, n, i) => sum + (has.sparse[i] ? fieldLength(n) : 16 * n), 0);
  const most = rest + 16 * (blocks[0] + blocks[1]);
  expect(length >= least && length <= Math.ceil(most / 16) * 16, `${length} bytes of features of tile ${nameOf(tile)}; expected ${least} to ${most}`);
  tile.has = has;
}

function blocksOf(has, tile) {
  return [has.uv ? tile.width * tile.height / 16 : 0, has.uvtWidth * has.uvtHeight / 16 * has.slices];
}
function fieldLength(blocks) { return 16 * Math.ceil(Math.ceil(blocks / 8) / 16); }
function weightsOf({ inputs, hidden: h }) { return [inputs * h, h, h * h, h, 3 * h, 3]; }

// Reads a section of features, once.
function featuresOf(bundle, tile) {
  if (tile.read) return tile.read;
  const { at, length } = tile.features, has = tile.has, n = bundle.hours.length, c = new Cursor(bundle.bytes, at, at + length);
  const wrong = what => refuse(`tile ${nameOf(tile)}: ${what}`);
  const read = { has };
  [read.uv, read.uvt] = blocksOf(has, tile).map((count, i) => readMap(c, count, has.sparse[i], wrong));
  read.places = readAxis(c, n, wrong);
  read.gates = c.list(has.gates, () => c.u16('gates'));
  if (!read.gates.every((gate, i) => gate < bundle.groups.length && (i === 0 || read.gates[i - 1] < gate))) wrong('gates that do not ascend, or are no light groups');
  const plane = (there, side) => there ? c.take(2 * has.rows * Math.ceil(side / 2), 'a plane') : null;
  read.ut = plane(has.ut, tile.width);
  read.vt = plane(has.vt, tile.height);
  read.weights = weightsOf(has).map(count => Float64Array.from({ length: count }, () => half(c.u16('the decoder'))));
  if (!read.weights.every(part => part.every(Number.isFinite))) wrong('a weight that is not finite');
  if (c.end - c.at >= 16 || bundle.bytes.subarray(c.at, c.end).some(byte => byte !== 0)) wrong('more than zeros behind the decoder');
  return tile.read = read;
}

// The blocks of a map; omitted blocks are filled in when they are needed.
function readMap(c, count, sparse, wrong) {
  if (!count) return null;
  const length = fieldLength(count), map = { count, field: sparse ? c.take(length, 'a bit field') : null };
  let there = count;
  if (sparse) {
    there = 0;
    for (let i = 0; i < 8 * length; i++) {
      const bit = map.field[i >> 3] >> (i & 7) & 1;
      if (bit && i >= count) wrong('a block that its map does not have');
      there += bit;
    }
  }
  map.blocks = c.take(16 * there, 'blocks');
  let grey = 0;
  for (let at = 0; at < map.blocks.length; at += 16) {
    if ((map.blocks[at] & 127) !== 64 && (map.blocks[at] & 31) !== 16) wrong('a block that is neither of BC7 mode 6 nor of mode 4');
    if (GREY.every((byte, i) => map.blocks[at + i] === byte)) grey++;
  }
  if (sparse ? grey > 0 || 16 * (count - there) <= length : 16 * grey > length) wrong('grey blocks stored or omitted against FORMAT.md, section 3');
  return map;
}

// All blocks of a map.
function denseBlocks(map) {
  if (!map.field) return map.blocks;
  const out = new Uint8Array(16 * map.count);
  for (let i = 0, at = 0; i < map.count; i++) {
    const there = map.field[i >> 3] >> (i & 7) & 1;
    out.set(there ? map.blocks.subarray(at, at + 16) : GREY, 16 * i);
    if (there) at += 16;
  }
  return out;
}

// The places of the frames along τ.
function readAxis(c, n, wrong) {
  const m = c.u16('time axis'), places = c.list(n, () => c.u16('time axis'));
  const largest = places.reduce((a, b) => Math.max(a, b)), turn = places.lastIndexOf(largest) + 1;
  const good = places[0] === 0 && largest < m && places.every((place, k) => k === 0 || (k < turn ? places[k - 1] <= place : place === 0));
  if (!good) wrong('a time axis that steps back, or past its end');
  return places.map(place => (place + 0.5) / m);
}

// ---- BC7 modes 6 and 4 ----

const WEIGHTS = [, , [0, 21, 43, 64], [0, 9, 18, 27, 37, 46, 55, 64], [0, 4, 9, 13, 17, 21, 26, 30, 34, 38, 43, 47, 51, 55, 60, 64]];

// Texels of `slices` images of width × height, 4 bytes each.
function unpackBlocks(blocks, width, height, slices) {
  const out = new Uint8Array(4 * width * height * slices), across = width / 4, per = across * height / 4;
  for (let i = 0; i < per * slices; i++) {
    const x = 4 * (i % across), y = 4 * Math.floor(i % per / across);
    unpackBlock(blocks, 16 * i, out, 4 * ((Math.floor(i / per) * height + y) * width + x), 4 * width);
  }
  return out;
}

const ends = new Int32Array(8), texel = new Int32Array(4);

function unpackBlock(blocks, from, out, to, stride) {
  let at = 0;
  const bits = count => {
    const byte = from + (at >> 3), word = blocks[byte] | blocks[byte + 1] << 8, value = word >> (at & 7) & (1 << count) - 1;
    at += count;
    return value;
  };
  const between = (channel, weight) => (64 - weight) * ends[2 * channel] + weight * ends[2 * channel + 1] + 32 >> 6;
  const put = i => { for (let k = 0; k < 4; k++) out[to + (i >> 2) * stride + 4 * (i & 3) + k] = texel[k]; };
  if ((blocks[from] & 127) === 64) {
    at = 7;
    for (let e = 0; e < 8; e++) ends[e] = 2 * bits(7);
    const p = [bits(1), bits(1)];
    for (let e = 0; e < 8; e++) ends[e] += p[e & 1];
    for (let i = 0; i < 16; i++) {
      const weight = WEIGHTS[4][bits(i ? 4 : 3)];
      for (let k = 0; k < 4; k++) texel[k] = between(k, weight);
      put(i);
    }
    return;
  }
  at = 5;
  const rotation = bits(2), swapped = bits(1);
  for (let e = 0; e < 6; e++) { const v = bits(5); ends[e] = v << 3 | v >> 2; }
  for (let e = 6; e < 8; e++) { const v = bits(6); ends[e] = v << 2 | v >> 4; }
  const two = [], three = [];
  for (let i = 0; i < 16; i++) two.push(WEIGHTS[2][bits(i ? 2 : 1)]);
  for (let i = 0; i < 16; i++) three.push(WEIGHTS[3][bits(i ? 3 : 2)]);
  for (let i = 0; i < 16; i++) {
    const [colour, alone] = swapped ? [three[i], two[i]] : [two[i], three[i]];
    for (let k = 0; k < 3; k++) texel[k] = between(k, colour);
    texel[3] = between(3, alone);
    if (rotation) [texel[rotation - 1], texel[3]] = [texel[3], texel[rotation - 1]];
    put(i);
  }
}

// ---- A tile at a time ----

function meansAt(tile, { i, j, g }) { return [0, 1, 2].map(c => (1 - g) * tile.means[3 * i + c] + g * tile.means[3 * j + c]); }

// The same with the light groups that are apart and on.
function allMeansAt(bundle, tile, moment) {
  const mean = meansAt(tile, moment);
  let at = 0;
  bundle.groups.forEach((group, g) => {
    if (!group.apart) return;
    if (isGroupOn(bundle, g, moment.t)) for (let c = 0; c < 3; c++) mean[c] += tile.lamps[at + c];
    at += 3;
  });
  return mean;
}

// The second frame's share of the light.
function shareOf(bundle, tile, { a, b, i, j, g }) {
  const sum = k => tile.means[3 * k] + tile.means[3 * k + 1] + tile.means[3 * k + 2];
  const first = bundle.knots[i] === bundle.hours[a] ? 0 : tile.shares[i], last = bundle.knots[j] === bundle.hours[b] ? 1 : tile.shares[j];
  const light = [(1 - g) * sum(i), g * sum(j)], all = light[0] + light[1];
  return a === b ? 0 : all > 0 ? (light[0] * first + light[1] * last) / all : (1 - g) * first + g * last;
}

// What of a tile at a moment depends on the time alone: τ, means, and b₁ with γ and gates folded in.
function foldTile(bundle, tile, moment) {
  const read = featuresOf(bundle, tile), { has, weights: [w1, b1] } = read, { a, b } = moment;
  const mean = meansAt(tile, moment), share = shareOf(bundle, tile, moment);
  const tau = read.places[a] + share * mod(read.places[b] - read.places[a], 1);
  const features = has.inputs - 4 * has.gamma - has.gates, angle = 2 * Math.PI * tau;
  const inputs = has.gamma ? [Math.sin(angle), Math.cos(angle), Math.sin(2 * angle), Math.cos(2 * angle)] : [];
  for (const gate of read.gates) inputs.push(bundle.groups[gate].states[a] ? 1 : -1);
  const bias = Float64Array.from(b1, (value, row) => {
    for (let k = 0; k < inputs.length; k++) value += w1[row * has.inputs + features + k] * inputs[k];
    return value;
  });
  const along = size => {
    const s = tau * size - 0.5, low = Math.floor(s);
    return { first: mod(low, size), second: mod(low + 1, size), share: s - low };
  };
  return { mean, tau, bias, features, slices: has.slices ? along(has.slices) : null, rows: has.rows ? along(has.rows) : null };
}

function gelu(x) {
  const z = Math.min(Math.max(x, -2.25), 2.25);
  return x * (0.5 + z / 3 - 16 / 729 * z * z * z);
}

// A clamped axis of `size` texels, read at stored texel i of `stored`.
function clamped(i, stored, size) {
  const s = Math.min(Math.max((i + 0.5) / stored * size - 0.5, 0), size - 1), low = Math.floor(s);
  return [low, Math.min(low + 1, size - 1), s - low];
}

// F_uv and F_uvt as bytes, kept with the tile until `forgetTexels`.
function texelsOf(tile) {
  const { read } = tile, { has } = read;
  read.uvTexels ??= read.uv && unpackBlocks(denseBlocks(read.uv), tile.width, tile.height, 1);
  read.uvtTexels ??= read.uvt && unpackBlocks(denseBlocks(read.uvt), has.uvtWidth, has.uvtHeight, has.slices);
  return read;
}
function forgetTexels(tile) {
  if (tile.read) tile.read.uvTexels = tile.read.uvtTexels = null;
  forgetPlanes(tile);
}

// The light that maps hold of one stored texel, as folded.
function texelOf(tile, folded, x, y) {
  const { has, weights: [w1, , w2, b2, w3, b3], uvTexels: uv, uvtTexels: uvt, ut, vt } = tile.read, input = [];
  if (uvt) {
    const { uvtWidth: width, uvtHeight: height } = has, [x0, x1, fx] = clamped(x, tile.width, width), [y0, y1, fy] = clamped(y, tile.height, height);
    const { first, second, share } = folded.slices;
    for (let k = 0; k < 4; k++) {
      const at = (slice, x, y) => uvt[4 * ((slice * height + y) * width + x) + k];
      const plane = slice => (at(slice, x0, y0) * (1 - fx) + at(slice, x1, y0) * fx) * (1 - fy) + (at(slice, x0, y1) * (1 - fx) + at(slice, x1, y1) * fx) * fy;
      input.push(plane(first) * (1 - share) + plane(second) * share);
    }
  }
  if (uv) for (let k = 0; k < 4; k++) input.push(uv[4 * (y * tile.width + x) + k]);
  for (const [plane, i, side] of [[ut, x, tile.width], [vt, y, tile.height]]) {
    if (!plane) continue;
    const size = Math.ceil(side / 2), [i0, i1, f] = clamped(i, side, size), { first, second, share } = folded.rows;
    for (let k = 0; k < 2; k++) {
      const row = r => plane[2 * (r * size + i0) + k] * (1 - f) + plane[2 * (r * size + i1) + k] * f;
      input.push(row(first) * (1 - share) + row(second) * share);
    }
  }
  for (let k = 0; k < input.length; k++) input[k] = 3 * (input[k] / 255 - 0.5);
  const layer = (weights, bias, inputs, stride) => Array.from(bias, (value, row) => {
    for (let k = 0; k < inputs.length; k++) value += weights[row * stride + k] * inputs[k];
    return value;
  });
  const h1 = layer(w1, folded.bias, input, has.inputs).map(gelu), h2 = layer(w2, b2, h1, has.hidden).map(gelu);
  return layer(w3, b3, h2, has.hidden).map((y, c) => Math.min(folded.mean[c] * Math.min(Math.max(y, 0), 65504) ** 2, LARGEST));
}

// The light that a tile's maps hold at a moment, by stored texel.
function mapsAt(bundle, tile, moment) {
  if (tile.planes) {
    planesOf(bundle, tile);
    const folded = foldPlanes(bundle, tile, moment);
    return (x, y) => planesTexel(folded, y * tile.width + x);
  }
  if (!tile.features) return () => [0, 0, 0];
  const folded = foldTile(bundle, tile, moment);
  texelsOf(tile);
  return (x, y) => texelOf(tile, folded, x, y);
}

// All light of one stored texel.
function decodeTexel(bundle, tile, hour, x, y) {
  const moment = momentOf(bundle, hour), light = mapsAt(bundle, tile, moment)(x, y);
  if (!tile.levels) return light;
  const sun = sunOf(bundle, tile, moment.t);
  return sun ? light.map((value, c) => Math.min(value + sunTexel(sun, tile, y * tile.width + x, c), LARGEST)) : light;
}

// All light of what a tile stores: width × height × 3.
function decodeTile(bundle, tile, hour) {
  const moment = momentOf(bundle, hour), out = new Float32Array(3 * tile.width * tile.height);
  const maps = mapsAt(bundle, tile, moment), sun = tile.levels && sunOf(bundle, tile, moment.t);
  for (let y = 0, i = 0; y < tile.height; y++) {
    for (let x = 0; x < tile.width; x++, i++) {
      const light = maps(x, y);
      for (let c = 0; c < 3; c++) out[3 * i + c] = Math.min(light[c] + (sun ? sunTexel(sun, tile, i, c) : 0), LARGEST);
    }
  }
  return out;
}
