//! The disk that a bake takes at its peak, compared with what is free where it writes: told before light is
//! traced, not after hours of it.

use super::layout_estimate::{LayoutEstimate, cache_entries};
use crate::bake::layers::{CHECKSUM, Layers, denoise};
use crate::bake::prepare::{Integrator, Options, Prepared};
use crate::bake::store::WorkFolder;
use crate::scene::Baked;
use crate::trace::irradiance::CacheHalf;
use crate::{Error, Result, Rgb};
use dataset::store;
use std::path::Path;

/// Bytes of a texel of an image.
pub(super) const IMAGE: u64 = 12;

/// Bytes of a texel of a block for each sum of a layer, and for the direct light of each sun or group. In
/// memory they take 24, and 40 and at first 60; packed they came to 0.44 to 0.57 of that on the scenes
/// measured, and these are bounds for light that is all noise.
const SUMS: u64 = 20;
const DIRECT: u64 = 30;

/// Bytes that a bake writes, by where they lie. The work goes once its layers are kept; layers and dataset
/// stay.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DiskSpace {
    /// Most bytes of the dataset's images.
    pub dataset: u64,
    /// The layers kept beside it, as traced.
    pub traced: u64,
    /// What filters make of them.
    pub filtered: u64,
    /// Where texels lie in space, while layers are denoised.
    pub in_space: u64,
    /// Sums and cache while light is traced.
    pub work: u64,
    /// What `--force` removes before anything is written.
    pub removed: u64,
}

impl DiskSpace {
    /// For tracing these layers (ascending), and for the whole dataset.
    pub fn of(prepared: &Prepared, layout: &LayoutEstimate, layers: &[usize]) -> Self {
        let plan = &prepared.plan;
        let n = layout.texels() as u64;
        let count = layers.len() as u64;
        // The parts in which layers are kept, and the lights that paths can meet, which have a sum of their
        // own.
        let parts = layers.iter().map(|&layer| plan.parts_of(layer).len() as u64).sum::<u64>();
        let (suns, skies) = (plan.suns.len(), plan.sky_hours.len());
        let is_sky = |layer: &&usize| (suns..suns + skies).contains(layer);
        let shines = |layer: &&usize| {
            plan.group_of_layer(**layer).is_some_and(|g| g.emission.iter().any(|e| *e != Rgb::ZERO))
        };
        let skies = layers.iter().filter(is_sky).count() as u64;
        let sky_apart = if prepared.scene.sky_baked == Baked::Indirect { skies } else { 0 };
        let hit_lights = layers.iter().filter(shines).count() as u64 + sky_apart;
        let denoised = if prepared.denoise.is_some() { count } else { 0 };
        let traced = n * (8 + 20 * parts) + CHECKSUM as u64 * (parts + 1);
        let filtered = (n * 24 + CHECKSUM as u64) * denoised;
        let entries = match prepared.integrator {
            Integrator::Cached if count > 0 => cache_entries(prepared, layout),
            _ => 0,
        };
        let cache = 2 * (entries * CacheHalf::bytes_per_entry(layers.len())) as u64;
        // Towards a target layers are put together and denoised between rounds, too: beside those that are
        // kept.
        let is_judged = prepared.denoise.is_some() && prepared.limits.target_error.is_some();
        let in_space = if denoised > 0 { n * denoise::TEXEL_BYTES } else { 0 };
        let provisional = if is_judged { traced + filtered + in_space } else { 0 };
        let blocks = n * (15 + SUMS * (count + hit_lights) + DIRECT * (count - skies));
        DiskSpace {
            dataset: IMAGE * layout.page_texels() * (plan.times.len() + plan.layers()) as u64,
            traced,
            filtered,
            in_space,
            work: if count == 0 { 0 } else { blocks + cache + provisional },
            removed: 0,
        }
    }

    /// What is still to be written to the folder `out`, at most: less what an earlier run of the same bake
    /// left there.
    pub fn still_needed(prepared: &Prepared, layout: &LayoutEstimate, out: &Path, options: &Options) -> Self {
        let layers = Layers::new(out);
        let is_missing = |&layer: &usize| options.force || !layers.holds(&prepared.digests[layer]);
        let missing: Vec<usize> = (0..prepared.digests.len()).filter(is_missing).collect();
        let all = DiskSpace::of(prepared, layout, &missing);
        let done = match options.force {
            true => 0,
            false => bytes_below(&WorkFolder::root_of(out, &prepared.work(&missing))),
        };
        let removed = match options.force {
            true => bytes_below(&out.join(store::WORK)) + bytes_below(layers.root()),
            false => 0,
        };
        DiskSpace { work: all.work.saturating_sub(done), removed, ..all }
    }

    /// The most of it at once: the work goes when its layers stand, and filters and dataset come after.
    pub fn peak(&self) -> u64 {
        self.traced + self.work.max(self.filtered + self.dataset.max(self.in_space))
    }

    /// Refuses a bake that needs more than the `free` bytes of the file system of its folder.
    ///
    /// # Errors
    /// [`Error::Unready`], like a disk that is full later.
    pub fn check_free_space(&self, out: &Path, free: Option<u64>) -> Result<()> {
        match free {
            Some(free) if self.peak() > free.saturating_add(self.removed) => {
                Err(Error::unready(out.display(), self.refusal(free)))
            }
            // (Some file systems do not tell.)
            _ => Ok(()),
        }
    }

    /// Why such a bake is refused, and what to do.
    fn refusal(&self, free: u64) -> String {
        format!(
            "this bake takes up to {} on disk at its peak (work {}, layers {}, dataset {}), and {} are free there; expected --out DIR on \
             another file system, fewer --hours, or a smaller [lightmap] size",
            in_words(self.peak()),
            in_words(self.work),
            in_words(self.traced + self.filtered),
            in_words(self.dataset),
            in_words(free)
        )
    }
}

/// Bytes of all files below a folder.
fn bytes_below(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let bytes = |entry: std::fs::DirEntry| match entry.metadata() {
        Ok(found) if found.is_dir() => bytes_below(&entry.path()),
        Ok(found) => found.len(),
        Err(_) => 0,
    };
    entries.map(bytes).sum()
}

/// Such as `1.3 GB`, to two digits.
pub fn in_words(bytes: u64) -> String {
    let (unit, name) = match bytes {
        0..1_000_000 => (1e3, "kB"),
        1_000_000..1_000_000_000 => (1e6, "MB"),
        1_000_000_000..1_000_000_000_000 => (1e9, "GB"),
        _ => (1e12, "TB"),
    };
    let value = bytes as f64 / unit;
    if value < 9.95 { format!("{value:.1} {name}") } else { format!("{value:.0} {name}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_is_that_of_the_greater_of_two_stages() {
        let disk =
            DiskSpace { dataset: 300, traced: 1000, filtered: 100, in_space: 200, work: 5000, removed: 0 };
        assert_eq!(disk.peak(), 6000);
        assert_eq!(DiskSpace { dataset: 30_000, ..disk }.peak(), 31_100);
        let at = |free| disk.check_free_space(Path::new("there"), free);
        assert!(at(Some(6000)).is_ok() && at(None).is_ok());
        assert!(DiskSpace { removed: 1, ..disk }.check_free_space(Path::new("there"), Some(5999)).is_ok());
        let refused = at(Some(5999)).unwrap_err().to_string();
        assert!(
            ["there", "6.0 kB", "work 5.0 kB", "--out", "--hours", "size"]
                .iter()
                .all(|what| refused.contains(what)),
            "{refused}"
        );
    }

    #[test]
    fn bytes_have_two_digits() {
        let words = [999, 1_300_000, 34_000_000_000, 4_200_000_000_000].map(in_words);
        assert_eq!(words, ["1.0 kB", "1.3 MB", "34 GB", "4.2 TB"]);
    }
}
