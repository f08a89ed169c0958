//! What the scene file overrides, and materials as they end up.

use super::glass::most_kept;
use super::model::FileMaterial;
use super::names::Names;
use super::texture::TextureStore;
use super::{Emission, Glass, Material};
use crate::scene::{Object, SurfaceOverrides};
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;

/// What holds for a mesh with these names: the object's overrides, then those of its parts in order. Sets
/// `matched` of the parts that fit.
pub(super) fn resolve(object: &Object, names: &Names, matched: &mut [bool]) -> SurfaceOverrides {
    let mut overrides = object.overrides.clone();
    for (part, matched) in object.parts.iter().zip(matched) {
        if names.fit(&part.pattern) {
            *matched = true;
            let over = part.overrides.clone();
            overrides = SurfaceOverrides {
                albedo: over.albedo.or(overrides.albedo),
                lightmap: over.lightmap.or(overrides.lightmap),
                transmission: over.transmission.or(overrides.transmission),
                movable: over.movable.or(overrides.movable),
                density: over.density.or(overrides.density),
                two_sided: over.two_sided.or(overrides.two_sided),
                // The two come together.
                emission: over.emission.or(overrides.emission),
                group: over.group.or(overrides.group),
            };
        }
    }
    overrides
}

/// Materials of the scene; equal ones are held once.
#[derive(Default)]
pub(super) struct MaterialStore {
    /// In the order first met.
    pub materials: Vec<Material>,
    /// Per material, what it lets through.
    glass: Vec<Option<Glass>>,
    index: BTreeMap<([u32; 15], [u32; 10]), u32>,
}

impl MaterialStore {
    /// What the materials let through; empty where all are opaque.
    pub(super) fn take_glass(&mut self) -> Vec<Option<Glass>> {
        let glass = std::mem::take(&mut self.glass);
        if glass.iter().any(Option::is_some) { glass } else { Vec::new() }
    }

    /// Whether a material lets all light through that it does not absorb, and so shows no lightmap.
    pub(super) fn reflects_nothing(&self, material: u32) -> bool {
        let (glass, material) = (&self.glass[material as usize], &self.materials[material as usize]);
        glass.as_ref().is_some_and(|glass| most_kept(glass, material.alpha) == 0.0)
    }

    /// The index of a file's material under overrides, and whether `albedo_max` limits what it reflects (it
    /// does not limit their own albedo). `tint` is the brightest of the vertex colours, where there are any;
    /// `emission` is what it emits under them.
    pub(super) fn add(
        &mut self,
        file: &FileMaterial,
        tint: Option<Vec3>,
        overrides: &SurfaceOverrides,
        emission: Option<Emission>,
        albedo_max: f32,
        textures: &mut TextureStore,
    ) -> (u32, bool) {
        let mut material = Material {
            albedo: file.albedo,
            albedo_max: 1.0,
            alpha: file.alpha,
            texture: file.texture,
            alpha_cutoff: file.alpha_cutoff,
            two_sided: overrides.two_sided.unwrap_or(file.two_sided),
            emission,
        };
        let mut glass = match overrides.transmission {
            None => file.glass,
            Some(transmission) if transmission == DVec3::ZERO => None,
            Some(transmission) => Some(Glass::clear(transmission.as_vec3())),
        };
        if let Some(albedo) = overrides.albedo {
            material.albedo = albedo.as_vec3();
            // Colour goes, the cut-out stays, and so does what alpha lets through.
            let has_alpha = file.alpha_cutoff.is_some() || glass.is_some_and(|glass| glass.is_blended);
            material.texture = if has_alpha { file.texture.map(|t| textures.white(t)) } else { None };
            if let Some(Glass { tint: Some(tint), .. }) = &mut glass {
                *tint = material.albedo;
            }
        }
        let textured = file.texture.map_or(Vec3::ONE, |t| textures.brightest(t));
        let kept = glass.map_or(1.0, |glass| most_kept(&glass, file.alpha));
        let brightest = file.albedo * textured * tint.unwrap_or(Vec3::ONE) * kept;
        let limited = overrides.albedo.is_none() && brightest.max_element() > albedo_max;
        match limited {
            true if file.texture.is_some() || tint.is_some() => material.albedo_max = albedo_max,
            true => material.albedo = file.albedo.min(Vec3::splat(albedo_max)),
            false => {}
        }
        let key = (key(&material), glass.map_or([0; 10], |glass| glass.key()));
        let index = *self.index.entry(key).or_insert(self.materials.len() as u32);
        if index as usize == self.materials.len() {
            self.materials.push(material);
            self.glass.push(glass);
        }
        (index, limited)
    }
}

/// Every bit of a material.
fn key(m: &Material) -> [u32; 15] {
    let option = |x: Option<u32>| x.map_or([0, 0], |x| [1, x]);
    let [has_texture, texture] = option(m.texture);
    let [has_cutoff, cutoff] = option(m.alpha_cutoff.map(f32::to_bits));
    let [r, g, b] = m.albedo.to_array().map(f32::to_bits);
    let (e, group, map) = m.emission.map_or(([0; 3], u32::MAX, u32::MAX), |e| {
        (e.radiance.to_array().map(f32::to_bits), e.group, e.map.unwrap_or(u32::MAX))
    });
    let [most, alpha] = [m.albedo_max, m.alpha].map(f32::to_bits);
    let sides = m.two_sided.into();
    [r, g, b, most, alpha, has_texture, texture, has_cutoff, cutoff, sides, e[0], e[1], e[2], group, map]
}
