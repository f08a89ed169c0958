//! glTF materials, as far as a diffuse surface goes: base colour, cut-out, sides.

use super::accessor::Buffers;
use super::container::read_uri;
use super::extensions;
use crate::geometry::Wrap;
use crate::geometry::model::{DEFAULT_ALBEDO, FileMaterial, check_albedo, reason};
use crate::geometry::notes::Notes;
use crate::geometry::texture::TextureStore;
use dataset::{Error, Result};
use glam::{Mat2, Vec2, Vec3};
use gltf::material::AlphaMode;
use gltf::texture::WrappingMode;
use std::path::Path;

/// Where a material's texture coordinates come from.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct UvSource {
    /// `TEXCOORD_n`.
    pub set: u32,
    /// `uv ↦ matrix · uv + offset`.
    pub matrix: Mat2,
    /// See `matrix`.
    pub offset: Vec2,
}

/// An asset while it is read.
pub(super) struct OpenAsset<'a> {
    pub file: &'a str,
    pub folder: &'a Path,
    pub document: &'a gltf::Document,
    /// The same as plain JSON.
    pub root: &'a serde_json::Value,
    pub buffers: &'a Buffers<'a>,
}

/// Reads a material. The one a primitive has that names none is grey.
pub(super) fn material(
    asset: &OpenAsset,
    material: &gltf::Material,
    textures: &mut TextureStore,
    notes: &mut Notes,
) -> Result<(FileMaterial, UvSource)> {
    let mut uv = UvSource { set: 0, matrix: Mat2::IDENTITY, offset: Vec2::ZERO };
    let name = material.name().unwrap_or("").to_owned();
    let Some(number) = material.index() else {
        let albedo = Vec3::splat(DEFAULT_ALBEDO);
        let plain = FileMaterial {
            name,
            albedo,
            alpha: 1.0,
            texture: None,
            alpha_cutoff: None,
            two_sided: false,
            glass: None,
            undefined: true,
            emission: None,
        };
        return Ok((plain, uv));
    };
    let shown = if name.is_empty() { number.to_string() } else { name.clone() };
    let place = format!("{}: material {shown}", asset.file);
    // Older exports keep the diffuse colour in an extension that goes before the metallic-roughness fallback.
    let (key, [r, g, b, alpha], info) = match material.pbr_specular_glossiness() {
        Some(base) => ("diffuseFactor", base.diffuse_factor(), base.diffuse_texture()),
        None => {
            let base = material.pbr_metallic_roughness();
            ("baseColorFactor", base.base_color_factor(), base.base_color_texture())
        }
    };
    let mut albedo = check_albedo([r, g, b], &place, key)?;
    if !(0.0..=1.0).contains(&alpha) {
        return Err(Error::invalid(place, format!("{key}: alpha = {alpha}: expected a number from 0 to 1")));
    }
    let texture = match info {
        None => None,
        Some(info) => {
            uv = uv_source(&info, &place)?;
            let read = texture(asset, &info.texture(), textures, &place);
            if let Err(error) = &read {
                // The file says itself that it is nothing without the texture.
                if extensions::is_in_a_required_format(asset.root, info.texture().index()) {
                    return Err(Error::unsupported(place, reason(error)));
                }
                albedo *= DEFAULT_ALBEDO;
                let what = "the texture cannot be read: grey stands in for it; add the file, or give the part an `albedo`";
                notes.add(asset.file, "material", format!("{shown} ({})", reason(error)), what);
            }
            read.ok()
        }
    };
    let alpha_cutoff = match material.alpha_mode() {
        AlphaMode::Opaque => None,
        AlphaMode::Mask => {
            let cutoff = material.alpha_cutoff().unwrap_or(0.5);
            if !cutoff.is_finite() {
                return Err(Error::invalid(
                    place,
                    format!("alphaCutoff = {cutoff}: expected a finite number"),
                ));
            }
            Some(cutoff)
        }
        // What that lets through is read after this (`glass`).
        AlphaMode::Blend => None,
    };
    let two_sided = material.double_sided();
    Ok((
        FileMaterial {
            name,
            albedo,
            alpha,
            texture,
            alpha_cutoff,
            two_sided,
            glass: None,
            undefined: false,
            emission: None,
        },
        uv,
    ))
}

/// The coordinates a texture reference uses (`KHR_texture_transform`: scale, then rotate, then offset).
pub(super) fn uv_source(info: &gltf::texture::Info, place: &str) -> Result<UvSource> {
    let Some(transform) = info.texture_transform() else {
        return Ok(UvSource { set: info.tex_coord(), matrix: Mat2::IDENTITY, offset: Vec2::ZERO });
    };
    // Counter-clockwise as seen with v down: u′ = cos u + sin v, v′ = −sin u + cos v.
    let (sin, cos) = transform.rotation().sin_cos();
    let rotation = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
    let matrix = rotation * Mat2::from_diagonal(Vec2::from(transform.scale()));
    let offset = Vec2::from(transform.offset());
    if !(matrix.is_finite() && offset.is_finite()) {
        return Err(Error::invalid(place, "KHR_texture_transform: expected finite numbers"));
    }
    Ok(UvSource { set: transform.tex_coord().unwrap_or(info.tex_coord()), matrix, offset })
}

/// Loads a texture's image.
pub(super) fn texture(
    asset: &OpenAsset,
    texture: &gltf::Texture,
    textures: &mut TextureStore,
    place: &str,
) -> Result<u32> {
    let wrap = |mode| match mode {
        WrappingMode::ClampToEdge => Wrap::Clamp,
        WrappingMode::MirroredRepeat => Wrap::Mirror,
        WrappingMode::Repeat => Wrap::Repeat,
    };
    let (wrap_u, wrap_v) = (wrap(texture.sampler().wrap_s()), wrap(texture.sampler().wrap_t()));
    let named = &asset.root["textures"][texture.index()]["extensions"];
    // A texture in another format may name one that stands in for it.
    #[cfg(feature = "webp")]
    let webp = named["EXT_texture_webp"]["source"].as_u64().and_then(|image| usize::try_from(image).ok());
    #[cfg(not(feature = "webp"))]
    let webp = None;
    let Some(number) = webp.or_else(|| texture.source().map(|image| image.index())) else {
        let what = match () {
            _ if named.get("KHR_texture_basisu").is_some() => {
                format!("it is in KTX2 alone: {}", extensions::without_ktx2(asset.file))
            }
            #[cfg(not(feature = "webp"))]
            _ if named.get("EXT_texture_webp").is_some() => {
                format!("it is in WebP alone: {}", extensions::with_png(asset.file))
            }
            _ => "expected a source".to_owned(),
        };
        return Err(Error::unsupported(place, what));
    };
    let place = format!("{place}: image {number}");
    // The crate's own accessor panics on an image with neither URI nor view.
    let image = asset.document.as_json().images.get(number);
    let image = image.ok_or_else(|| Error::invalid(&place, "there is no such image"))?;
    match (&image.buffer_view, &image.uri) {
        (Some(view), _) => {
            let outside = || Error::invalid(&place, "it ends outside its buffer");
            let view = asset.document.views().nth(view.value()).ok_or_else(outside)?;
            let bytes = asset.buffers.bytes(&view, 0, view.length()).ok_or_else(outside)?;
            textures.add(bytes, wrap_u, wrap_v, &place)
        }
        (None, Some(uri)) => {
            let bytes = read_uri(uri, asset.folder, &place)?;
            textures.add(&bytes, wrap_u, wrap_v, &place)
        }
        (None, None) => Err(Error::invalid(place, "expected a uri or a bufferView")),
    }
}
