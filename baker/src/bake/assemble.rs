//! From layers to a dataset: layers dilated and stitched, every frame the float sum of its layers.

use super::check::Chosen;
use super::errors::{Errors, Sums};
use super::json;
use super::layers::{FilteredLayer, Layers, Part, Texel};
use super::local_errors::{COUNTED_ERRORS, CellMap, LocalErrorSummary, Pieces};
use super::plan::Plan;
use super::post::Dilation;
use super::seams::{Jump, Seams};
use super::valid::ValidTexels;
use super::value::Value;
use crate::atlas::Atlas;
use crate::atlas::owners::Owners;
use crate::geometry::Geometry;
use crate::scene::Baked;
use crate::{Result, Rgb};
use dataset::config::{self, FileRef, Frame, Layer, Light, Noise, Page};
use dataset::image::{Image, Mask, exr_of};
use dataset::store::Writer;
use dataset::tiles::TILE;

/// Texels around valid ones that are filled at least: a whole block of those a chart owns.
const LEAST_FILLED: u32 = 4;

/// Texels of all layers of a time that are in memory at once.
const AT_ONCE: usize = 1 << 14;

/// Puts the layers of a plan together.
pub struct Assembler<'a> {
    plan: &'a Plan,
    atlas: &'a Atlas,
    layers: &'a Layers,
    /// Per layer of the plan, its digest.
    digests: &'a [String],
    /// Per layer, where it was filtered.
    filtered: Vec<Option<FilteredLayer>>,
    texels: Vec<Texel>,
    /// Per texel, the sum of all layers.
    light: Vec<f32>,
    cell_map: &'a CellMap,
    pieces: Pieces,
    /// Valid texels of the virtual page.
    mask: Mask,
    dilation: Dilation,
    seams: Seams,
    /// Covered texels that are not valid: too little of them is surface, the rest in solids or beyond a wall.
    buried_texels: usize,
    /// Covered texels that are not valid: no light reaches them.
    unlit_texels: usize,
}

/// The stored images of a bake.
#[derive(Debug)]
pub struct Stored {
    /// The pages with their masks.
    pub pages: Vec<Page>,
    /// The layers of sun and sky, as far as they are baked.
    pub daylight: Vec<Layer>,
    /// Per group of the scene, the parts of its light that are baked, each with an image per page; black is
    /// `None`.
    pub groups: Vec<Vec<Share>>,
    /// Groups that were traced and whose light reaches no texel.
    pub dark_groups: Vec<usize>,
    /// The frames, in the order of the plan's times.
    pub frames: Vec<Frame>,
    /// The noise table's file.
    pub noise: FileRef,
    /// Error and light per tile and frame.
    pub errors: Errors,
    /// Local errors of all frames together, and of each; `None` without light.
    pub local: (Option<LocalErrorSummary>, Vec<Option<LocalErrorSummary>>),
    /// Where they are greatest, at the frame whose 95th percentile is.
    pub worst: Option<WorstFrame>,
    /// Valid texels.
    pub valid_texels: usize,
    /// Texels taken out because they lie inside solids.
    pub buried_texels: usize,
    /// Texels taken out because no light reaches them in any layer.
    pub unlit_texels: usize,
    /// Number of seam edges, and the jump across them before and after stitching, in the frame with most
    /// light.
    pub seams: Option<(usize, Jump, Jump)>,
}

/// The frame with the greatest local errors.
#[derive(Clone, Debug)]
pub struct WorstFrame {
    /// Which.
    pub frame: usize,
    /// Per cell its local error, row by row.
    pub errors: Vec<f64>,
    /// Of its layers, each with its share of the squared error in the cells with more than the first of
    /// [`COUNTED_ERRORS`]; the greatest first.
    pub causes: Vec<(usize, f64)>,
}

/// Which part of each light of a scene lightmaps hold.
pub struct BakedParts {
    /// Of the sun; nothing where there is none.
    pub sun: Baked,
    /// Of the sky, likewise.
    pub sky: Baked,
    /// Per group of the scene.
    pub groups: Vec<Baked>,
}

/// A part of a light as stored: its images, one per page.
pub type Share = (config::Part, Vec<Option<FileRef>>);

/// The parts of a light that lightmaps hold, with their names in the dataset.
fn parts_in_dataset(baked: Baked, is_sky: bool) -> &'static [(Part, config::Part)] {
    match baked {
        Baked::None => &[],
        Baked::Indirect => &[(Part::Rest, config::Part::Indirect)],
        Baked::All if is_sky => &[(Part::Rest, config::Part::All)],
        Baked::All => &[(Part::Direct, config::Part::Direct), (Part::Rest, config::Part::Indirect)],
    }
}

impl<'a> Assembler<'a> {
    /// Finds the valid texels, and what follows from them.
    pub fn new(
        plan: &'a Plan,
        geometry: &Geometry,
        atlas: &'a Atlas,
        (layers, digests): (&'a Layers, &'a [String]),
        texels: Vec<Texel>,
        cell_map: &'a CellMap,
        padding: u32,
    ) -> Result<Self> {
        let owners = Owners::new(atlas);
        let parts = digests.iter().enumerate().map(|(layer, digest)| (digest, plan.parts_of(layer)));
        let valid = ValidTexels::find(atlas, &owners, &texels, layers, parts)?;
        let ValidTexels { mask, light, buried, unlit } = valid;
        let dilation = Dilation::new(&mask, &owners, padding.max(LEAST_FILLED));
        let seams = Seams::new(geometry, atlas, &mask);
        let pieces = Pieces::of_texels(cell_map, mask.width, texels.iter().map(|texel| texel.index as usize));
        Ok(Assembler {
            plan,
            atlas,
            layers,
            digests,
            filtered: vec![None; digests.len()],
            texels,
            light,
            cell_map,
            pieces,
            mask,
            dilation,
            seams,
            buried_texels: buried,
            unlit_texels: unlit,
        })
    }

    /// The covered texels of the page.
    pub fn texels(&self) -> &[Texel] {
        &self.texels
    }

    /// Whether a covered texel is valid.
    pub fn is_valid(&self, position: usize) -> bool {
        self.mask.valid[self.texels[position].index as usize]
    }

    /// With some layers as a filter left them.
    pub fn with_filtered(self, filtered: Vec<Option<FilteredLayer>>) -> Self {
        Assembler { filtered, ..self }
    }

    /// Goes through a part of a layer, as a filter left it where there is one.
    fn each(&self, layer: usize, part: Part, value: impl FnMut(usize, Value)) -> Result<()> {
        match (&self.filtered[layer], part) {
            (Some(filtered), Part::Rest) => self.layers.each_filtered(filtered, value),
            _ => self.layers.each(&self.digests[layer], part, value),
        }
    }

    /// What lightmaps hold of a layer at some of the covered texels.
    pub fn held_at(&self, layer: usize, positions: &[usize]) -> Result<Vec<Value>> {
        let mut sums = vec![Value::default(); positions.len()];
        for &part in self.plan.held_parts_of(layer) {
            let values = match (&self.filtered[layer], part) {
                (Some(filtered), Part::Rest) => self.layers.read_filtered_at(filtered, positions),
                _ => self.layers.read_at(&self.digests[layer], part, positions),
            };
            sums.iter_mut().zip(values?).for_each(|(sum, value)| *sum = sum.plus(value));
        }
        Ok(sums)
    }

    /// The valid texels, by their positions among the covered ones, which is where layers hold them, each
    /// with its index on the page and the sum of its light in all layers.
    pub fn valid_texels(&self) -> impl Iterator<Item = (Chosen, f32)> {
        let valid = self.texels.iter().enumerate().filter(|(_, texel)| self.mask.valid[texel.index as usize]);
        valid.map(|(position, texel)| (Chosen { position, index: texel.index }, self.light[position]))
    }

    /// A part of a layer as an image of the virtual page, dilated and, if asked, stitched.
    fn part(&self, layer: usize, part: Part, stitched: bool) -> Result<Image> {
        let mut image = self.black();
        let scale = self.plan.scale_of(layer);
        self.each(layer, part, |position, value| {
            if self.is_valid(position) {
                image.texels[self.texels[position].index as usize] = (value.mean * scale).to_array();
            }
        })?;
        self.dilation.apply(&mut image);
        if stitched {
            self.seams.stitch(&mut image);
        }
        Ok(image)
    }

    /// An image of the virtual page without light.
    fn black(&self) -> Image {
        Image::black(self.mask.width, self.mask.height)
    }

    /// What lightmaps hold of a layer: the sum of its parts, each dilated and stitched.
    fn held(&self, layer: usize) -> Result<Image> {
        let mut sum = self.black();
        for &part in self.plan.held_parts_of(layer) {
            add(&mut sum, &self.part(layer, part, true)?);
        }
        Ok(sum)
    }

    /// Stores the parts of a layer that lightmaps hold, `None` being a layer that is black; adds them to
    /// `sum`.
    fn store_parts(
        &self,
        writer: &mut Writer,
        layer: Option<usize>,
        parts: &[(Part, config::Part)],
        stem: impl Fn(config::Part) -> String,
        sum: &mut Image,
    ) -> Result<Vec<Share>> {
        let mut shares = Vec::new();
        for &(part, name) in parts {
            let files = match layer {
                None => vec![None; self.atlas.pages as usize],
                Some(layer) => {
                    let image = self.part(layer, part, true)?;
                    add(sum, &image);
                    self.add_lit(writer, &stem(name), &image)?
                }
            };
            shares.push((name, files));
        }
        Ok(shares)
    }

    /// Whether no part of a layer holds any light.
    fn is_dark(&self, layer: usize) -> Result<bool> {
        let mut is_dark = true;
        for &part in self.plan.parts_of(layer) {
            self.layers.each(&self.digests[layer], part, |_, value| is_dark &= value.mean == Rgb::ZERO)?;
        }
        Ok(is_dark)
    }

    /// The texels of a page, cut out of the virtual page.
    fn page<'i>(&self, image: &'i Image, page: u32) -> &'i [[f32; 3]] {
        let rows = self.atlas.page_rows(page);
        &image.texels[rows.start as usize * image.width..rows.end as usize * image.width]
    }

    /// Stores a page of an image.
    fn add_page(&self, writer: &mut Writer, stem: &str, image: &Image, page: u32) -> Result<FileRef> {
        let (width, texels) = (image.width, self.page(image, page));
        let exr = exr_of(width, texels.len() / width, |y, row| {
            row.copy_from_slice(&texels[y * width..(y + 1) * width]);
        });
        writer.add(&self.stem(stem, page), "exr", &exr)
    }

    /// Stores an image, one file per page.
    fn add(&self, writer: &mut Writer, stem: &str, image: &Image) -> Result<Vec<FileRef>> {
        (0..self.atlas.pages).map(|page| self.add_page(writer, stem, image, page)).collect()
    }

    /// Stores an image, one file per page; none where it is black.
    fn add_lit(&self, writer: &mut Writer, stem: &str, image: &Image) -> Result<Vec<Option<FileRef>>> {
        let is_lit = |page: &u32| self.page(image, *page).iter().any(|texel| *texel != [0.0; 3]);
        let mut add = |page| is_lit(&page).then(|| self.add_page(writer, stem, image, page)).transpose();
        (0..self.atlas.pages).map(&mut add).collect()
    }

    fn stem(&self, stem: &str, page: u32) -> String {
        if self.atlas.pages == 1 { stem.to_owned() } else { format!("{stem}-p{page}") }
    }

    /// Writes all images: masks, groups, and per time sun, sky and their sum with the lit groups. `baked`
    /// says which part of each light they hold.
    pub fn store(&self, writer: &mut Writer, baked: &BakedParts, mut each: impl FnMut()) -> Result<Stored> {
        let pages = self.store_masks(writer)?;
        let first_group = self.plan.suns.len() + self.plan.sky_hours.len();
        let mut is_dark = vec![false; self.plan.groups.len()];
        let mut of_groups = Vec::new();
        for (index, &of_group) in self.plan.index_of_group.iter().zip(&baked.groups) {
            // A group that was not traced gave no light at any time baked.
            let layer = index.map(|g| first_group + g);
            let parts = parts_in_dataset(of_group, false);
            let stem = |part: config::Part| format!("group{}-{}", index.unwrap_or_default(), part.name());
            let mut sum = self.black();
            let shares = self.store_parts(writer, layer, parts, stem, &mut sum)?;
            if let (Some(g), Some(layer)) = (*index, layer) {
                is_dark[g] = is_black(&sum) && self.is_dark(layer)?;
                each();
            }
            of_groups.push(shares);
        }
        let (sun_parts, sky_parts) = (parts_in_dataset(baked.sun, false), parts_in_dataset(baked.sky, true));
        let empty = |light: Light, parts: &[(Part, config::Part)]| -> Vec<Layer> {
            let layer = |&(_, part)| Layer { light, group: None, part, files: Vec::new(), curve: None };
            parts.iter().map(layer).collect()
        };
        let (mut suns, mut skies) = (empty(Light::Sun, sun_parts), empty(Light::Sky, sky_parts));
        let mut frames = Vec::new();
        let mut errors = Errors::new(self.mask.width, self.mask.height, self.plan.times.len());
        let (mut all_cells, mut of_frames, mut worst) = (Vec::new(), Vec::new(), None);
        // Local light stays the same over many times.
        let (mut local, mut local_of): (Option<Image>, Vec<usize>) = (None, Vec::new());
        for (i, time) in self.plan.times.iter().enumerate() {
            let cells = self.add_errors(i, &mut errors)?;
            let (of_cells, of_frame) = self.cell_map.judge(&cells);
            all_cells.extend(
                of_cells.iter().zip(&cells).map(|(error, sums)| (*error as f32, sums.values as u32 / 3)),
            );
            if of_frame.is_some_and(|local| worst.as_ref().is_none_or(|(most, _, _)| local.p95 > *most)) {
                worst = of_frame.map(|local| (local.p95, i, of_cells));
            }
            of_frames.push(of_frame);
            let hour = format!("{:07.4}", time.hour);
            let stem = |light: Light| {
                let hour = hour.clone();
                move |part: config::Part| match part {
                    config::Part::All => format!("{}-{hour}", light.name()),
                    part => format!("{}-{}-{hour}", light.name(), part.name()),
                }
            };
            let mut total = self.black();
            let sun =
                self.store_parts(writer, self.plan.sun_of[i], sun_parts, stem(Light::Sun), &mut total)?;
            let sky_layer = self.plan.sky_of[i].map(|s| self.plan.suns.len() + s);
            // (Lightmaps hold one part of a sky: added to the sun's light, it is as if it were summed by
            // itself first.)
            let sky = self.store_parts(writer, sky_layer, sky_parts, stem(Light::Sky), &mut total)?;
            for (layers, shares) in [(&mut suns, sun), (&mut skies, sky)] {
                layers.iter_mut().zip(shares).for_each(|(layer, (_, files))| layer.files.push(files));
            }
            // (sun + sky) + local, local summed from zero in the order of the groups.
            let on: Vec<usize> = self.plan.group_layers_of(i).collect();
            if on != local_of {
                local = None;
                for &group in &on {
                    let held = self.held(group)?;
                    match &mut local {
                        Some(local) => add(local, &held),
                        // (Light is never negative zero, so that nothing plus it is it.)
                        None => local = Some(held),
                    }
                }
                local_of = on;
            }
            local.iter().for_each(|local| add(&mut total, local));
            frames.push(Frame {
                hour: time.hour,
                groups_on: time.groups_on.clone(),
                relative_error: errors.relative_of_frame(i),
                maps: self.add(writer, &format!("frame-{hour}"), &total)?,
            });
            each();
        }
        let noise = Noise { tile: TILE as u32, mse: self.noise(&errors) };
        let noise = writer.add("noise", "json", &json::bytes(&noise, "noise table")?)?;
        let layers = self.plan.index_of_group.iter().enumerate();
        let dark = layers.filter(|(_, layer)| layer.is_some_and(|layer| is_dark[layer]));
        Ok(Stored {
            pages,
            daylight: suns.into_iter().chain(skies).collect(),
            groups: of_groups,
            dark_groups: dark.map(|(group, _)| group).collect(),
            frames,
            noise,
            valid_texels: self.mask.count(),
            buried_texels: self.buried_texels,
            unlit_texels: self.unlit_texels,
            seams: self.jumps(&errors)?,
            errors,
            local: (
                LocalErrorSummary::of(
                    all_cells.into_iter().map(|(error, n)| (f64::from(error), u64::from(n))),
                ),
                of_frames,
            ),
            worst: worst.map(|(_, frame, errors)| self.worst(frame, errors)).transpose()?,
        })
    }

    fn store_masks(&self, writer: &mut Writer) -> Result<Vec<Page>> {
        (0..self.atlas.pages)
            .map(|page| {
                let rows = self.atlas.page_rows(page);
                let (from, to) = (rows.start as usize * self.mask.width, rows.end as usize * self.mask.width);
                let valid = self.mask.valid[from..to].to_vec();
                let mask = Mask { width: self.mask.width, height: rows.len(), valid };
                let stem = if self.atlas.pages == 1 { "mask".to_owned() } else { format!("mask-p{page}") };
                let file = writer.add(&stem, "png", &mask.to_png())?;
                Ok(Page::atlas(self.atlas.width, self.atlas.page_height, file))
            })
            .collect()
    }

    /// Adds the errors of a time, tile by tile, from those of its layers; its sums cell by cell.
    fn add_errors(&self, time: usize, errors: &mut Errors) -> Result<Vec<Sums>> {
        let mut pieces = self.pieces.sums();
        self.each_sum(&self.plan.layers_of(time), |texel, value| {
            let index = self.texels[texel].index as usize;
            let mut sums = Sums::default();
            sums.add_texel(value);
            errors.add(time, index % self.mask.width, index / self.mask.width, &sums);
            self.pieces.add_texel(texel, value, &mut pieces);
        })?;
        let mut cells = vec![Sums::default(); self.cell_map.grid().cells()];
        self.pieces.add_to_cells(&pieces, &mut cells);
        Ok(cells)
    }

    /// Goes through the valid texels, with the sum of what lightmaps hold of some layers at each. Of all of
    /// these some texels at a time are in memory.
    fn each_sum(&self, layers: &[usize], mut each: impl FnMut(usize, &Value)) -> Result<()> {
        let mut parts = Vec::new();
        for &layer in layers {
            let scale = self.plan.scale_of(layer);
            for &part in self.plan.held_parts_of(layer) {
                let reader = match (&self.filtered[layer], part) {
                    (Some(filtered), Part::Rest) => self.layers.reader_of_filtered(filtered)?,
                    _ => self.layers.reader(&self.digests[layer], part)?,
                };
                parts.push((reader, scale));
            }
        }
        let mut sums = Vec::new();
        for first in (0..self.texels.len()).step_by(AT_ONCE) {
            let range = first..(first + AT_ONCE).min(self.texels.len());
            sums.clear();
            sums.resize(range.len(), Value::default());
            for (reader, scale) in &mut parts {
                reader.read(range.clone(), |i, value| sums[i] = sums[i].plus(value.times(*scale)))?;
            }
            let valid = range.zip(&sums).filter(|(texel, _)| self.is_valid(*texel));
            valid.for_each(|(texel, value)| each(texel, value));
        }
        Ok(())
    }

    /// What the errors of a frame come from.
    fn worst(&self, frame: usize, errors: Vec<f64>) -> Result<WorstFrame> {
        let mut causes = Vec::new();
        for layer in self.plan.layers_of(frame) {
            let mut missed = 0.0;
            self.each_sum(&[layer], |texel, value| {
                let index = self.texels[texel].index as usize;
                let cell = self.cell_map.grid().at(index % self.mask.width, index / self.mask.width);
                if errors[cell] > COUNTED_ERRORS[0] {
                    missed += value.variance() + value.squared_bias();
                }
            })?;
            causes.push((layer, f64::max(missed, 0.0)));
        }
        let all: f64 = causes.iter().map(|(_, squared)| squared).sum();
        causes.iter_mut().for_each(|(_, squared)| *squared /= all.max(f64::MIN_POSITIVE));
        causes.sort_by(|a, b| b.1.total_cmp(&a.1));
        Ok(WorstFrame { frame, errors, causes })
    }

    /// Mean squared errors `[frame][page][tile]`.
    fn noise(&self, errors: &Errors) -> Vec<Vec<Vec<f64>>> {
        let of_page = |tiles: &[Sums], page: u32| {
            let rows = self.atlas.page_rows(page);
            let (from, to) = (rows.start as usize / TILE, (rows.end as usize).div_ceil(TILE));
            tiles[from * errors.columns..to * errors.columns].iter().map(Sums::mse).collect()
        };
        let frame = |tiles: &Vec<Sums>| (0..self.atlas.pages).map(|p| of_page(tiles, p)).collect();
        errors.tiles.iter().map(frame).collect()
    }

    /// The jump across seams of the frame with most light, with its layers dilated only, and stitched.
    fn jumps(&self, errors: &Errors) -> Result<Option<(usize, Jump, Jump)>> {
        let light = |i: &usize| errors.frame(*i).mean();
        let brightest = (0..self.plan.times.len()).max_by(|a, b| light(a).total_cmp(&light(b)));
        let Some(time) = brightest.filter(|_| self.seams.edges() > 0) else { return Ok(None) };
        let mut images = [self.black(), self.black()];
        for layer in self.plan.layers_of(time) {
            for (stitched, image) in images.iter_mut().enumerate() {
                for &part in self.plan.held_parts_of(layer) {
                    add(image, &self.part(layer, part, stitched == 1)?);
                }
            }
        }
        let jump = |image: &Image| self.seams.jump(image);
        Ok(jump(&images[0]).zip(jump(&images[1])).map(|(before, after)| (self.seams.edges(), before, after)))
    }
}

/// Whether an image holds no light.
fn is_black(image: &Image) -> bool {
    image.texels.iter().all(|texel| *texel == [0.0; 3])
}

fn add(to: &mut Image, what: &Image) {
    for (t, w) in to.texels.iter_mut().zip(&what.texels) {
        (0..3).for_each(|c| t[c] += w[c]);
    }
}
