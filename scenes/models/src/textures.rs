//! Textures from texel functions, in 8-bit sRGB.

use crate::model::Texture;

/// A colour of sRGB components 0 … 255.
pub type Colour = [f64; 3];

/// A square texture from its texel function: (x, y) in (0, 1), y down, to a colour and whether it is solid.
pub fn texture(name: &'static str, size: u32, texel: impl Fn(f64, f64) -> (Colour, bool)) -> Texture {
    let mut rgba = Vec::with_capacity((size * size) as usize);
    for y in 0..size {
        for x in 0..size {
            let at = |i: u32| (i as f64 + 0.5) / size as f64;
            let (colour, solid) = texel(at(x), at(y));
            let [r, g, b] = colour.map(|c| c.round().clamp(0.0, 255.0) as u8);
            rgba.push([r, g, b, if solid { 255 } else { 0 }]);
        }
    }
    Texture { name, size, rgba }
}
