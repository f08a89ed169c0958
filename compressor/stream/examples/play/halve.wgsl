// Makes a page's next level: the mean of the valid texels of four; of all that there are, where none is valid. Alpha: whether any is.

@group(0) @binding(0) var fine: texture_2d<f32>;
@group(0) @binding(1) var coarse: texture_storage_2d<rgba16float, write>;
@group(0) @binding(2) var mask: texture_2d<f32>;  // of the finest level alone
@group(0) @binding(3) var<uniform> sizes: vec4<u32>;  // fine, coarse

fn is_valid(at: vec2<u32>) -> f32 { return select(0.0, 1.0, textureLoad(mask, at, 0).x > 0.0); }

@compute @workgroup_size(8, 8)
fn begin(@builtin(global_invocation_id) id: vec3<u32>) {
    if (any(id.xy >= sizes.zw)) { return; }
    textureStore(coarse, id.xy, vec4(textureLoad(fine, id.xy, 0).xyz, is_valid(id.xy)));
}

@compute @workgroup_size(8, 8)
fn halve(@builtin(global_invocation_id) id: vec3<u32>) {
    if (any(id.xy >= sizes.zw)) { return; }
    var sum = vec4(0.0);
    var all = vec4(0.0);
    for (var i = 0u; i < 4u; i++) {
        let at = 2u * id.xy + vec2(i & 1u, i >> 1u);
        if (any(at >= sizes.xy)) { continue; }
        let texel = textureLoad(fine, at, 0);
        sum += vec4(texel.xyz, 1.0) * texel.w;
        all += vec4(texel.xyz, 1.0);
    }
    let mean = select(all.xyz / all.w, sum.xyz / max(sum.w, 1.0), sum.w > 0.0);
    textureStore(coarse, id.xy, vec4(mean, select(0.0, 1.0, sum.w > 0.0)));
}
