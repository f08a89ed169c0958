//! Converts incoming lightmaps to a dataset.

use super::incoming::{Incoming, IncomingFrame, IncomingPage, Light};
use super::raw::block_rows;
use crate::format::{
    Baked, Config, Daylight, FORMAT, Frame, Layer, Light as Lights, Page, Part, Source, VERSION,
};
use crate::host::signals::stop_if_interrupted;
use crate::image::{Mask, write_exr};
use crate::observe::{Meter, Observer};
use crate::store::{Staged, Writer, about_equal, is_bad, refuse_light};
use crate::{Error, Result};
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Total rows of light that [`convert`] reads: the length of its progress.
pub(super) fn work(incoming: &Incoming) -> u64 {
    let images = |frame: &IncomingFrame| 1 + 2 * frame.shares.iter().flatten().count() as u64;
    incoming.pages.iter().map(|p| p.height as u64 * p.frames.iter().map(images).sum::<u64>()).sum()
}

/// Writes a dataset into an empty folder; gives its manifest.
pub(super) fn convert(
    incoming: &Incoming,
    root: &Path,
    scene: &str,
    console: &dyn Observer,
    progress: &dyn Meter,
) -> Result<Config> {
    let mut writer = Writer::create(root)?;
    let replaced = AtomicU64::new(0);
    let groups = &incoming.groups;
    let on = |hour: f64| groups.iter().map(|group| group.is_on(hour) == Some(true)).collect();
    let frame = |&hour: &f64| Frame { hour, groups_on: on(hour), relative_error: None, maps: Vec::new() };
    let mut frames: Vec<Frame> = incoming.hours.iter().map(frame).collect();
    let has_shares = incoming.pages.iter().flat_map(|page| &page.frames).any(|frame| frame.shares.is_some());
    let mut layers: Vec<Layer> = match has_shares {
        true => [Lights::Sun, Lights::Sky, Lights::Lamps].map(|light| share(light, frames.len())).into(),
        false => Vec::new(),
    };
    let mut pages = Vec::new();
    for (index, page) in incoming.pages.iter().enumerate() {
        let mask = page.mask()?;
        if !mask.valid.contains(&true) {
            console.warn(format!(
                "no texel of page {index} is valid; check that its mask is the right one and not inverted"
            ));
        }
        let png = writer.add(&format!("mask{index}"), "png", &mask.to_png())?;
        pages.push(Page::atlas(page.width as u32, page.height as u32, png));
        let stage = |frame: &IncomingFrame| {
            let job = Job { writer: &writer, page, mask: &mask, replaced: &replaced, progress };
            job.stage(frame)
        };
        let staged: Vec<Result<StagedFrame>> = page.frames.par_iter().map(stage).collect();
        for (number, (frame, staged)) in frames.iter_mut().zip(staged).enumerate() {
            let StagedFrame { whole, shares } = staged?;
            let hour = frame.hour;
            let mut adopt =
                |kind: &str, staged| writer.adopt(staged, &format!("{kind}{index}-{hour:.4}"), "exr");
            frame.maps.push(adopt("frame", whole)?);
            for (layer, staged) in layers.iter_mut().zip(shares) {
                let kind = layer.light.name();
                layer.files[number].push(staged.map(|staged| adopt(kind, staged)).transpose()?);
            }
        }
    }
    let layout = incoming.layout.to_owned();
    let reported = incoming.config.as_ref();
    let reported = reported.map(|bytes| writer.add("source", "json", bytes)).transpose()?;
    let config = Config {
        format: FORMAT.to_owned(),
        version: VERSION,
        scene: scene.to_owned(),
        generator: concat!("dataset import ", env!("CARGO_PKG_VERSION")).to_owned(),
        unit: incoming.unit.clone(),
        seed: 0,
        inputs: digest(&pages, &frames, &layers),
        samples: 0,
        pages,
        sun: has_shares.then_some(Daylight { baked: Baked::All }),
        sky: has_shares.then_some(Daylight { baked: Baked::All }),
        groups: groups.clone(),
        layers,
        frames,
        noise: None,
        geometry: None,
        instances: Vec::new(),
        settings: serde_json::json!({}),
        source: Some(Source { layout, config: reported, replaced_values: replaced.into_inner() }),
        sun_path: None,
        visibility: None,
        transfer: None,
    };
    writer.commit(&config)?;
    Ok(config)
}

/// The layer of a light, without files as yet.
fn share(light: Lights, frames: usize) -> Layer {
    Layer { light, group: None, part: Part::All, files: vec![Vec::new(); frames], curve: None }
}

/// Digest of all texels.
fn digest(pages: &[Page], frames: &[Frame], layers: &[Layer]) -> String {
    let mut hasher = blake3::Hasher::new();
    pages.iter().for_each(|page| _ = hasher.update(page.mask.blake3.to_string().as_bytes()));
    for (number, frame) in frames.iter().enumerate() {
        for (page, map) in frame.maps.iter().enumerate() {
            hasher.update(map.blake3.to_string().as_bytes());
            // Black shares and those not known are alike.
            for share in 0..3 {
                let file = layers.get(share).and_then(|layer: &Layer| layer.file(number, page));
                hasher.update(file.map_or("-".to_owned(), |file| file.blake3.to_string()).as_bytes());
            }
        }
    }
    hasher.finalize().to_hex().to_string()
}

/// The files of a lightmap at one hour; black shares are none.
struct StagedFrame {
    whole: Staged,
    shares: [Option<Staged>; 3],
}

/// A page at work.
struct Job<'a> {
    writer: &'a Writer,
    page: &'a IncomingPage,
    mask: &'a Mask,
    replaced: &'a AtomicU64,
    progress: &'a dyn Meter,
}

impl Job<'_> {
    fn stage(&self, frame: &IncomingFrame) -> Result<StagedFrame> {
        let mut shares = [None, None, None];
        if let Some(sources) = &frame.shares {
            self.expect_sum(&frame.whole, sources)?;
            for (share, source) in shares.iter_mut().zip(sources) {
                *share = Some(self.image(source)?).filter(|(_, black)| !black).map(|(staged, _)| staged);
            }
        }
        Ok(StagedFrame { whole: self.image(&frame.whole)?.0, shares })
    }

    /// Writes an image; also returns true if it is exactly black.
    fn image(&self, source: &Light) -> Result<(Staged, bool)> {
        let (width, height) = (self.page.width, self.page.height);
        let rows = block_rows(width);
        let (mut block, mut black) = (Vec::new(), true);
        let staged = self.writer.stage(|path, out| {
            write_exr(path, out, (width, height), |y, row| {
                if y.is_multiple_of(rows) {
                    stop_if_interrupted()?;
                    let y1 = (y + rows).min(height);
                    block = source.rows(y, y1)?;
                    self.clean(source, y, &mut block)?;
                    black &= block.iter().flatten().all(|value| value.to_bits() == 0);
                    self.progress.advance((y1 - y) as u64);
                }
                row.copy_from_slice(&block[y % rows * width..][..width]);
                Ok(())
            })
        })?;
        Ok((staged, black))
    }

    /// Bad values are an error on a surface and 0 elsewhere.
    fn clean(&self, source: &Light, y0: usize, block: &mut [[f32; 3]]) -> Result<()> {
        let width = self.page.width;
        let mut replaced = 0;
        for (i, texel) in block.iter_mut().enumerate() {
            if !texel.iter().any(|&value| is_bad(value)) {
                continue;
            }
            let y = y0 + i / width;
            if self.mask.valid[y0 * width + i] {
                // One row whose only bad texel is this one names the place.
                let mut row = vec![[0.0; 3]; width];
                row[i % width] = *texel;
                return refuse_light(source.path(y), width, y, &row);
            }
            for value in texel.iter_mut().filter(|value| is_bad(**value)) {
                *value = 0.0;
                replaced += 1;
            }
        }
        self.replaced.fetch_add(replaced, Ordering::Relaxed);
        Ok(())
    }

    /// An error unless light is the sum of its shares on every surface.
    fn expect_sum(&self, whole: &Light, shares: &[Light; 3]) -> Result<()> {
        let (width, height) = (self.page.width, self.page.height);
        let rows = block_rows(width);
        for y0 in (0..height).step_by(rows) {
            stop_if_interrupted()?;
            let y1 = (y0 + rows).min(height);
            let texels = whole.rows(y0, y1)?;
            let mut of: Vec<Vec<[f32; 3]>> = Vec::with_capacity(3);
            for share in shares {
                of.push(share.rows(y0, y1)?);
            }
            for (i, texel) in texels.iter().enumerate().filter(|(i, _)| self.mask.valid[y0 * width + i]) {
                let [sun, sky, local] = [0, 1, 2].map(|share| of[share][i]);
                let bad = |texel: &[f32; 3]| texel.iter().any(|&value| is_bad(value));
                // Values that are negative or not finite are reported when they are converted.
                if [texel, &sun, &sky, &local].into_iter().any(bad) {
                    continue;
                }
                let sum = std::array::from_fn(|c| (sun[c] + sky[c]) + local[c]);
                if !about_equal(texel, &sum) {
                    let (x, y) = (i % width, y0 + i / width);
                    let place = format!("{}, texel ({x}, {y})", whole.path(y).display());
                    let what = format!(
                        "{texel:?}; its shares sum to {sum:?}; expected equality within 1/1024 (remove the folders of shares \
                         to import only the lightmaps)"
                    );
                    return Err(Error::invalid(place, what));
                }
            }
            self.progress.advance((y1 - y0) as u64 * 3);
        }
        Ok(())
    }
}
