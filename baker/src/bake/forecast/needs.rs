//! What a bake would take, told before it is begun: texels, disk, memory. (How long depends on how far rays
//! go and on the machine, so an earlier bake must tell: [`crate::bake::output::prediction`].)

use super::disk_space::{DiskSpace, IMAGE};
use super::layout_estimate::{LayoutEstimate, cache_entries};
use super::views::{View, lit_tiles, views};
use crate::Result;
use crate::Rgb;
use crate::atlas::Atlas;
use crate::bake::cache::{cache_system, solve};
use crate::bake::errors::Sums;
use crate::bake::finish::{Dilation, LEAST_FILLED, TEXELS_OF_BAND};
use crate::bake::layers::denoise;
use crate::bake::prepare::{Integrator, Prepared};
use crate::bake::rounds::round;
use crate::bake::store::{CELLS, Filtered};
use crate::geometry::Bounds;
use crate::light::daylight::SkyTable;
use crate::scene::Sky;
use crate::surface::{BLOCK, BlockSurface, FaceBins};
use crate::trace::counts::RayCounts;
use crate::trace::irradiance::CacheHalf;
use crate::trace::paths::path::{Transport, point_pair};
use crate::trace::paths::{Sequence, SequenceKind};
use crate::trace::rays::RayTracer;
use crate::trace::solids::Space;
use crate::trace::sources::Lights;
use dataset::format::TILE;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use serde::Serialize;

/// What a bake would take.
#[derive(Clone, Debug, Serialize)]
pub struct Forecast {
    /// Width and height of a page in texels.
    pub size: [u32; 2],
    /// How many times as wide the texels of the layout were by which all this is estimated: 1 where it is
    /// that of a bake.
    pub texel_scale: u32,
    /// Pages.
    pub pages: u32,
    /// Texels that surface touches: those it covers, and a few that it only grazes.
    pub texels: usize,
    /// Triangles that get no texels because nobody can see them.
    pub skipped_triangles: usize,
    /// Their fraction of the lightmapped area.
    pub skipped_area: f64,
    /// Rays that it takes to find them.
    pub skipped_rays: u64,
    /// Texels per metre at density 1.
    pub texels_per_metre: f64,
    /// Length of the scene along x, y and z, in metres.
    pub extent: [f64; 3],
    /// Most bytes of the dataset's images.
    pub dataset_bytes: u64,
    /// Bytes of the layers kept beside the dataset, once all of them are traced.
    pub layers_bytes: u64,
    /// Bytes of the sums and of the cache on disk while all layers are traced.
    pub work_bytes: u64,
    /// About the most memory that is held at once, in bytes.
    pub memory_bytes: u64,
    /// The most bytes on disk at once: the work beside the layers, or the dataset beside those.
    pub peak_bytes: u64,
    /// What the scene's cameras see.
    pub views: Vec<View>,
    /// Tiles that hold surface.
    pub lit_tiles: usize,
    /// Of [`ESCAPE_RAYS`] rays from covered texels, those that leave the scene; `None` where there is neither
    /// sun nor sky.
    pub escaping_rays: Option<usize>,
}

/// Rays that are sent out to see whether a scene is open.
pub const ESCAPE_RAYS: usize = ESCAPE_BLOCKS * PER_BLOCK;
/// Blocks of texels they start from, and rays from each.
const ESCAPE_BLOCKS: usize = 256;
const PER_BLOCK: usize = 16;

/// Bytes of a block and its surroundings in one layer, while it is denoised; of its neighbours; and of its
/// light afterwards.
const DENOISED_LAYER: u64 = 2_700_000;
const DENOISED_NEIGHBOURS: u64 = 25_000_000;
const DENOISED_RESULT: u64 = (BLOCK * BLOCK * size_of::<Filtered>()) as u64;
/// Bytes of the program itself.
const PROGRAM: u64 = 10 << 20;
/// Bytes per triangle of geometry, hierarchy and charts that are held while light is traced, as measured at
/// ten million of them.
const TRIANGLE: u64 = 275;
/// Bytes per triangle while hierarchy and charts are made, as measured there too.
const TRIANGLE_MADE: u64 = 340;

/// Estimates for the layers of a plan, none of them traced yet.
pub fn forecast(prepared: &Prepared, layout: &LayoutEstimate) -> Result<Forecast> {
    let atlas = &layout.atlas;
    let plan = &prepared.plan;
    let bins = FaceBins::new(atlas);
    let blocks = bins.occupied();
    let texels = layout.texels();
    let layers = plan.layers() as u64;
    let all: Vec<usize> = (0..plan.layers()).collect();
    let disk = DiskSpace::of(prepared, layout, &all);
    let (n, triangles) = (texels as u64, prepared.geometry.triangles.len() as u64);
    // From here on: of covered texels their place, light and piece, of all the mask and owners, and how
    // gutters are filled.
    let all_texels = layout.virtual_texels();
    let known = 16 * n + 3 * all_texels + 8 * all_texels.saturating_sub(n);
    // While frames are put together, bands of four images: a part of a layer, with what it is filled from,
    // and the sums of a group, of all groups, and of all light.
    let padding = prepared.scene.lightmap.padding.max(LEAST_FILLED);
    let around = 2 * Dilation::reach(padding) as u64 * u64::from(layout.size[0]);
    let assembling = known
        + IMAGE * all_texels.min(TEXELS_OF_BAND as u64 + around)
        + 3 * IMAGE * all_texels.min(TEXELS_OF_BAND as u64);
    // While layers are denoised: where texels are; and for each thread, a block and its surroundings.
    let block = DENOISED_NEIGHBOURS
        + DENOISED_LAYER * layers.min(denoise::LAYERS_AT_ONCE as u64)
        + DENOISED_RESULT * layers.min(denoise::OPEN_FILES as u64);
    let in_space = (blocks.len().min(denoise::BLOCKS_AT_ONCE) * denoise::BLOCK_BYTES) as u64;
    let denoising = prepared
        .denoise
        .map_or(0, |_| known + 2 * n + in_space + block * rayon::current_num_threads() as u64);
    // While the sun's visibility is found: texels by place and tile, and a page of normals, twice.
    let page = u64::from(layout.size[0]) * u64::from(layout.size[1]);
    let seeing = prepared.visibility_times.as_ref().map_or(0, |_| 12 * n + 12 * page);
    let entries = match prepared.integrator {
        Integrator::Cached => cache_entries(prepared, layout),
        Integrator::Path => 0,
    };
    let paths = cache_system::paths_per_entry(entries, round::guaranteed_samples(&prepared.limits));
    let cache = solve::bytes(entries, plan.layers(), paths);
    // Beside the cache while paths are traced: per frame and cell its sums, the light and the floor.
    let of_cell = (size_of::<Sums>() + 2 * size_of::<f32>()) as u64;
    let cells_per_planned_cell = u64::from(layout.texel_scale).pow(2);
    let cells = of_cell * plan.times.len() as u64 * (blocks.len() * CELLS) as u64 * cells_per_planned_cell;
    let stored_cache = 2 * (entries * CacheHalf::bytes_per_entry(plan.layers())) as u64;
    // Towards a target layers are denoised between rounds, too: beside the cache.
    let is_judged = prepared.denoise.is_some() && prepared.limits.target_error.is_some();
    let beside = if is_judged { stored_cache } else { 0 };
    let ray_tracer = prepared.ray_tracer()?;
    let tile = TILE / layout.texel_scale as usize;
    let has_sky = !plan.suns.is_empty() || !plan.sky_hours.is_empty();
    Ok(Forecast {
        size: layout.size,
        texel_scale: layout.texel_scale,
        pages: atlas.pages,
        texels,
        skipped_triangles: atlas.skipped.triangles,
        skipped_area: atlas.skipped.area,
        skipped_rays: layout.rays.rays(),
        texels_per_metre: layout.texels_per_metre(),
        extent: extent(&prepared.geometry.positions),
        dataset_bytes: disk.dataset,
        layers_bytes: disk.traced + disk.filtered,
        work_bytes: disk.work,
        peak_bytes: disk.peak(),
        memory_bytes: memory(triangles, assembling.max(cache + cells).max(beside + denoising).max(seeing)),
        views: views(&prepared.scene.cameras, &prepared.geometry, atlas, tile, &ray_tracer),
        lit_tiles: lit_tiles(atlas, tile),
        escaping_rays: has_sky.then(|| escaping_rays(prepared, atlas, &ray_tracer, &bins, &blocks)),
    })
}

/// About the most memory in bytes that is held at once: while hierarchy and charts are made, or while light
/// is traced and put together, which takes `light` bytes.
fn memory(triangles: u64, light: u64) -> u64 {
    PROGRAM + (TRIANGLE_MADE * triangles).max(TRIANGLE * triangles + light)
}

/// How large the scene is and how fine its texels are, in words.
pub fn scale(extent: [f64; 3], texels_per_metre: f64) -> String {
    let [x, y, z] = extent.map(metres);
    format!("the scene is {x} × {y} × {z} m (y is up), {} texels per metre", density(texels_per_metre))
}

/// Texels per metre to one decimal, or to two digits where that would show few.
pub(crate) fn density(per_metre: f64) -> String {
    match per_metre {
        0.95.. => format!("{per_metre:.1}"),
        0.001.. => format!("{per_metre:.*}", (1.0 - per_metre.log10().floor()) as usize),
        _ => format!("{per_metre:.1e}"),
    }
}

/// Length of the box around positions.
pub(crate) fn extent(positions: &[Vec3]) -> [f64; 3] {
    Bounds::of(positions.iter().copied()).size().to_array()
}

/// How many of [`ESCAPE_RAYS`] rays from points spread over the pages leave the scene.
fn escaping_rays(
    prepared: &Prepared,
    atlas: &Atlas,
    ray_tracer: &RayTracer,
    bins: &FaceBins,
    blocks: &[usize],
) -> usize {
    let geometry = &prepared.geometry;
    // A white sky: what sees it, sees out.
    let white = Sky::Constant { radiance: DVec3::ONE };
    let lights = Lights { sky: SkyTable::new(Some(&white), None, &[12.0]), ..Lights::none() };
    let transport = Transport::new(Space::new(geometry, ray_tracer), &lights, Some(0));
    // A few blocks, evenly spread, and as many rays from each.
    let of_group = |group: usize| {
        let block = blocks[group * blocks.len() / ESCAPE_BLOCKS];
        let surface = BlockSurface::new(atlas, bins, block);
        let places: Vec<usize> = surface.covered().collect();
        let leaves = |ray: &usize| {
            let probe = group * PER_BLOCK + ray;
            let sample =
                Sequence::new(prepared.scene.bake.seed, SequenceKind::PlanRay, probe as u32, 0).sample(0);
            let Some(&texel) = places.get(ray * places.len() / PER_BLOCK) else { return false };
            let at = transport.space.receiver(&surface.sample(atlas, texel, point_pair(sample)));
            let mut out = [Rgb::ZERO];
            if let Some(at) = at {
                let mut counts = RayCounts::default();
                transport.indirect(&at, sample, |_, _, _| false, &mut out, None, &mut counts);
            }
            out[0] != Rgb::ZERO
        };
        (0..PER_BLOCK).filter(leaves).count()
    };
    if blocks.is_empty() { 0 } else { (0..ESCAPE_BLOCKS).into_par_iter().map(of_group).sum() }
}

/// A length to three digits or so.
fn metres(length: f64) -> String {
    match length {
        0.1..1e6 => format!("{:.*}", if length < 9.95 { 1 } else { 0 }, length),
        0.0 => "0".to_owned(),
        _ => format!("{length:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_that_of_the_greater_of_two_stages() {
        let triangles = 1_000_000;
        assert_eq!(memory(triangles, 0), PROGRAM + 340_000_000);
        assert_eq!(memory(triangles, 1 << 30), PROGRAM + 275_000_000 + (1 << 30));
    }

    #[test]
    fn small_densities_have_two_digits() {
        let shown = [1234.56, 44.71, 0.96, 0.123, 0.0456, 2e-7].map(density);
        assert_eq!(shown, ["1234.6", "44.7", "1.0", "0.12", "0.046", "2.0e-7"]);
    }
}
