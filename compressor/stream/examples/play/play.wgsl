// Three passes over the same triangles: the view with the stream, its feedback, and the view with fully decoded pages.

struct View {
    clip: mat4x4<f32>,
    pages: u32,       // of one copy
    frame: u32,
    scale: f32,       // of derivatives: 1, or 1/8 in the feedback pass
    unused: u32,
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> copies: array<vec4<f32>>;

struct Corner {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) albedo: vec3<f32>,
    @location(2) @interpolate(flat) page: u32,
    @location(3) @interpolate(flat) own: u32,   // the page of the one scene that all are copies of
}

@vertex
fn corner(@builtin(instance_index) copy: u32, @location(0) position: vec3<f32>, @location(1) page: f32,
    @location(2) uv: vec2<f32>, @location(3) albedo: vec3<f32>) -> Corner {
    let own = u32(page);
    let at = view.clip * vec4(position + copies[copy].xyz, 1.0);
    return Corner(at, uv, albedo, own + copy * view.pages, own);
}


@fragment
fn streamed(in: Corner) -> @location(0) vec4<f32> {
    let ddx = dpdx(in.uv);
    let ddy = dpdy(in.uv);
    return vec4(in.albedo * ndgi_light(in.page, in.uv, ddx, ddy), 1.0);
}

fn noise(at: vec2<f32>) -> f32 {
    let p = vec3<u32>(vec2<u32>(at), view.frame);
    var h = p.x * 0x9E3779B1u ^ p.y * 0x85EBCA77u ^ p.z * 0xC2B2AE3Du;
    h = (h ^ (h >> 15u)) * 0x2C1B3C6Du;
    h = (h ^ (h >> 12u)) * 0x297A2D39u;
    return f32((h ^ (h >> 15u)) >> 8u) / 16777216.0;
}

@fragment
fn feedback(in: Corner) -> @location(0) u32 {
    let ddx = dpdx(in.uv) * view.scale;
    let ddy = dpdy(in.uv) * view.scale;
    return ndgi_feedback(in.page, in.uv, ddx, ddy, noise(in.clip.xy));
}

@group(2) @binding(0) var whole: texture_2d_array<f32>;

fn whole_at(page: u32, uv: vec2<f32>, level: u32) -> vec3<f32> {
    let size = (ndgi_pages[page].size + (1u << level) - 1u) >> vec2(level);
    let p = ndgi_position(page, uv, level) - 0.5;
    let corner = floor(p);
    let share = p - corner;
    let last = vec2<i32>(size) - 1;
    let a = clamp(vec2<i32>(corner), vec2(0), last);
    let b = clamp(vec2<i32>(corner) + 1, vec2(0), last);
    let upper = mix(textureLoad(whole, a, page, level), textureLoad(whole, vec2(b.x, a.y), page, level), share.x);
    let lower = mix(textureLoad(whole, vec2(a.x, b.y), page, level), textureLoad(whole, b, page, level), share.x);
    return mix(upper, lower, share.y).xyz;
}

@fragment
fn wholly(in: Corner) -> @location(0) vec4<f32> {
    let ddx = dpdx(in.uv);
    let ddy = dpdy(in.uv);
    let page = in.own;
    // The bias is the stream's, not the picture's.
    let level = ndgi_level_with(page, ddx, ddy, 0.0);
    let fine = u32(level);
    let share = level - f32(fine);
    var light = whole_at(page, in.uv, fine);
    if (share > 0.0) { light = mix(light, whole_at(page, in.uv, fine + 1u), share); }
    return vec4(in.albedo * light, 1.0);
}
