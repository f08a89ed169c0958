//! The layout that a plan is told by. Of a large page it is one of coarser texels: to unwrap and fill a page
//! of 16384 × 16384 texels takes minutes, and what a plan tells of it follows from a smaller one to a few
//! percent.

use crate::Result;
use crate::atlas::{Atlas, LARGEST_SIDE};
use crate::bake::cache::solve;
use crate::bake::prepare::Prepared;
use crate::bake::store::Charts;
use crate::scene::{Lightmap, LightmapSize};
use crate::trace::counts::RayCounts;
use crate::trace::irradiance::CacheMap;

/// Longest side of a page in texels that is laid out as it will be.
const LONGEST: u32 = 2048;

/// A layout, and what it stands for.
#[derive(Debug)]
pub struct LayoutEstimate {
    /// The layout.
    pub atlas: Atlas,
    /// Texels of a bake along the side of one of the layout's: a power of two, 1 where it is the very layout
    /// of a bake.
    pub texel_scale: u32,
    /// Rays that it took.
    pub rays: RayCounts,
    /// Width and height of a page of a bake in texels.
    pub size: [u32; 2],
}

impl LayoutEstimate {
    /// The layout of a bake itself.
    pub fn exact(atlas: Atlas, rays: RayCounts) -> Self {
        LayoutEstimate { texel_scale: 1, rays, size: [atlas.width, atlas.page_height], atlas }
    }

    /// For a plan: pages whose sides are longer than `LONGEST` are laid out at a half, a quarter … of them.
    ///
    /// # Errors
    /// As [`Prepared::atlas_from`].
    pub fn of(prepared: &Prepared, charts: &Charts) -> Result<Self> {
        let lightmap = &prepared.scene.lightmap;
        let texel_scale = texel_scale(expected_side(prepared, lightmap));
        if texel_scale > 1 {
            let (atlas, rays) = prepared.atlas_of(&coarser(lightmap, texel_scale), charts)?;
            let size = match lightmap.size {
                LightmapSize::Fixed { width, height } => [width, height],
                LightmapSize::TexelsPerMetre(_) => {
                    [atlas.width, atlas.page_height].map(|side| side * texel_scale)
                }
            };
            if size.iter().all(|&side| side <= LARGEST_SIDE) {
                return Ok(LayoutEstimate { atlas, texel_scale, rays, size });
            }
        }
        // (What does not fit is refused as a bake would refuse it.)
        let (atlas, rays) = prepared.atlas_from(charts)?;
        Ok(LayoutEstimate::exact(atlas, rays))
    }

    /// Texels that surface touches.
    pub fn texels(&self) -> usize {
        self.atlas.texels() * (self.texel_scale * self.texel_scale) as usize
    }

    /// Texels of all pages together.
    pub fn page_texels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1]) * u64::from(self.atlas.pages)
    }

    /// Texels of the virtual page.
    pub fn virtual_texels(&self) -> u64 {
        u64::from(self.atlas.width) * u64::from(self.atlas.height) * u64::from(self.texel_scale).pow(2)
    }

    /// Texels per metre at density 1.
    pub fn texels_per_metre(&self) -> f64 {
        self.atlas.texels_per_metre * f64::from(self.texel_scale)
    }

    /// In words, that it is an estimate.
    pub fn in_words(&self) -> Option<String> {
        let texel_scale = self.texel_scale;
        (texel_scale > 1).then(|| {
            format!(
                "estimated from a layout with texels {texel_scale} times as wide; the bake gives the warnings of the real one"
            )
        })
    }
}

/// Entries of the cache of a bake with this layout.
pub(super) fn cache_entries(prepared: &Prepared, layout: &LayoutEstimate) -> usize {
    let shift = solve::shift(layout.texels(), prepared.plan.layers());
    let halvings = layout.texel_scale.ilog2();
    // A texel of the layout holds 4^`smaller` squares, if they are smaller than it.
    let (coarse, smaller) = (shift.saturating_sub(halvings), halvings.saturating_sub(shift));
    let most = solve::most_entries(prepared.plan.layers());
    let atlas = &layout.atlas;
    let map = CacheMap::new(atlas, &prepared.geometry, (coarse, most), atlas.touched());
    ((map.squares() << (2 * smaller)) + map.patches()).min(most.max(map.squares() << (2 * smaller)))
}

/// The longest side of a page, as far as it is known before anything is laid out.
fn expected_side(prepared: &Prepared, lightmap: &Lightmap) -> f64 {
    match lightmap.size {
        LightmapSize::Fixed { width, height } => f64::from(width.max(height)),
        LightmapSize::TexelsPerMetre(density) => {
            let geometry = &prepared.geometry;
            let lightmapped = geometry.instances.iter().filter(|instance| instance.lightmap);
            let area = |instance: &crate::geometry::Instance| -> f64 {
                let area: f64 = instance.triangles.clone().map(|triangle| geometry.area_f64(triangle)).sum();
                area * (instance.density * density).powi(2)
            };
            (lightmapped.map(area).sum::<f64>() / f64::from(lightmap.pages.max(1))).sqrt()
        }
    }
}

/// By what power of two a page's side is divided.
fn texel_scale(side: f64) -> u32 {
    let halvings = (side / f64::from(LONGEST)).log2().ceil().clamp(0.0, 5.0);
    1 << halvings as u32
}

/// The same lightmap with texels so many times as wide.
fn coarser(lightmap: &Lightmap, times: u32) -> Lightmap {
    let size = match lightmap.size {
        LightmapSize::Fixed { width, height } => {
            LightmapSize::Fixed { width: width.div_ceil(times), height: height.div_ceil(times) }
        }
        LightmapSize::TexelsPerMetre(density) => LightmapSize::TexelsPerMetre(density / f64::from(times)),
    };
    Lightmap { size, padding: lightmap.padding / times, ..*lightmap }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_are_halved_until_they_are_laid_out_soon() {
        assert_eq!(
            [0.5, 512.0, 2048.0, 2049.0, 4096.0, 16384.0, 1e9].map(texel_scale),
            [1, 1, 1, 2, 2, 8, 32]
        );
        let size = LightmapSize::Fixed { width: 16384, height: 5000 };
        let coarse = coarser(&Lightmap { size, padding: 16, ..Lightmap::default() }, 8);
        assert!(matches!(coarse.size, LightmapSize::Fixed { width: 2048, height: 625 }));
        assert_eq!(coarse.padding, 2);
    }
}
