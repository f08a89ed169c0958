//! BC6H and BC7 by Intel's ISPC encoder, decoded by `bcdec_rs`.

use super::Effort;
use super::curve::{CURVES, Curve, scale};
use super::method::{Coded, ImageCodec, squared_error, timed};
use super::tiles::{Texels, Tile};
use crate::Result;
use half::f16;
use intel_tex_2::{RgbaSurface, bc6h, bc7};

/// Both formats: bits of a texel.
const BITS: f64 = 8.0;
/// Largest finite half, as bits: BC6H gives no more.
const LARGEST: f64 = 0x7bff as f64;
/// What a direct BC6H texture has as its peak: far from the least normal half, so that the dark keeps its
/// digits.
const DIRECT_PEAK: f32 = 16384.0;

/// BC7 of an 8-bit encoding: the curve of each image is the best of [`CURVES`], tried with a fast encoder.
pub(super) struct Bc7(pub Effort);

impl ImageCodec for Bc7 {
    fn code(&self, texels: &Texels, tile: &Tile) -> Result<Coded<Texels>> {
        let scale = scale(texels);
        let encode = |settings: &bc7::EncodeSettings, curve: Curve| {
            let byte = |v: f32| (255.0 * curve.encode(f64::from(v / scale))).round() as u8;
            bc7::compress_blocks(settings, &surface(tile, &opaque(texels, byte, 255), 4))
        };
        let decode = |blocks: &[u8], curve: Curve| {
            let light: Vec<f32> =
                (0..=255).map(|q| scale * curve.decode(f64::from(q) / 255.0) as f32).collect();
            decoded(blocks, tile, bc7_texels, |[r, g, b, _]| [r, g, b].map(|q| light[usize::from(q)]))
        };
        let thorough = match self.0 {
            Effort::Draft => bc7::opaque_basic_settings(),
            Effort::Full => bc7::opaque_slow_settings(),
        };
        timed(
            || {
                let error = |curve: Curve| {
                    let blocks = encode(&bc7::opaque_very_fast_settings(), curve);
                    squared_error(&decode(&blocks, curve), texels, tile)
                };
                let curve = best(&CURVES, error);
                Ok(((encode(&thorough, curve), curve), bits(tile), vec![curve]))
            },
            |(blocks, curve)| Ok(decode(blocks, *curve)),
        )
    }
}

/// BC7 of RGBM, the usual four-channel encoding of HDR light in 8 bits: a colour below 1 and a multiplier,
/// both as roots so that the dark keeps its steps.
pub(super) struct Bc7Rgbm(pub Effort);

impl ImageCodec for Bc7Rgbm {
    fn code(&self, texels: &Texels, tile: &Tile) -> Result<Coded<Texels>> {
        let scale = scale(texels);
        let settings = match self.0 {
            Effort::Draft => bc7::alpha_basic_settings(),
            Effort::Full => bc7::alpha_slow_settings(),
        };
        timed(
            || {
                let bytes: Vec<u8> =
                    texels.iter().flat_map(|texel| to_rgbm(texel.map(|v| v / scale))).collect();
                Ok((bc7::compress_blocks(&settings, &surface(tile, &bytes, 4)), bits(tile), Vec::new()))
            },
            |blocks| {
                let light = |rgbm| from_rgbm(rgbm).map(|v| v * scale);
                Ok(decoded(blocks, tile, bc7_texels, light))
            },
        )
    }
}

/// Light in [0, 1] as √c/m and m in bytes, m the root of the largest channel rounded up so that no colour
/// exceeds 1.
fn to_rgbm(texel: [f32; 3]) -> [u8; 4] {
    let peak = texel.into_iter().fold(0.0, f32::max).sqrt();
    let m = (255.0 * peak).ceil().clamp(1.0, 255.0);
    let [r, g, b] = texel.map(|v| (255.0 * v.sqrt() / (m / 255.0)).round().min(255.0) as u8);
    [r, g, b, m as u8]
}

fn from_rgbm([r, g, b, m]: [u8; 4]) -> [f32; 3] {
    [r, g, b].map(|v| (f32::from(v) / 255.0 * f32::from(m) / 255.0).powi(2))
}

/// How light stands in BC6H's halves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Halves {
    /// As it is but for its scale: what a game's texture holds.
    Direct,
    /// A code value of the best of [`CURVES`] as the half's bits. They go with the logarithm of the half, so
    /// the encoder sees code values; a decoder takes a logarithm.
    Curve,
}

/// BC6H of the light.
pub(super) struct Bc6h(pub Effort, pub Halves);

impl ImageCodec for Bc6h {
    fn code(&self, texels: &Texels, tile: &Tile) -> Result<Coded<Texels>> {
        let scale = scale(texels);
        let encode = |settings: &bc6h::EncodeSettings, curve: Option<Curve>| {
            let half = |v: f32| match curve {
                None => f16::from_f32(v / scale * DIRECT_PEAK),
                Some(curve) => f16::from_bits((LARGEST * curve.encode(f64::from(v / scale))).round() as u16),
            };
            let halves = opaque(texels, half, f16::ONE);
            bc6h::compress_blocks(settings, &surface(tile, bytemuck::cast_slice(&halves), 8))
        };
        let decode = |blocks: &[u8], curve: Option<Curve>| {
            let light = |v: f32| match curve {
                None => v / DIRECT_PEAK * scale,
                Some(curve) => {
                    let code = f64::from(f16::from_f32(v).to_bits()) / LARGEST;
                    scale * curve.decode(code) as f32
                }
            };
            decoded(blocks, tile, bc6h_texels, |rgb| rgb.map(light))
        };
        let thorough = match self.0 {
            Effort::Draft => bc6h::slow_settings(),
            Effort::Full => bc6h::very_slow_settings(),
        };
        timed(
            || {
                let error = |curve: Curve| {
                    let blocks = encode(&bc6h::fast_settings(), Some(curve));
                    squared_error(&decode(&blocks, Some(curve)), texels, tile)
                };
                let curve = (self.1 == Halves::Curve).then(|| best(&CURVES, error));
                Ok(((encode(&thorough, curve), curve), bits(tile), curve.into_iter().collect()))
            },
            |(blocks, curve)| Ok(decode(blocks, *curve)),
        )
    }
}

/// All of an image: its blocks, its scale, and which curve.
fn bits(tile: &Tile) -> f64 {
    BITS * tile.texels() as f64 + 32.0 + 8.0
}

fn surface<'a>(tile: &Tile, data: &'a [u8], bytes: u32) -> RgbaSurface<'a> {
    let (width, height) = (tile.source.width as u32, tile.source.height as u32);
    RgbaSurface { width, height, stride: width * bytes, data }
}

/// Texels with values of their channels and an alpha.
pub(super) fn opaque<T: Copy>(texels: &Texels, value: impl Fn(f32) -> T, alpha: T) -> Vec<T> {
    let texel = |texel: &[f32; 3]| {
        let [r, g, b] = texel.map(&value);
        [r, g, b, alpha]
    };
    texels.iter().flat_map(texel).collect()
}

/// The curve of least error.
pub(super) fn best(curves: &[Curve], error: impl Fn(Curve) -> f64) -> Curve {
    let errors = curves.iter().map(|&curve| (error(curve), curve));
    errors.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(Curve::Power(1.0), |(_, curve)| curve)
}

/// An image of blocks, each of which `decode` turns into 16 texels; `light` is theirs.
fn decoded<T>(
    blocks: &[u8],
    tile: &Tile,
    decode: impl Fn(&[u8]) -> [T; 16],
    light: impl Fn(T) -> [f32; 3],
) -> Texels {
    let width = tile.source.width;
    let mut out = vec![[0.0; 3]; tile.texels()];
    for (i, block) in blocks.chunks_exact(16).enumerate() {
        let (left, top) = (4 * (i % (width / 4)), 4 * (i / (width / 4)));
        for (j, texel) in decode(block).into_iter().enumerate() {
            out[(top + j / 4) * width + left + j % 4] = light(texel);
        }
    }
    out
}

fn bc7_texels(block: &[u8]) -> [[u8; 4]; 16] {
    let mut rgba = [[0; 4]; 16];
    bcdec_rs::bc7(block, rgba.as_flattened_mut(), 16);
    rgba
}

fn bc6h_texels(block: &[u8]) -> [[f32; 3]; 16] {
    let mut rgb = [[0.0; 3]; 16];
    bcdec_rs::bc6h_float(block, rgb.as_flattened_mut(), 12, false);
    rgb
}

#[cfg(test)]
mod tests {
    use super::super::testing::tile_of;
    use super::*;
    use dataset::pictures::metrics::psnr_db;

    /// Smooth light of one colour, in 12×8 texels.
    fn smooth() -> Tile {
        let texel = |i: usize| {
            let (x, y) = ((i % 12) as f32, (i / 12) as f32);
            // One colour: what a block can hold.
            [1.0, 0.5, 0.125].map(|c| c * (3.0 + x + 2.0 * y))
        };
        tile_of(12, 8, vec![(0..96).map(texel).collect()])
    }

    fn psnr(tile: &Tile, coded: &Coded<Texels>) -> f64 {
        let error = squared_error(&coded.decoded, &tile.filled[0], tile);
        psnr_db(f64::from(tile.peaks[0]), error / 288.0)
    }

    #[test]
    fn gradients_come_back_through_every_codec_in_their_place() {
        let tile = smooth();
        let codecs: [&dyn ImageCodec; 4] = [
            &Bc7Rgbm(Effort::Draft),
            &Bc7(Effort::Draft),
            &Bc6h(Effort::Draft, Halves::Direct),
            &Bc6h(Effort::Draft, Halves::Curve),
        ];
        for (codec, least) in codecs.into_iter().zip([30.0, 38.0, 38.0, 38.0]) {
            let coded = codec.code(&tile.filled[0], &tile).unwrap();
            let db = psnr(&tile, &coded);
            assert!((least..70.0).contains(&db), "{db}");
            assert_eq!(coded.bits, 8.0 * 96.0 + 40.0);
        }
    }

    #[test]
    fn a_constant_block_is_met_to_the_step_of_its_code() {
        let tile = tile_of(4, 4, vec![vec![[0.5, 0.25, 1.0]; 16]]);
        let direct = Bc6h(Effort::Draft, Halves::Direct).code(&tile.filled[0], &tile).unwrap();
        let bc7 = Bc7(Effort::Draft).code(&tile.filled[0], &tile).unwrap();
        for (found, wanted) in direct.decoded[7].into_iter().zip([0.5, 0.25, 1.0]) {
            assert!((found - wanted).abs() < 0.005 * wanted, "{found}");
        }
        for (found, wanted) in bc7.decoded[7].into_iter().zip([0.5, 0.25, 1.0]) {
            assert!((found - wanted).abs() < 1.5 / 255.0, "{found}");
        }
    }
}
