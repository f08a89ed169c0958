//! From layers to a dataset: layers dilated and stitched, every frame the float sum of its layers.

use super::check::Chosen;
use super::page_bands::{BandLight, LightSum, PageBands, PartLight, TEXELS_OF_BAND, add};
use super::seams::Jump;
use crate::atlas::Atlas;
use crate::atlas::owners::Owners;
use crate::bake::errors::{COUNTED_ERRORS, CellMap, Errors, LocalErrorSummary, Pieces, Sums};
use crate::bake::layers::{FilteredLayer, LayerReader, Layers, Texel, ValidTexels, each_sum};
use crate::bake::prepare::{Part, Plan};
use crate::bake::store::{Value, json};
use crate::geometry::Geometry;
use crate::scene::Baked;
use crate::{Result, Rgb};
use dataset::format::{FileRef, Frame, Layer, Light, Noise, Page, TILE, config};
use dataset::host::signals::stop_if_interrupted;
use dataset::image::Mask;
use dataset::store::Writer;
use std::rc::Rc;

/// Puts the layers of a plan together.
pub struct Assembler<'a> {
    plan: &'a Plan,
    atlas: &'a Atlas,
    layers: &'a Layers,
    /// Per layer of the plan, its digest.
    digests: &'a [String],
    /// Per layer, where it was filtered.
    filtered: Vec<Option<FilteredLayer>>,
    page: PageBands<'a>,
    /// Per texel, the sum of all layers.
    light: Vec<f32>,
    cell_map: &'a CellMap,
    pieces: Pieces,
    /// Covered texels that are not valid: too little of them is surface, the rest in solids or beyond a wall.
    buried_texels: usize,
    /// Covered texels that are not valid: no light reaches them.
    unlit_texels: usize,
    /// Valid texels that no light reaches.
    black_texels: usize,
}

/// The stored images of a bake.
#[derive(Debug)]
pub struct Assembled {
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
    /// Valid texels that no light reaches in any layer: it is found all around them.
    pub black_texels: usize,
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
pub(super) type Share = (config::Part, Vec<Option<FileRef>>);

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
        layers: (&'a Layers, &'a [String]),
        texels: Vec<Texel>,
        cell_map: &'a CellMap,
        padding: u32,
    ) -> Result<Self> {
        Assembler::with_bands(plan, geometry, atlas, layers, texels, cell_map, (padding, TEXELS_OF_BAND))
    }

    /// [`Assembler::new`], with bands of about `band` texels; the images do not depend on it.
    pub fn with_bands(
        plan: &'a Plan,
        geometry: &Geometry,
        atlas: &'a Atlas,
        (layers, digests): (&'a Layers, &'a [String]),
        texels: Vec<Texel>,
        cell_map: &'a CellMap,
        (padding, band): (u32, usize),
    ) -> Result<Self> {
        let owners = Owners::new(atlas);
        let parts = digests.iter().enumerate().map(|(layer, digest)| (digest, plan.parts_of(layer)));
        let valid = ValidTexels::find(
            [atlas.width as usize, atlas.height as usize],
            &owners,
            &texels,
            layers,
            parts,
        )?;
        let ValidTexels { mask, light, buried, unlit, black } = valid;
        let pieces = Pieces::of_texels(cell_map, mask.width, texels.iter().map(|texel| texel.index as usize));
        Ok(Assembler {
            plan,
            atlas,
            layers,
            digests,
            filtered: vec![None; digests.len()],
            page: PageBands::new(geometry, atlas, &owners, (texels, mask), padding, band),
            light,
            cell_map,
            pieces,
            buried_texels: buried,
            unlit_texels: unlit,
            black_texels: black,
        })
    }

    /// The covered texels of the page.
    pub fn texels(&self) -> &[Texel] {
        &self.page.texels
    }

    /// Whether a covered texel is valid.
    pub fn is_valid(&self, position: usize) -> bool {
        self.page.is_valid(position)
    }

    /// The mask of valid texels of the virtual page.
    fn mask(&self) -> &Mask {
        &self.page.mask
    }

    /// With some layers as a filter left them.
    pub fn with_filtered(self, filtered: Vec<Option<FilteredLayer>>) -> Self {
        Assembler { filtered, ..self }
    }

    /// Reads a part of a layer, as a filter left it where there is one.
    fn reader(&self, layer: usize, part: Part) -> Result<LayerReader> {
        self.layers.reader_of(&self.digests[layer], part, self.filtered[layer].as_ref())
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
        let valid = self.texels().iter().enumerate().filter(|(position, _)| self.is_valid(*position));
        valid.map(|(position, texel)| (Chosen { position, index: texel.index }, self.light[position]))
    }

    /// A part of a layer on the page.
    fn part(&self, layer: usize, part: Part) -> Result<PartLight> {
        self.page.part(self.reader(layer, part)?, self.plan.scale_of(layer))
    }

    /// The sum of the light of some groups, given by their layers; each group's parts are summed first.
    fn group_light(&self, layers: &[usize]) -> Result<LightSum> {
        let mut sum = LightSum::default();
        for &layer in layers {
            let mut held = LightSum::default();
            for &part in self.plan.held_parts_of(layer) {
                held.add_part(self.part(layer, part)?);
            }
            sum.add_sum(&Rc::new(held));
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
        sum: &mut LightSum,
    ) -> Result<Vec<Share>> {
        let mut shares = Vec::new();
        for &(part, name) in parts {
            let Some(layer) = layer else {
                shares.push((name, vec![None; self.atlas.pages as usize]));
                continue;
            };
            let light = self.part(layer, part)?;
            let is_lit = |page: u32| light.is_lit[page as usize];
            let files = self.store_image(writer, &stem(name), is_lit, |band| self.page.band(&light, band))?;
            shares.push((name, files));
            sum.add_part(light);
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

    /// Stores an image given by its bands, one file for each page that `is_lit`.
    fn store_image<'t>(
        &self,
        writer: &mut Writer,
        stem: &str,
        is_lit: impl Fn(u32) -> bool,
        texels_of: impl Fn(usize) -> Result<BandLight<'t>>,
    ) -> Result<Vec<Option<FileRef>>> {
        let width = self.mask().width;
        let mut last: Option<(usize, BandLight)> = None;
        let mut store_page = |page: u32| {
            let rows = self.atlas.page_rows(page);
            writer.add_exr(&self.stem(stem, page), (width, rows.len()), |y, row| {
                let (band, y) = self.page.place_of_row(rows.start as usize + y);
                let texels = match last.take().filter(|(number, _)| *number == band) {
                    Some((_, texels)) => texels,
                    None => {
                        stop_if_interrupted()?;
                        texels_of(band)?
                    }
                };
                row.copy_from_slice(&texels[y * width..][..width]);
                last = Some((band, texels));
                Ok(())
            })
        };
        (0..self.atlas.pages).map(|page| is_lit(page).then(|| store_page(page)).transpose()).collect()
    }

    fn stem(&self, stem: &str, page: u32) -> String {
        if self.atlas.pages == 1 { stem.to_owned() } else { format!("{stem}-p{page}") }
    }

    /// Writes all images: masks, groups, and per time sun, sky and their sum with the lit groups. `baked`
    /// says which part of each light they hold.
    pub fn store(
        &self,
        writer: &mut Writer,
        baked: &BakedParts,
        mut each: impl FnMut(),
    ) -> Result<Assembled> {
        let pages = self.store_masks(writer)?;
        let first_group = self.plan.suns.len() + self.plan.sky_hours.len();
        let mut is_dark = vec![false; self.plan.groups.len()];
        let mut of_groups = Vec::new();
        for (index, &of_group) in self.plan.index_of_group.iter().zip(&baked.groups) {
            // A group that was not traced gave no light at any time baked.
            let layer = index.map(|g| first_group + g);
            let parts = parts_in_dataset(of_group, false);
            let stem = |part: config::Part| format!("group{}-{}", index.unwrap_or_default(), part.name());
            let shares = self.store_parts(writer, layer, parts, stem, &mut LightSum::default())?;
            if let (Some(g), Some(layer)) = (*index, layer) {
                let is_lit = shares.iter().any(|(_, files)| files.iter().any(Option::is_some));
                is_dark[g] = !is_lit && self.is_dark(layer)?;
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
        let mut errors = Errors::new(self.mask().width, self.mask().height, self.plan.times.len());
        let (mut all_cells, mut of_frames, mut worst) = (Vec::new(), Vec::new(), None);
        // The light of groups stays the same over many times.
        let (mut group_light, mut groups_on) = (Rc::new(LightSum::default()), Vec::new());
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
            let mut total = LightSum::default();
            let sun =
                self.store_parts(writer, self.plan.sun_of[i], sun_parts, stem(Light::Sun), &mut total)?;
            let sky_layer = self.plan.sky_of[i].map(|s| self.plan.suns.len() + s);
            // (Lightmaps hold one part of a sky: added to the sun's light, it is as if it were summed by
            // itself first.)
            let sky = self.store_parts(writer, sky_layer, sky_parts, stem(Light::Sky), &mut total)?;
            for (layers, shares) in [(&mut suns, sun), (&mut skies, sky)] {
                layers.iter_mut().zip(shares).for_each(|(layer, (_, files))| layer.files.push(files));
            }
            let on: Vec<usize> = self.plan.group_layers_of(i).collect();
            if on != groups_on {
                // (The old sum is freed before the new one is made.)
                drop(group_light);
                group_light = Rc::new(self.group_light(&on)?);
                groups_on = on;
            }
            total.add_sum(&group_light);
            let texels_of = |band| self.page.band_of_sum(&total, band);
            let maps = self.store_image(writer, &format!("frame-{hour}"), |_| true, texels_of)?;
            frames.push(Frame {
                hour: time.hour,
                groups_on: time.groups_on.clone(),
                relative_error: errors.relative_of_frame(i),
                maps: maps.into_iter().flatten().collect(),
            });
            each();
        }
        let noise = Noise { tile: TILE as u32, mse: self.noise(&errors) };
        let noise = writer.add("noise", "json", &json::bytes(&noise, "noise table")?)?;
        let layers = self.plan.index_of_group.iter().enumerate();
        let dark = layers.filter(|(_, layer)| layer.is_some_and(|layer| is_dark[layer]));
        Ok(Assembled {
            pages,
            daylight: suns.into_iter().chain(skies).collect(),
            groups: of_groups,
            dark_groups: dark.map(|(group, _)| group).collect(),
            frames,
            noise,
            valid_texels: self.mask().count(),
            buried_texels: self.buried_texels,
            unlit_texels: self.unlit_texels,
            black_texels: self.black_texels,
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
                let (rows, width) = (self.atlas.page_rows(page), self.mask().width);
                let (from, to) = (rows.start as usize * width, rows.end as usize * width);
                let mask = Mask { width, height: rows.len(), valid: self.mask().valid[from..to].to_vec() };
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
            let (x, y) = self.place(texel);
            let mut sums = Sums::default();
            sums.add_texel(value);
            errors.add(time, x, y, &sums);
            self.pieces.add_texel(texel, value, &mut pieces);
        })?;
        let mut cells = vec![Sums::default(); self.cell_map.grid().cells()];
        self.pieces.add_to_cells(&pieces, &mut cells);
        Ok(cells)
    }

    /// Column and row of a covered texel.
    fn place(&self, texel: usize) -> (usize, usize) {
        let index = self.texels()[texel].index as usize;
        (index % self.mask().width, index / self.mask().width)
    }

    /// Goes through the valid texels, with the sum of what lightmaps hold of some layers at each.
    fn each_sum(&self, layers: &[usize], mut each: impl FnMut(usize, &Value)) -> Result<()> {
        let mut parts = Vec::new();
        for &layer in layers {
            let scale = self.plan.scale_of(layer);
            for &part in self.plan.held_parts_of(layer) {
                parts.push((self.reader(layer, part)?, scale));
            }
        }
        each_sum(&parts, self.texels().len(), |texel, value| {
            if self.is_valid(texel) {
                each(texel, value);
            }
        })
    }

    /// What the errors of a frame come from.
    fn worst(&self, frame: usize, errors: Vec<f64>) -> Result<WorstFrame> {
        let mut causes = Vec::new();
        for layer in self.plan.layers_of(frame) {
            let mut missed = 0.0;
            self.each_sum(&[layer], |texel, value| {
                let (x, y) = self.place(texel);
                if errors[self.cell_map.grid().at(x, y)] > COUNTED_ERRORS[0] {
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
        let seams = &self.page.seams;
        let Some(time) = brightest.filter(|_| seams.edges() > 0) else { return Ok(None) };
        let [mut dilated, mut stitched] = [(); 2].map(|()| vec![[0.0; 3]; seams.texels().len()]);
        for layer in self.plan.layers_of(time) {
            for &part in self.plan.held_parts_of(layer) {
                let light = self.part(layer, part)?;
                add(&mut dilated, &light.dilated_at_seams);
                add(&mut stitched, &light.stitched_at_seams);
            }
        }
        let jumps = seams.jump_of(&dilated).zip(seams.jump_of(&stitched));
        Ok(jumps.map(|(before, after)| (seams.edges(), before, after)))
    }
}
