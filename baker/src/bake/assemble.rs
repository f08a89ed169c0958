//! From block sums to a dataset: every layer dilated and stored once, every set the float sum of its layers.

use super::errors::{Errors, is_exposed, is_lit};
use super::json;
use super::plan::Plan;
use super::post::dilate;
use super::state::StateFolder;
use crate::Result;
use crate::atlas::Atlas;
use crate::surface::{BlockSurface, FaceBins};
use dataset::config::{FileRef, Map, Noise, Set};
use dataset::image::{Image, Mask};
use dataset::store::Writer;
use dataset::tiles::TILE;

/// Reads finished work as images.
pub struct Assembler<'a> {
    /// What was traced.
    pub plan: &'a Plan,
    /// The work.
    pub folder: &'a StateFolder,
    /// Texels of dilation.
    pub padding: u32,
    /// Valid texels.
    mask: Mask,
    blocks: Vec<Block>,
    /// Covered texels that are not valid: inside solids.
    buried_texels: usize,
    /// Covered texels that are not valid: no light reaches them.
    unlit_texels: usize,
}

/// A block with surface.
struct Block {
    index: usize,
    /// The page texels it covers, in the order of its file, and the samples in each of their halves.
    texels: Vec<(u32, [u32; 2])>,
}

/// The stored images of a bake.
#[derive(Debug)]
pub struct Stored {
    /// The mask's file.
    pub mask: FileRef,
    /// Per group of the scene; black for those that were not traced.
    pub groups: Vec<FileRef>,
    /// The sets, in the order of the plan's moments.
    pub sets: Vec<Set>,
    /// The noise table's file.
    pub noise: FileRef,
    /// Valid texels.
    pub valid_texels: usize,
    /// Texels taken out because they lie inside solids.
    pub buried_texels: usize,
    /// Texels taken out because no light reaches them in any layer.
    pub unlit_texels: usize,
}

impl<'a> Assembler<'a> {
    /// Finds the valid texels: covered by surface, not inside a solid, and reached by light in some layer. In a scene
    /// without any light the last does not count.
    pub fn new(
        plan: &'a Plan,
        atlas: &Atlas,
        bins: &FaceBins,
        folder: &'a StateFolder,
        padding: u32,
    ) -> Result<Self> {
        let (width, height) = (atlas.width as usize, atlas.height as usize);
        let mut mask = Mask { width, height, valid: vec![false; width * height] };
        let mut blocks = Vec::new();
        let mut buried_texels = 0;
        let mut exposed_texels: Vec<usize> = Vec::new();
        for block in (0..bins.columns * bins.rows).filter(|&b| !bins.faces(b).is_empty()) {
            let surface = BlockSurface::new(atlas, bins, block);
            let texels: Vec<u32> = (0..surface.width * surface.height)
                .filter(|&t| surface.is_covered(t))
                .map(|t| ((surface.y0 + t / surface.width) * width + surface.x0 + t % surface.width) as u32)
                .collect();
            if texels.is_empty() {
                continue;
            }
            let state = folder.read(block, texels.len())?;
            let sums =
                state.sums.chunks((2 * plan.layers()).max(1)).map(is_lit).chain(std::iter::repeat(false));
            for ((&texel, &exposed), lit) in texels.iter().zip(&state.exposed).zip(sums) {
                let outside = is_exposed(exposed, state.samples);
                buried_texels += usize::from(!outside);
                exposed_texels.extend(outside.then_some(texel as usize));
                mask.valid[texel as usize] = outside && lit;
            }
            blocks.push(Block { index: block, texels: texels.into_iter().zip(state.exposed).collect() });
        }
        let mut unlit_texels = exposed_texels.len() - mask.count();
        if unlit_texels == exposed_texels.len() {
            exposed_texels.iter().for_each(|&texel| mask.valid[texel] = true);
            unlit_texels = 0;
        }
        Ok(Assembler { plan, folder, padding, mask, blocks, buried_texels, unlit_texels })
    }

    /// One layer as a dilated image.
    fn layer(&self, layer: usize) -> Result<Image> {
        let mut image = Image::black(self.mask.width, self.mask.height);
        for block in &self.blocks {
            let sums = self.folder.read_layer(block.index, block.texels.len(), layer)?;
            for (&(texel, [in_a, in_b]), [a, b]) in block.texels.iter().zip(sums) {
                if self.mask.valid[texel as usize] {
                    image.texels[texel as usize] = ((a / in_a as f32 + b / in_b as f32) * 0.5).to_array();
                }
            }
        }
        dilate(&mut image, &self.mask, self.padding);
        Ok(image)
    }

    /// Writes all images: mask, groups, and per moment sun, sky and their sum with the lit groups.
    pub fn store(&self, writer: &mut Writer, errors: &Errors, mut each: impl FnMut()) -> Result<Stored> {
        let mask = writer.add("mask", "png", &self.mask.to_png())?;
        let first_group = self.plan.suns.len() + self.plan.sky.lit.len();
        let mut group_images = Vec::new();
        let mut traced = Vec::new();
        for g in 0..self.plan.lamps.len() {
            let image = self.layer(first_group + g)?;
            traced.push(writer.add(&format!("group{g}"), "exr", &image.to_exr())?);
            group_images.push(image);
            each();
        }
        let black = Image::black(self.mask.width, self.mask.height);
        // A group that was not traced gave no light at any moment baked.
        let group = |layer: &Option<usize>| match layer {
            Some(layer) => Ok(traced[*layer].clone()),
            None => writer.add("black", "exr", &black.to_exr()),
        };
        let groups = self.plan.layer_of_group.iter().map(group).collect::<Result<Vec<_>>>()?;
        let mut sets = Vec::new();
        for (i, moment) in self.plan.moments.iter().enumerate() {
            let name = format!("{:07.4}", moment.hour);
            let mut layer = |index: Option<usize>, kind: &str| -> Result<(Image, Option<FileRef>)> {
                let Some(index) = index else { return Ok((black.clone(), None)) };
                let image = self.layer(index)?;
                if image == black {
                    return Ok((image, None));
                }
                let file = writer.add(&format!("{kind}-{name}"), "exr", &image.to_exr())?;
                Ok((image, Some(file)))
            };
            let (mut total, sun) = layer(self.plan.sun_of[i], "sun")?;
            let (sky_image, sky) = layer(self.plan.sky_of[i].map(|s| self.plan.suns.len() + s), "sky")?;
            // (sun + sky) + local, local summed from zero in the order of the groups.
            let mut local = black.clone();
            for group in self.plan.groups_of(i) {
                add(&mut local, &group_images[group - first_group]);
            }
            add(&mut total, &sky_image);
            add(&mut total, &local);
            let file = writer.add(&format!("set-{name}"), "exr", &total.to_exr())?;
            sets.push(Set {
                hour: moment.hour,
                groups_on: moment.groups_on.clone(),
                relative_error: errors.relative_of_set(i),
                maps: vec![Map { file, sun, sky }],
            });
            each();
        }
        let noise = Noise {
            tile: TILE as u32,
            mse: errors.tiles.iter().map(|tiles| vec![tiles.iter().map(|t| t.mse()).collect()]).collect(),
        };
        let noise = writer.add("noise", "json", &json::bytes(&noise, "noise table")?)?;
        let valid_texels = self.mask.valid.iter().filter(|v| **v).count();
        Ok(Stored {
            mask,
            groups,
            sets,
            noise,
            valid_texels,
            buried_texels: self.buried_texels,
            unlit_texels: self.unlit_texels,
        })
    }
}

fn add(to: &mut Image, what: &Image) {
    for (t, w) in to.texels.iter_mut().zip(&what.texels) {
        (0..3).for_each(|c| t[c] += w[c]);
    }
}
