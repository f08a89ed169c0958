// A tile's planes (FORMAT.md, section 9), decoded in plain JavaScript.
'use strict';

const MOST_PLANES = 64;
const MOST_PLANES_OF_TILE = 1024;
const MOST_FACTOR = 2 ** 24;

// ---- Range coding ----

const SHIFTS = [1, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5];

// Contexts by number: probability of 0 in 2⁻¹⁶, and bits seen.
class Contexts {
  constructor(count) {
    this.zero = new Uint16Array(count).fill(32768);
    this.seen = new Uint8Array(count);
  }
}

// Numbers stay below 2³², where doubles are exact; behind the last byte there are zeros.
class RangeReader {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
    this.range = 2 ** 32 - 1;
    this.code = 0;
    for (let i = 0; i < 4; i++) this.code = (this.code << 8 | this.byte()) >>> 0;
  }
  byte() { return this.at < this.bytes.length ? this.bytes[this.at++] : (this.at++, 0); }
  widen() {
    while (this.range < 2 ** 24) {
      this.range *= 256;
      this.code = (this.code << 8 | this.byte()) >>> 0;
    }
  }
  bit(contexts, i) {
    const p = contexts.zero[i], shift = SHIFTS[contexts.seen[i]], zero = (this.range >>> 16) * Math.min(Math.max(p, 64), 65471);
    const bit = this.code < zero ? 0 : 1;
    if (bit) {
      this.code -= zero;
      this.range -= zero;
      contexts.zero[i] = p - (p >> shift);
    } else {
      this.range = zero;
      contexts.zero[i] = p + (65535 - p >> shift);
    }
    if (contexts.seen[i] < 15) contexts.seen[i]++;
    this.widen();
    return bit;
  }
  raw(count) {
    let value = 0;
    for (let i = 0; i < count; i++) {
      this.range = Math.floor(this.range / 2);
      const bit = this.code >= this.range ? 1 : 0;
      if (bit) this.code -= this.range;
      value = 2 * value + bit;
      this.widen();
    }
    return value;
  }
  // By a list of 24 contexts from `first` on.
  number(contexts, first = 0) {
    let n = 0;
    while (n < 29 && this.bit(contexts, first + Math.min(n, 23))) n++;
    return 2 ** n + this.raw(n) - 1;
  }
  signed(contexts, first) {
    const size = this.number(contexts, first);
    return size && this.raw(1) ? -size : size;
  }
}

// ---- Coefficients ----

// Places (row · 8 + column) by diagonals, and where each diagonal begins.
const ORDER = [], DIAGONALS = [0];
for (let d = 0; d < 15; d++) {
  for (let i = 0; i <= d; i++) {
    const [row, column] = d % 2 ? [i, d - i] : [d - i, i];
    if (row < 8 && column < 8) ORDER.push(8 * row + column);
  }
  DIAGONALS.push(ORDER.length);
}
const LEVEL = Array.from({ length: 15 * 13 + 1 }, (_, sum) => [1, 2, 3, 4, 5, 7, 9, 12, 16, 22, 30, 42, 60, 90, 140].filter(least => least <= sum).length);
const CLASSES = [0, 2, 4, 7, 11, 16, 22];

// Contexts of a set's coefficients.
function newModel() {
  return { diagonals: new Contexts(8 * 3 * 16), nonzero: new Contexts(3 * 16), more: new Contexts(2 * 16), rest: new Contexts(24) };
}

// The coefficients of a plane, 64 a block; `counts` are the diagonals of each block. `before`: the same of the plane before, or null.
function readPlane(reader, model, columns, covered, before) {
  const blocks = covered.length, plane = { coefficients: new Int16Array(64 * blocks), counts: new Uint8Array(blocks) };
  for (let i = 0; i < blocks; i++) {
    if (!covered[i]) continue;
    const left = i % columns ? i - 1 : -1, above = i - columns, under = before ? before.counts[i] : 0;
    let sum = 2 * under;
    if (left >= 0 && above >= 0) sum = plane.counts[left] + plane.counts[above];
    else if (left >= 0 || above >= 0) sum = 2 * plane.counts[Math.max(left, above)];
    const tree = 16 * (3 * CLASSES.filter(most => sum > most).length + (under > 3 ? 2 : Math.min(under, 1)));
    let node = 1;
    while (node < 16) node = 2 * node + reader.bit(model.diagonals, tree + node);
    plane.counts[i] = node - 16;
    readBlock(reader, model, plane, i, left >= 0 ? left : above, above >= 0 ? above : left, before);
  }
  return plane;
}

// Neighbours below 0 are missing.
function readBlock(reader, model, plane, block, left, above, before) {
  const values = plane.coefficients, from = 64 * block, seen = (of, at) => Math.min(Math.abs(of[at]), 15), count = DIAGONALS[plane.counts[block]];
  for (let n = 0; n < count; n++) {
    const at = ORDER[n];
    let sum = 0;
    if (at % 8) sum += 2 * seen(values, from + at - 1);
    if (at >= 8) sum += 2 * seen(values, from + at - 8);
    if (left >= 0) sum += 3 * seen(values, 64 * left + at);
    if (above >= 0) sum += 3 * seen(values, 64 * above + at);
    if (before) sum += 3 * seen(before.coefficients, from + at);
    const level = LEVEL[sum], band = n === 0 ? 0 : n < 6 ? 1 : 2;
    if (!reader.bit(model.nonzero, 16 * band + level)) continue;
    let size = 1;
    while (size < 15 && reader.bit(model.more, (size > 1 ? 16 : 0) + level)) size++;
    if (size === 15) size += reader.number(model.rest);
    size = Math.min(size, 32767);
    values[from + at] = reader.raw(1) ? -size : size;
  }
}

// ---- The transform ----

const COSINES = Array.from({ length: 64 }, (_, i) => Math.round(4096 * (i < 8 ? Math.sqrt(1 / 8) : 0.5) * Math.cos((2 * (i % 8) + 1) * (i >> 3) * Math.PI / 16)));
const between = new Int32Array(64);

// Writes the block whose coefficients begin at `from` into `out`, rows of `width`; texels past `across` or `down` are left out.
function inverse(coefficients, from, out, to, width, across, down) {
  for (let y = 0; y < 8; y++) {
    for (let u = 0; u < 8; u++) {
      let sum = 128;
      for (let v = 0; v < 8; v++) sum += COSINES[8 * v + y] * coefficients[from + 8 * v + u];
      between[8 * y + u] = Math.min(Math.max(sum >> 8, -131071), 131071);
    }
  }
  for (let y = 0; y < down; y++) {
    for (let x = 0; x < across; x++) {
      let sum = 2048;
      for (let u = 0; u < 8; u++) sum += COSINES[8 * u + x] * between[8 * y + u];
      out[to + width * y + x] = Math.min(Math.max(sum >> 12, -32767), 32767);
    }
  }
}

// ---- A section ----

// Of a tile, the place of each frame among those that are not black; −1 for black ones.
function litFrames(bundle, tile) {
  let count = 0;
  return bundle.hours.map(hour => {
    const knot = 3 * bundle.knots.indexOf(hour);
    return tile.means.subarray(knot, knot + 3).some(mean => mean > 0) ? count++ : -1;
  });
}

// Reads a section of planes, once, or again if its values were forgotten: its light sources, with a factor of each plane by frame and channel.
function planesOf(bundle, tile) {
  if (tile.sources?.every(source => source.values)) return tile.sources;
  const c = new Cursor(bundle.bytes, tile.planes.at, tile.planes.at + tile.planes.length), wrong = what => refuse(`tile ${nameOf(tile)}: ${what}`);
  const apart = bundle.groups.map((group, g) => group.apart ? g : -1).filter(g => g >= 0), places = litFrames(bundle, tile);
  const sets = c.list(c.count(8, 'light sources'), () => ({ source: c.u16('source'), count: c.u8('planes'), flags: c.u8('flags'), length: c.u32('length') }));
  let planes = 0;
  sets.forEach((set, i) => {
    set.frames = set.source ? Number(apart.includes(set.source - 1)) : Math.max(...places) + 1;
    if (i && sets[i - 1].source >= set.source) wrong('light sources that do not ascend');
    if (set.count > MOST_PLANES || set.flags > 1 || !set.frames) wrong(`light source ${set.source}: ${set.count} planes, flags ${set.flags}, ${set.frames} frames`);
    set.layer = planes;
    planes += set.count;
  });
  if (planes !== tile.planes.word) wrong(`${planes} planes, but the index says ${tile.planes.word}`);
  if (planes > MOST_PLANES_OF_TILE) wrong(`${planes} planes; expected ${MOST_PLANES_OF_TILE} at most`);
  const sources = sets.map(set => ({ ...set, ...readSet(c.take(set.length, 'planes'), set, tile, wrong), linear: set.flags === 1, place: apart.indexOf(set.source - 1) }));
  if (c.end - c.at >= 16 || bundle.bytes.subarray(c.at, c.end).some(byte => byte !== 0)) wrong('more than zeros behind the planes');
  tile.litFrames = places;
  return tile.sources = sources;
}
// What folding needs stays.
function forgetPlanes(tile) { for (const source of tile.sources ?? []) source.values = null; }

function readSet(bytes, { count, frames }, tile, wrong) {
  const reader = new RangeReader(bytes), columns = Math.ceil(tile.width / 8), blocks = columns * Math.ceil(tile.height / 8);
  const step = reader.raw(8), chroma = reader.raw(8), scales = Array.from({ length: count }, () => reader.raw(8));
  if (!chroma) wrong('colour differences times 0');
  const weights = [], ofWeights = new Contexts(24);
  for (let f = 0; f < frames; f++) {
    weights.push((weights[f - 1] ?? 0) + reader.signed(ofWeights, 0));
    if (!(weights[f] >= -255 && weights[f] <= 0)) wrong(`weight ${weights[f]}`);
  }
  // By frame and component. One list of contexts for the first frame, one for others.
  const series = contexts => {
    const values = new Float64Array(3 * frames);
    for (let j = 0; j < 3; j++) {
      for (let f = 0, value = 0; f < frames; f++) {
        value += reader.signed(contexts, f ? 24 : 0);
        if (Math.abs(value) > MOST_FACTOR) wrong(`a factor of ${value}`);
        values[3 * f + j] = value;
      }
    }
    return values;
  };
  const ofFactors = new Contexts(48), factors = scales.map(() => series(ofFactors));
  const covered = new Uint8Array(blocks), ofCovered = new Contexts(4);
  for (let i = 0; i < blocks; i++) covered[i] = reader.bit(ofCovered, (i % columns ? covered[i - 1] : 0) + 2 * (i < columns ? 0 : covered[i - columns]));
  const model = newModel(), texels = tile.width * tile.height, values = [];
  for (let k = 0, plane = null; k < count; k++) {
    plane = readPlane(reader, model, columns, covered, plane);
    const out = new Int16Array(texels);
    for (let i = 0; i < blocks; i++) {
      const x = 8 * (i % columns), y = 8 * Math.floor(i / columns);
      if (plane.counts[i]) inverse(plane.coefficients, 64 * i, out, tile.width * y + x, tile.width, Math.min(8, tile.width - x), Math.min(8, tile.height - y));
    }
    values.push(out);
  }
  if (reader.at < bytes.length) wrong(`${bytes.length - reader.at} bytes behind the last coefficient`);
  return { values, factors: weights.map((weight, f) => factorsOf({ step, chroma, scales, factors }, weight, f)) };
}

// Of a frame: by channel the factor of each plane.
function factorsOf({ step, chroma, scales, factors }, weight, f) {
  const unit = 2 ** (-step / 8) / 16 * 2 ** (-weight / 8), difference = 16 / chroma;
  const rows = factors.map((of, k) => {
    const size = 2 ** (-scales[k] / 8) * unit;
    const z = [of[3 * f] * size, of[3 * f + 1] * size * difference, of[3 * f + 2] * size * difference];
    const grey = z[0] / Math.sqrt(3), across = z[1] / Math.sqrt(2), green = z[2] / Math.sqrt(6);
    return [grey + across - green, grey + 2 * green, grey - across - green];
  });
  return [0, 1, 2].map(channel => Float64Array.from(rows, row => row[channel]));
}

// ---- A tile at a time ----

// The light sources that are lit at a moment, each with means and factors by channel.
function foldPlanes(bundle, tile, moment) {
  const lit = [], add = (source, mean, factors) => { if (mean.some(mean => mean > 0)) lit.push({ source, mean, factors }); };
  for (const source of tile.sources ?? planesOf(bundle, tile)) {
    if (source.source) {
      const at = 3 * source.place;
      if (isGroupOn(bundle, source.source - 1, moment.t)) add(source, [...tile.lamps.subarray(at, at + 3)], source.factors[0]);
      continue;
    }
    const [a, b] = [tile.litFrames[moment.a], tile.litFrames[moment.b]];
    if (a < 0 && b < 0) continue;
    // Next to a black frame light only fades.
    const first = source.factors[a < 0 ? b : a], last = source.factors[b < 0 ? a : b], share = shareOf(bundle, tile, moment);
    add(source, meansAt(tile, moment), first === last ? first : first.map((of, c) => of.map((value, k) => (1 - share) * value + share * last[c][k])));
  }
  return lit;
}

// The light of the i-th stored texel, as folded, with values that are not forgotten.
function planesTexel(folded, i) {
  const light = [0, 0, 0];
  for (const { source: { values, linear }, mean, factors } of folded) {
    for (let c = 0; c < 3; c++) {
      const of = factors[c];
      let y = 0;
      for (let k = 0; k < values.length; k++) y += of[k] * values[k][i];
      y = Math.min(Math.max(y, 0), 65504);
      light[c] = Math.min(light[c] + mean[c] * (linear ? y : y * y), LARGEST);
    }
  }
  return light;
}
