//! ASTC by Arm's encoder, from 12×12 to 8×8 texels a block.

use super::Effort;
use super::bc::{best, opaque};
use super::curve::{CURVES, Curve, scale};
use super::method::{Coded, ImageCodec, squared_error, timed};
use super::tiles::{Texels, Tile};
use crate::{Error, Result};
use ctt_astcenc::bindings::{
    astcenc_image, astcenc_type, astcenc_type_ASTCENC_TYPE_F16, astcenc_type_ASTCENC_TYPE_F32,
};
use ctt_astcenc::{Context, Flags, Preset, Profile, Swizzle, config_init};
use half::f16;
use std::cell::RefCell;

/// What an HDR texture has as its peak, in halves: far from the least normal half.
const HDR_PEAK: f32 = 16384.0;

/// A block size, square, with how the light is stood in for.
pub(super) struct Astc {
    pub side: u32,
    /// The format's HDR blocks; otherwise code values in [0, 1] of the best of [`CURVES`] for each image.
    pub hdr: bool,
    pub effort: Effort,
}

impl ImageCodec for Astc {
    fn code(&self, texels: &Texels, tile: &Tile) -> Result<Coded<Texels>> {
        let scale = scale(texels);
        let encode = |preset: Preset, curve: Curve| self.encode(texels, scale, tile, preset, curve);
        // Made beforehand: a decoder has its tables. Its preset does not matter.
        let decoder = RefCell::new(self.context(Preset::Fastest)?);
        let decode =
            |blocks: &[u8], curve: Curve| self.decode(&mut decoder.borrow_mut(), blocks, scale, tile, curve);
        let preset = match self.effort {
            Effort::Draft => Preset::Medium,
            Effort::Full => Preset::Thorough,
        };
        timed(
            || {
                // A failure here shows again below.
                let error = |curve: Curve| match encode(Preset::Fast, curve)
                    .and_then(|blocks| decode(&blocks, curve))
                {
                    Ok(decoded) => squared_error(&decoded, texels, tile),
                    Err(_) => f64::INFINITY,
                };
                let curve = if self.hdr { Curve::Power(1.0) } else { best(&CURVES, error) };
                let blocks = encode(preset, curve)?;
                let curves = if self.hdr { Vec::new() } else { vec![curve] };
                Ok(((blocks, curve), self.bits(tile), curves))
            },
            |(blocks, curve)| decode(blocks, *curve),
        )
    }
}

impl Astc {
    /// 128 bits a block. On a page blocks go on across tiles, so parts of a block are not counted as whole
    /// ones; with the image's scale and curve.
    fn bits(&self, tile: &Tile) -> f64 {
        128.0 / f64::from(self.side * self.side) * tile.texels() as f64 + 32.0 + 8.0
    }

    fn context(&self, preset: Preset) -> Result<Context> {
        let profile = if self.hdr { Profile::HdrRgbLdrA } else { Profile::Ldr };
        config_init(profile, self.side, self.side, 1, preset, Flags::empty())
            .and_then(|config| Context::new(&config))
            .map_err(failed)
    }

    fn encode(
        &self,
        texels: &Texels,
        scale: f32,
        tile: &Tile,
        preset: Preset,
        curve: Curve,
    ) -> Result<Vec<u8>> {
        let value = |v: f32| {
            if self.hdr { v / scale * HDR_PEAK } else { curve.encode(f64::from(v / scale)) as f32 }
        };
        let blocks = |side: usize| side.div_ceil(self.side as usize);
        let mut out = vec![0; 16 * blocks(tile.source.width) * blocks(tile.source.height)];
        let mut halves = opaque(texels, |v| f16::from_f32(value(v)), f16::ONE);
        let mut slice = halves.as_mut_ptr().cast();
        let mut image = image(tile, &mut slice, astcenc_type_ASTCENC_TYPE_F16);
        self.context(preset)?.compress(&mut image, Swizzle::RGB1, &mut out).map_err(failed)?;
        Ok(out)
    }

    fn decode(
        &self,
        decoder: &mut Context,
        blocks: &[u8],
        scale: f32,
        tile: &Tile,
        curve: Curve,
    ) -> Result<Texels> {
        let mut values = vec![[0.0f32; 4]; tile.texels()];
        let mut slice = values.as_mut_ptr().cast();
        let mut image = image(tile, &mut slice, astcenc_type_ASTCENC_TYPE_F32);
        decoder.decompress_reset().map_err(failed)?;
        decoder.decompress(blocks, &mut image, Swizzle::IDENTITY).map_err(failed)?;
        let light = |v: f32| {
            if self.hdr { v.max(0.0) / HDR_PEAK * scale } else { scale * curve.decode(f64::from(v)) as f32 }
        };
        Ok(values.into_iter().map(|[r, g, b, _]| [r, g, b].map(light)).collect())
    }
}

/// One slice of four channels, as astcenc is told of it.
fn image(tile: &Tile, slice: &mut *mut std::ffi::c_void, data_type: astcenc_type) -> astcenc_image {
    astcenc_image {
        dim_x: tile.source.width as u32,
        dim_y: tile.source.height as u32,
        dim_z: 1,
        data_type,
        data: slice,
    }
}

fn failed(error: ctt_astcenc::Error) -> Error {
    Error::invalid("astcenc", error.to_string())
}

#[cfg(test)]
mod tests {
    use super::super::testing::tile_of;
    use super::*;
    use dataset::pictures::metrics::psnr_db;

    #[test]
    fn gradients_come_back_in_their_place() {
        let texel = |i: usize| {
            let (x, y) = ((i % 24) as f32, (i / 24) as f32);
            [3.0 + x, 0.2 + 0.5 * y, 0.13 * (1.0 + x + y)]
        };
        let tile = tile_of(24, 12, vec![(0..288).map(texel).collect()]);
        for hdr in [false, true] {
            let psnr = |side: u32| {
                let astc = Astc { side, hdr, effort: Effort::Draft };
                let coded = astc.code(&tile.filled[0], &tile).unwrap();
                let area = f64::from(side * side);
                assert!((coded.bits - 40.0 - 288.0 * 128.0 / area).abs() < 1e-6);
                let error = squared_error(&coded.decoded, &tile.filled[0], &tile);
                psnr_db(f64::from(tile.peaks[0]), error / 864.0)
            };
            let (coarse, fine) = (psnr(12), psnr(4));
            assert!((25.0..60.0).contains(&coarse) && fine > coarse + 3.0, "{hdr} {coarse} {fine}");
        }
    }
}
