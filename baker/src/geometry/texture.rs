//! Textures: decoding, sharing by content, and sampling.

use super::{Texture, Wrap};
use dataset::{Error, Result};
use glam::{Vec2, Vec3};
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// Linear light of the 256 sRGB codes (IEC 61966-2-1).
static LINEAR_FROM_SRGB: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| linear_from_srgb(code as f64 / 255.0) as f32));

/// Linear light of an sRGB value in [0, 1].
pub(super) fn linear_from_srgb(c: f64) -> f64 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

impl Wrap {
    /// Texel index within `0..size` of any index.
    fn index(self, i: i64, size: u32) -> usize {
        let n = i64::from(size);
        let wrapped = match self {
            Wrap::Repeat => i.rem_euclid(n),
            Wrap::Clamp => i.clamp(0, n - 1),
            Wrap::Mirror => {
                let phase = i.rem_euclid(2 * n);
                phase.min(2 * n - 1 - phase)
            }
        };
        wrapped as usize
    }
}

/// What the alpha of a texture is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Alpha {
    /// 1 everywhere.
    Opaque,
    /// Nearly 0 or nearly 1 nearly everywhere.
    CutOut,
    /// Neither.
    Varied,
}

impl Texture {
    /// Bilinear value at finite `uv`: linear Rec. 709 and alpha, both in [0, 1].
    pub fn sample(&self, uv: Vec2) -> (Vec3, f32) {
        let table: &[f32; 256] = &LINEAR_FROM_SRGB;
        self.bilinear(uv, |texel| {
            let [r, g, b, a] = texel;
            let colour = Vec3::new(table[r as usize], table[g as usize], table[b as usize]);
            (colour, f32::from(a) / 255.0)
        })
    }

    /// Bilinear alpha at finite `uv`, in [0, 1]; the same as that of [`Texture::sample`].
    pub fn sample_alpha(&self, uv: Vec2) -> f32 {
        self.bilinear(uv, |[_, _, _, a]| (Vec3::ZERO, f32::from(a) / 255.0)).1
    }

    /// Bilinear red channel at finite `uv` as linear data, in [0, 1].
    pub fn sample_red(&self, uv: Vec2) -> f32 {
        self.bilinear(uv, |[r, _, _, _]| (Vec3::ZERO, f32::from(r) / 255.0)).1
    }

    /// What its alpha is like.
    pub(super) fn alpha(&self) -> Alpha {
        /// In a cut-out, no more than one texel in this many is in between: the edges.
        const ONE_IN: usize = 20;
        let half = self.rgba.iter().filter(|texel| (8..=247).contains(&texel[3])).count();
        match self.rgba.iter().all(|texel| texel[3] == 255) {
            true => Alpha::Opaque,
            false if half * ONE_IN < self.rgba.len() => Alpha::CutOut,
            false => Alpha::Varied,
        }
    }

    /// The greatest linear value of each channel over all texels that are not fully transparent.
    pub fn brightest(&self) -> Vec3 {
        let most = self
            .rgba
            .iter()
            .filter(|texel| texel[3] > 0)
            .fold([0u8; 3], |most, texel| [0, 1, 2].map(|channel| most[channel].max(texel[channel])));
        Vec3::from(most.map(|code| LINEAR_FROM_SRGB[code as usize]))
    }

    /// Feeds its texels and addressing into a hash.
    pub(super) fn update_digest(&self, hash: &mut blake3::Hasher) {
        let wrap = |w: Wrap| match w {
            Wrap::Repeat => 0u8,
            Wrap::Clamp => 1,
            Wrap::Mirror => 2,
        };
        hash.update(&self.width.to_le_bytes());
        hash.update(&self.height.to_le_bytes());
        hash.update(bytemuck::cast_slice(&self.rgba));
        hash.update(&[wrap(self.wrap_u), wrap(self.wrap_v)]);
    }

    fn bilinear(&self, uv: Vec2, decode: impl Fn([u8; 4]) -> (Vec3, f32)) -> (Vec3, f32) {
        // Texel centres stand at (i + ½) / size; f64, so that far tiles keep the place within a texel.
        let x = f64::from(uv.x) * f64::from(self.width) - 0.5;
        let y = f64::from(uv.y) * f64::from(self.height) - 0.5;
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = ((x - x0) as f32, (y - y0) as f32);
        let columns = [x0 as i64, (x0 as i64).saturating_add(1)].map(|i| self.wrap_u.index(i, self.width));
        let rows = [y0 as i64, (y0 as i64).saturating_add(1)].map(|i| self.wrap_v.index(i, self.height));
        let mut sum = (Vec3::ZERO, 0.0);
        for (row, wy) in rows.into_iter().zip([1.0 - fy, fy]) {
            for (column, wx) in columns.into_iter().zip([1.0 - fx, fx]) {
                let (colour, alpha) = decode(self.rgba[row * self.width as usize + column]);
                sum.0 += colour * (wx * wy);
                sum.1 += alpha * (wx * wy);
            }
        }
        sum
    }
}

/// All textures of a scene; equal files with equal addressing are held once.
#[derive(Default)]
pub(super) struct TextureStore {
    /// In the order first met.
    pub textures: Vec<Texture>,
    index: BTreeMap<([u8; 32], Wrap, Wrap), u32>,
    white: BTreeMap<u32, u32>,
    brightest: BTreeMap<u32, Vec3>,
    emission: Option<Box<TextureStore>>,
}

impl TextureStore {
    /// Decodes the bytes of a PNG, JPEG or (with the feature `webp`) WebP file, or finds the texture they
    /// gave before. `place` is for messages.
    pub(super) fn add(&mut self, bytes: &[u8], wrap_u: Wrap, wrap_v: Wrap, place: &str) -> Result<u32> {
        let key = (*blake3::hash(bytes).as_bytes(), wrap_u, wrap_v);
        if let Some(&index) = self.index.get(&key) {
            return Ok(index);
        }
        let format = match image::guess_format(bytes) {
            Ok(format @ (image::ImageFormat::Png | image::ImageFormat::Jpeg)) => format,
            #[cfg(feature = "webp")]
            Ok(format @ image::ImageFormat::WebP) => format,
            _ => return Err(Error::unsupported(place, "the texture is neither PNG nor JPEG: convert it")),
        };
        let decoded = image::load_from_memory_with_format(bytes, format)
            .map_err(|e| Error::invalid(place, format!("the texture cannot be decoded: {e}")))?
            .into_rgba8();
        let (width, height) = decoded.dimensions();
        if width == 0 || height == 0 {
            return Err(Error::invalid(place, "the texture has no texels"));
        }
        let rgba = decoded.pixels().map(|p| p.0).collect();
        let index = self.push(Texture { width, height, rgba, wrap_u, wrap_v });
        self.index.insert(key, index);
        Ok(index)
    }

    /// The store of emission maps, which are no part of what reflects light.
    pub(super) fn emission(&mut self) -> &mut TextureStore {
        self.emission.get_or_insert_default()
    }

    /// A texture with the alpha of another and white everywhere.
    pub(super) fn white(&mut self, of: u32) -> u32 {
        if let Some(&index) = self.white.get(&of) {
            return index;
        }
        let mut texture = self.textures[of as usize].clone();
        for texel in &mut texture.rgba {
            *texel = [255, 255, 255, texel[3]];
        }
        let index = self.push(texture);
        self.white.insert(of, index);
        index
    }

    /// The greatest value of each channel of a texture, [`Texture::brightest`].
    pub(super) fn brightest(&mut self, of: u32) -> Vec3 {
        *self.brightest.entry(of).or_insert_with(|| self.textures[of as usize].brightest())
    }

    fn push(&mut self, texture: Texture) -> u32 {
        self.textures.push(texture);
        self.textures.len() as u32 - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(wrap: Wrap) -> Texture {
        let grey = |v: u8| [v, v, v, v];
        Texture { width: 4, height: 1, rgba: [0, 10, 20, 30].map(grey).to_vec(), wrap_u: wrap, wrap_v: wrap }
    }

    #[test]
    fn wrap_modes_address_as_specified() {
        let at = |wrap: Wrap, i: i64| wrap.index(i, 4);
        for (i, repeat, clamp, mirror) in [
            (-5, 3, 0, 3),
            (-4, 0, 0, 3),
            (-1, 3, 0, 0),
            (0, 0, 0, 0),
            (3, 3, 3, 3),
            (4, 0, 3, 3),
            (8, 0, 3, 0),
            (9, 1, 3, 1),
        ] {
            assert_eq!(at(Wrap::Repeat, i), repeat, "repeat {i}");
            assert_eq!(at(Wrap::Clamp, i), clamp, "clamp {i}");
            assert_eq!(at(Wrap::Mirror, i), mirror, "mirror {i}");
        }
    }

    #[test]
    fn sampling_is_bilinear_between_texel_centres() {
        let alpha = |wrap, u| texture(wrap).sample(Vec2::new(u, 0.5)).1 * 255.0;
        for (wrap, u, expected) in [
            (Wrap::Clamp, 0.125, 0.0),
            (Wrap::Clamp, 0.25, 5.0),
            (Wrap::Clamp, 0.5, 15.0),
            (Wrap::Clamp, 1.0, 30.0),
            (Wrap::Clamp, 7.0, 30.0),
            (Wrap::Repeat, 0.0, 15.0),
            (Wrap::Repeat, 1000.25, 5.0),
            (Wrap::Repeat, -0.75, 5.0),
            (Wrap::Mirror, 1.25, 25.0),
            (Wrap::Mirror, -0.25, 5.0),
        ] {
            assert!((alpha(wrap, u) - expected).abs() < 1e-4, "{wrap:?} {u}: {}", alpha(wrap, u));
            assert_eq!(texture(wrap).sample_alpha(Vec2::new(u, 0.5)) * 255.0, alpha(wrap, u));
        }
    }

    #[test]
    fn colour_is_decoded_before_filtering() {
        let rgba = vec![[0, 0, 0, 255], [255, 188, 0, 255]];
        let texture = Texture { width: 2, height: 1, rgba, wrap_u: Wrap::Clamp, wrap_v: Wrap::Clamp };
        let (colour, _) = texture.sample(Vec2::new(0.5, 0.5));
        // sRGB 188 is linear 0.5028865.
        assert!((colour - Vec3::new(0.5, 0.251_443_2, 0.0)).length() < 1e-5, "{colour}");
    }
}
