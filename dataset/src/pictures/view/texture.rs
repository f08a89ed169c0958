//! Base colour textures.

use crate::pictures::tone;
use glam::{Vec2, Vec3};
use gltf::Document;
use gltf::texture::WrappingMode;
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// Linear light of the 256 sRGB codes.
static LINEAR_FROM_SRGB: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| tone::linear(code as u8)));

/// An image with what is done outside it.
pub(super) struct Texture {
    rgba: image::RgbaImage,
    wrap: [WrappingMode; 2],
}

/// Index within `0..size` of any index.
fn wrapped(mode: WrappingMode, i: i64, size: i64) -> u32 {
    (match mode {
        WrappingMode::Repeat => i.rem_euclid(size),
        WrappingMode::ClampToEdge => i.clamp(0, size - 1),
        WrappingMode::MirroredRepeat => {
            let phase = i.rem_euclid(2 * size);
            phase.min(2 * size - 1 - phase)
        }
    }) as u32
}

impl Texture {
    /// Bilinear value: linear Rec. 709 and alpha, both in [0, 1].
    pub(super) fn sample(&self, uv: Vec2) -> (Vec3, f32) {
        let size = [self.rgba.width(), self.rgba.height()];
        // (What is not finite becomes 0 where it is made an index.)
        let axis = |at: f32, k: usize| {
            let at = f64::from(at) * f64::from(size[k]) - 0.5;
            let low = at.floor() as i64;
            let index = |i: i64| wrapped(self.wrap[k], i, size[k].into());
            ([index(low), index(low.saturating_add(1))], (at - at.floor()) as f32)
        };
        let ((columns, fx), (rows, fy)) = (axis(uv.x, 0), axis(uv.y, 1));
        let mut sum = (Vec3::ZERO, 0.0);
        for (row, wy) in rows.into_iter().zip([1.0 - fy, fy]) {
            for (column, wx) in columns.into_iter().zip([1.0 - fx, fx]) {
                let [r, g, b, a] = self.rgba.get_pixel(column, row).0;
                let [r, g, b] = [r, g, b].map(|code| LINEAR_FROM_SRGB[code as usize]);
                sum.0 += Vec3::new(r, g, b) * (wx * wy);
                sum.1 += f32::from(a) / 255.0 * (wx * wy);
            }
        }
        sum
    }
}

/// The textures of a file, each decoded once.
pub(super) struct Textures<'a> {
    document: &'a Document,
    binary: &'a [u8],
    pub list: Vec<Texture>,
    /// By image and what is done outside it.
    known: BTreeMap<(usize, [u32; 2]), Option<usize>>,
}

impl<'a> Textures<'a> {
    pub(super) fn new(document: &'a Document, binary: &'a [u8]) -> Self {
        Textures { document, binary, list: Vec::new(), known: BTreeMap::new() }
    }

    /// Decodes a texture, or finds it; `None` for one that lies elsewhere or in a format that is not read.
    pub(super) fn add(&mut self, texture: &gltf::Texture) -> Option<usize> {
        let image = texture.source()?.index();
        let wrap = [texture.sampler().wrap_s(), texture.sampler().wrap_t()];
        let key = (image, wrap.map(|mode| mode.as_gl_enum()));
        if let Some(known) = self.known.get(&key) {
            return *known;
        }
        let rgba = self.decode(image);
        let index = rgba.map(|rgba| {
            self.list.push(Texture { rgba, wrap });
            self.list.len() - 1
        });
        self.known.insert(key, index);
        index
    }

    fn decode(&self, image: usize) -> Option<image::RgbaImage> {
        // (The crate's own accessor panics on an image with neither address nor view.)
        let view = self.document.as_json().images.get(image)?.buffer_view?;
        let view = self.document.views().nth(view.value())?;
        let bytes = self.binary.get(view.offset()..view.offset() + view.length())?;
        let rgba = image::load_from_memory(bytes).ok()?.into_rgba8();
        (rgba.width() > 0 && rgba.height() > 0).then_some(rgba)
    }
}
