// Samples the light of a streamed scene. Put this text before your own shader, with the number of the bind group for @group(NDGI).
//
//   ndgi_light(page, uv, ddx, ddy)             irradiance × exposure, of maps and sun, trilinear
//   ndgi_feedback(page, uv, ddx, ddy, noise)   for a feedback target of R32Uint: the number of the needed tile, plus 1
//
// uv: page coordinates in [0, 1], v downwards. ddx, ddy: dpdx(uv) and dpdy(uv), taken outside of branches; in a feedback pass at an eighth
// of the view's resolution, divide them by 8. noise: a number in [0, 1) that differs by pixel and frame; it chooses between two levels.

struct NdgiPaging {
    bias: f32,
    levels: u32,
    pages: u32,
    across: u32,  // slots in a row of the textures
}

struct NdgiPage {
    first: u32,         // its first tile's number
    columns: u32,       // tiles across
    size: vec2<u32>,    // texels
}

@group(NDGI) @binding(0) var<uniform> ndgi_paging: NdgiPaging;
@group(NDGI) @binding(1) var<storage, read> ndgi_pages: array<NdgiPage>;    // by level and page
@group(NDGI) @binding(2) var<storage, read> ndgi_entries: array<u32>;       // by tile: 0 for its mean, else 1 + 16 · slot + level
@group(NDGI) @binding(3) var<storage, read> ndgi_means: array<u32>;         // by tile: mean × exposure as RGB9E5
@group(NDGI) @binding(4) var ndgi_maps: texture_2d<f32>;                    // slots of 128² texels
@group(NDGI) @binding(5) var ndgi_sun: texture_2d<f32>;

const NDGI_PAYLOAD: u32 = 126u;
const NDGI_SLOT: u32 = 128u;

// The level at which a texel is about as large as a pixel, plus a bias.
fn ndgi_level_with(page: u32, ddx: vec2<f32>, ddy: vec2<f32>, bias: f32) -> f32 {
    let size = vec2<f32>(ndgi_pages[page].size);
    let x = ddx * size;
    let y = ddy * size;
    let level = 0.5 * log2(max(max(dot(x, x), dot(y, y)), 1e-12)) + bias;
    return clamp(level, 0.0, f32(ndgi_paging.levels - 1u));
}

// The same with the stream's own bias.
fn ndgi_level(page: u32, ddx: vec2<f32>, ddy: vec2<f32>) -> f32 {
    return ndgi_level_with(page, ddx, ddy, ndgi_paging.bias);
}

// uv in texels of a level: a side of a texel of level m is 2^m texels of level 0.
fn ndgi_position(page: u32, uv: vec2<f32>, level: u32) -> vec2<f32> {
    let size = vec2<f32>(ndgi_pages[page].size);
    return clamp(uv, vec2(0.0), vec2(1.0)) * size * exp2(-f32(level));
}

// The tile in which a position is looked up: the one of the upper left of the four texels around it.
fn ndgi_tile_at(page: u32, level: u32, position: vec2<f32>) -> vec2<u32> {
    let grid = ndgi_pages[level * ndgi_paging.pages + page];
    let texel = min(vec2<u32>(max(floor(position - 0.5), vec2(0.0))), grid.size - 1u);
    return texel / NDGI_PAYLOAD;
}

fn ndgi_tile(page: u32, level: u32, tile: vec2<u32>) -> u32 {
    let grid = ndgi_pages[level * ndgi_paging.pages + page];
    return grid.first + tile.y * grid.columns + tile.x;
}

fn ndgi_mean(tile: u32) -> vec3<f32> {
    let word = ndgi_means[tile];
    let rgb = vec3<f32>(vec3(word, word >> 9u, word >> 18u) & vec3(511u));
    return rgb * exp2(f32(word >> 27u) - 24.0);
}

// Light at one level, bilinear. If the tile has no slot, from the nearest coarser level whose tile has one, or else the tile's mean.
fn ndgi_light_at(page: u32, uv: vec2<f32>, level: u32) -> vec3<f32> {
    let tile = ndgi_tile_at(page, level, ndgi_position(page, uv, level));
    let number = ndgi_tile(page, level, tile);
    let entry = ndgi_entries[number];
    if (entry == 0u) { return ndgi_mean(number); }
    let slot = (entry - 1u) >> 4u;
    let found = (entry - 1u) & 15u;
    let grid = ndgi_pages[found * ndgi_paging.pages + page];
    // The upper left of the four texels, in the slot's tile: from −1 (the border) to the last of its 126.
    let origin = vec2<f32>((tile >> vec2(found - level)) * NDGI_PAYLOAD);
    let p = ndgi_position(page, uv, found) - 0.5;
    let whole = min(floor(p), vec2<f32>(grid.size) - 1.0);
    let corner = clamp(whole - origin, vec2(-1.0), vec2(f32(NDGI_PAYLOAD) - 1.0));
    let share = clamp(p - (origin + corner), vec2(0.0), vec2(1.0));
    // The slot begins with a border of one texel.
    let at = vec2(slot % ndgi_paging.across, slot / ndgi_paging.across) * NDGI_SLOT + vec2<u32>(corner + 1.0);
    let a = textureLoad(ndgi_maps, at, 0) + textureLoad(ndgi_sun, at, 0);
    let b = textureLoad(ndgi_maps, at + vec2(1u, 0u), 0) + textureLoad(ndgi_sun, at + vec2(1u, 0u), 0);
    let c = textureLoad(ndgi_maps, at + vec2(0u, 1u), 0) + textureLoad(ndgi_sun, at + vec2(0u, 1u), 0);
    let d = textureLoad(ndgi_maps, at + vec2(1u, 1u), 0) + textureLoad(ndgi_sun, at + vec2(1u, 1u), 0);
    return mix(mix(a, b, share.x), mix(c, d, share.x), share.y).xyz;
}

fn ndgi_light(page: u32, uv: vec2<f32>, ddx: vec2<f32>, ddy: vec2<f32>) -> vec3<f32> {
    let level = ndgi_level(page, ddx, ddy);
    let fine = u32(level);
    let share = level - f32(fine);
    let light = ndgi_light_at(page, uv, fine);
    if (share == 0.0) { return light; }
    return mix(light, ndgi_light_at(page, uv, fine + 1u), share);
}

fn ndgi_feedback(page: u32, uv: vec2<f32>, ddx: vec2<f32>, ddy: vec2<f32>, noise: f32) -> u32 {
    let level = min(u32(ndgi_level(page, ddx, ddy) + noise), ndgi_paging.levels - 1u);
    return 1u + ndgi_tile(page, level, ndgi_tile_at(page, level, ndgi_position(page, uv, level)));
}
