// Decodes tiles of NDGI bundles (FORMAT.md, sections 6 and 8): any number of them, at one time, in one dispatch.
//
// Workgroup (j, s) decodes rows STRIP·s and on of the stored texels of job j's tile, each thread one column of them. Hardware only unpacks
// BC7; all interpolation is done here, in single precision, as filters of hardware have 8 bits for fractions.
//$ Lines that begin with $ are filled in by shader.rs: types, sizes, and the network's layers, unrolled.

$HEADER

// What of a tile there is at the time.
const HAS_MAPS: u32 = 1u;     // a section of features
const HAS_UVT: u32 = 2u;
const HAS_UV: u32 = 4u;
const HAS_UT: u32 = 8u;
const HAS_VT: u32 = 16u;
const HAS_SUN: u32 = 32u;
const HAS_COLOUR: u32 = 64u;  // the sun is seen through coloured glass: red, green and blue apart
const HAS_WORDS: u32 = 128u;  // its shadows move

const LARGEST: f32 = 3.4028234e38;
const NOT_LARGER: f32 = 65504.0;  // of the network's output, and of 16-bit floats

struct Job {
    size: vec2<u32>,              // stored texels across and down
    has: u32,
    weights: u32,                 // where they begin in `resident`
    own: vec4<u32>,               // the stored texels that are written: from x, y, to x, y
    to: vec2<i32>,                // where stored texel (0, 0) comes on the target
    share_of_slice: f32,          // weight of the second F_uvt slice
    share_of_row: f32,            // weight of the second F_ut and F_vt row
    uv: vec4<u32>,                // where F_uv begins on `maps`: x, y, layer
    first: vec4<u32>,             // the same of the first F_uvt slice around τ
    second: vec4<u32>,            // the same of the second
    uvt: vec2<u32>,               // the size of a slice
    ut: vec2<u32>,                // where the two rows of F_ut around τ begin in `resident`, in 16-bit units
    vt: vec2<u32>,                // the same of F_vt
    sides: vec2<u32>,             // texels of a row of F_ut and of F_vt
    mean: vec4<f32>,              // fourth: exposure
    direction: vec4<f32>,         // to the sun; fourth: how far it is from one time of visibility to the next
    irradiance: vec4<f32>,        // of the sun
    seen: vec4<u32>,              // in `interval`: levels, blocks, codewords (in halves of words)
    normals: vec4<u32>,           // in `resident`: blocks, indices, normals
    bias: array<vec4<f32>, H>,    // of the first layer, with γ and the gates
}

@group(0) @binding(0) var<storage, read> jobs: array<Job>;
// The codebook of moving shadows, if any tile has some; and per tile weights, F_ut, F_vt and normals.
@group(0) @binding(1) var<storage, read> resident: array<u32>;
// Per tile what it sees of the sun at the two times around the time, and how shadows move between them.
@group(0) @binding(2) var<storage, read> interval: array<u32>;
// F_uv and the slices of F_uvt of all tiles.
@group(0) @binding(3) var maps: texture_2d_array<f32>;
@group(0) @binding(4) var destination: texture_storage_2d<$FORMAT, write>;

$SHARED
var<workgroup> biases: array<Vec, BIASES>;      // of the second layer and the third
var<workgroup> coarse: array<vec4<f32>, COARSE>;  // F_uvt at τ: the rows that this strip reads
var<workgroup> of_vt: array<vec2<f32>, STRIP>;    // V_vt of its rows

fn halves(at: u32) -> vec4<f32> {
    return vec4(unpack2x16float(resident[at]), unpack2x16float(resident[at + 1u]));
}

// Four columns of weights, of four outputs each, from eight words.
fn matrix(at: u32) -> Mat {
    return Mat(Vec(halves(at)), Vec(halves(at + 2u)), Vec(halves(at + 4u)), Vec(halves(at + 6u)));
}

fn gelu(x: Vec) -> Vec {
    let z = clamp(x, Vec(-2.25), Vec(2.25));
    return x * (Vec(0.5) + z * (Vec(Scalar(1.0 / 3.0)) - Vec(Scalar(16.0 / 729.0)) * (z * z)));
}

// c(F): features are centred.
fn centred(f: vec4<f32>) -> Vec { return Vec(3.0 * f - 1.5); }

// Where texel i of a side stands on a map of n texels along it.
fn place(i: u32, side: u32, n: u32) -> f32 {
    return clamp((f32(i) + 0.5) / f32(side) * f32(n) - 0.5, 0.0, f32(n - 1u));
}

// Texel `at` of F_ut or F_vt, in [0, 1].
fn two_bytes(at: u32) -> vec2<f32> {
    let word = resident[at / 2u] >> (16u * (at % 2u));
    return vec2(f32(word & 255u), f32(word >> 8u & 255u)) / 255.0;
}

// F_ut or F_vt at τ at texel i of a side: `rows` begin at the two numbers, and have n texels.
fn plane(rows: vec2<u32>, i: u32, side: u32, n: u32, share: f32) -> vec2<f32> {
    let s = place(i, side, n);
    let a = u32(s);
    let b = min(a + 1u, n - 1u);
    let f = s - f32(a);
    let first = mix(two_bytes(rows.x + a), two_bytes(rows.x + b), f);
    let second = mix(two_bytes(rows.y + a), two_bytes(rows.y + b), f);
    return mix(first, second, share);
}

// F_uvt at τ, in [0, 1], at a place among the rows from `top` on that `coarse` holds.
fn between(s: vec2<f32>, size: vec2<u32>, top: u32, bottom: u32) -> vec4<f32> {
    let x = u32(s.x);
    let right = min(x + 1u, size.x - 1u);
    let y = clamp(u32(s.y), top, bottom);
    let above = (y - top) * size.x;
    let below = (min(y + 1u, bottom) - top) * size.x;
    let f = s - vec2(f32(x), f32(y));
    return mix(mix(coarse[above + x], coarse[above + right], f.x), mix(coarse[below + x], coarse[below + right], f.x), f.y);
}

// The shading normal of stored texel (x, y). Per 4×4 block two words: the start of its normal list and, in the upper four bits, its index width;
// and the start of its indices.
fn normal(j: u32, x: u32, y: u32) -> vec3<f32> {
    let block = jobs[j].normals.x + 2u * (y / 4u * (jobs[j].size.x / 4u) + x / 4u);
    let bits = resident[block] >> 28u;
    var at = resident[block] & 0xfffffffu;
    if (bits > 0u) {
        let bit = bits * (y % 4u * 4u + x % 4u);
        let choice = resident[jobs[j].normals.y + resident[block + 1u] + bit / 32u] >> (bit % 32u);
        at += choice & ((1u << bits) - 1u);
    }
    at = jobs[j].normals.z + 3u * at;
    return bitcast<vec3<f32>>(vec3(resident[at], resident[at + 1u], resident[at + 2u]));
}

// What a codeword adds at an end of a step, in sevenths.
fn value(word: u32, step: u32, x: u32, y: u32) -> f32 {
    if (step == 0u || step == 12u) { return 0.0; }
    var at = select(vec2(x, y), vec2(y, x), (word & 0x2000u) != 0u);
    if ((word & 0x4000u) != 0u) { at.x = 3u - at.x; }
    if ((word & 0x8000u) != 0u) { at.y = 3u - at.y; }
    let s = select(step, 12u - step, (word & 0x1000u) != 0u);
    let i = ((word & 0x7ffu) * 11u + s - 1u) * 16u + at.y * 4u + at.x;
    let found = f32(resident[i / 8u] >> (4u * (i % 8u)) & 15u) - 7.0;
    return select(found, -found, (word & 0x800u) != 0u);
}

// The share of the sun that stored texel (x, y) sees in a channel.
fn visibility(j: u32, channel: u32, x: u32, y: u32) -> f32 {
    let size = jobs[j].size;
    let part = jobs[j].direction.w;
    let texels = size.x * size.y;
    let i = y * size.x + x;
    let at = jobs[j].seen.x + 2u * channel * (texels / 8u) + i / 8u;
    let a = f32(interval[at] >> (4u * (i % 8u)) & 15u) / 7.0;
    let b = f32(interval[at + texels / 8u] >> (4u * (i % 8u)) & 15u) / 7.0;
    let still = a * (1.0 - part) + b * part;
    if ((jobs[j].has & HAS_WORDS) == 0u) { return still; }
    // A block of 8×8: 0 without words; 1 one whose texels are doubled; 2 a number of them on each of its four 4×4; and where they begin.
    let across = (size.x + 7u) / 8u;
    let blocks = across * ((size.y + 7u) / 8u);
    let block = interval[jobs[j].seen.y + channel * blocks + y / 8u * across + x / 8u];
    let is_doubled = (block & 3u) == 1u;
    var count = select(0u, 1u, is_doubled);
    var word = jobs[j].seen.z + (block >> 10u);
    var texel = vec2(x % 4u, y % 4u);
    if (is_doubled) {
        texel = vec2(x % 8u / 2u, y % 8u / 2u);
    } else if (block != 0u) {
        let quarter = y % 8u / 4u * 2u + x % 8u / 4u;
        for (var q = 0u; q <= quarter; q++) {
            word += count;
            count = block >> (2u + 2u * q) & 3u;
        }
    }
    if (count == 0u) { return still; }
    let step = min(u32(part * 12.0), 11u);
    var v = vec2(a + (b - a) * (f32(step) / 12.0), a + (b - a) * (f32(step + 1u) / 12.0));
    for (var k = 0u; k < count; k++) {
        let two = interval[(word + k) / 2u] >> (16u * ((word + k) % 2u));
        let added = vec2(value(two, step, texel.x, texel.y), value(two, step + 1u, texel.x, texel.y));
        v = clamp(v + added / 7.0, vec2(0.0), vec2(1.0));
    }
    let f = part * 12.0 - f32(step);
    return v.x * (1.0 - f) + v.y * f;
}

// The sun's direct light.
fn sunlight(j: u32, x: u32, y: u32) -> vec3<f32> {
    let cosine = max(dot(normal(j, x, y), jobs[j].direction.xyz), 0.0);
    if (cosine == 0.0) { return vec3(0.0); }
    let channels = select(1u, 3u, (jobs[j].has & HAS_COLOUR) != 0u);
    var seen = vec3(0.0);
    for (var c = 0u; c < channels; c++) { seen[c] = visibility(j, c, x, y); }
    if (channels == 1u) { seen = seen.xxx; }
    return seen * cosine * jobs[j].irradiance.xyz;
}

// Irradiance from the network's output. What is not a number counts as 0.
fn light(j: u32, output: vec3<f32>) -> vec3<f32> {
    let y = min(select(vec3(0.0), output, output > vec3(0.0)), vec3(NOT_LARGER));
    return min(jobs[j].mean.xyz * (y * y), vec3(LARGEST));
}

fn put(j: u32, x: u32, y: u32, maps_light: vec3<f32>) {
    let own = jobs[j].own;
    if (x < own.x || y < own.y || x >= own.z || y >= own.w) { return; }
    var e = maps_light;
    if ((jobs[j].has & HAS_SUN) != 0u) { e = min(e + sunlight(j, x, y), vec3(LARGEST)); }
    let exposed = e * jobs[j].mean.w;
    textureStore(destination, jobs[j].to + vec2<i32>(vec2(x, y)), vec4($STORED, 1.0));
}

@compute @workgroup_size(128)
fn decode(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) x: u32) {
    let j = group.x;
    let size = jobs[j].size;
    let has = jobs[j].has;
    let start = group.y * STRIP;
    if (start >= size.y) { return; }
    let end = min(start + STRIP, size.y);
    let weights = jobs[j].weights;
    let uvt = jobs[j].uvt;
    var top = 0u;
    var bottom = 0u;
    if ((has & HAS_MAPS) != 0u) {
        $LOAD
        for (var i = x; i < BIASES; i += 128u) { biases[i] = Vec(halves(weights + 8u * MATRICES + 2u * i)); }
        if ((has & HAS_UVT) != 0u) {
            top = u32(place(start, size.y, uvt.y));
            bottom = min(u32(place(end - 1u, size.y, uvt.y)) + 1u, uvt.y - 1u);
            // Where a place is an integer, rounding may put it into the row above, which then weighs next to nothing and is one too many.
            top = max(top, bottom + 1u - min(COARSE / uvt.x, bottom + 1u));
            let first = jobs[j].first;
            let second = jobs[j].second;
            for (var i = x; i < (bottom - top + 1u) * uvt.x; i += 128u) {
                let at = vec2(i % uvt.x, top + i / uvt.x);
                let a = textureLoad(maps, first.xy + at, first.z, 0);
                let b = textureLoad(maps, second.xy + at, second.z, 0);
                coarse[i] = mix(a, b, jobs[j].share_of_slice);
            }
        }
        if (x < end - start) {
            of_vt[x] = vec2(0.5);  // what counts as nothing
            if ((has & HAS_VT) != 0u) {
                of_vt[x] = plane(jobs[j].vt, start + x, size.y, jobs[j].sides.y, jobs[j].share_of_row);
            }
        }
        workgroupBarrier();
    }
    if (x >= size.x) { return; }
    var ut = vec2(0.5);
    if ((has & HAS_UT) != 0u) { ut = plane(jobs[j].ut, x, size.x, jobs[j].sides.x, jobs[j].share_of_row); }
    let along = place(x, size.x, max(uvt.x, 1u));
    for (var row = start; row < end; row += TEXELS) {
        var e = array<vec3<f32>, TEXELS>();
        if ((has & HAS_MAPS) != 0u) {
            // The three layers, for TEXELS texels from `row` on. shader.rs writes them (`Shader::network`); they fill `e`.
            $NETWORK
        }
        for (var t = 0u; t < min(TEXELS, end - row); t++) { put(j, x, row + t, e[t]); }
    }
}
