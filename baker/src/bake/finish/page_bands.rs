//! Light on a page from the texels of layers: dilated and stitched, in bands of rows, so that no image of a
//! large page is in memory whole.

use super::dilate::Dilation;
use super::seams::Seams;
use crate::atlas::Atlas;
use crate::atlas::owners::Owners;
use crate::bake::layers::{LayerReader, Texel};
use crate::geometry::Geometry;
use crate::surface::BLOCK;
use crate::{Result, Rgb};
use dataset::image::{Image, Mask};
use std::borrow::Cow;
use std::ops::Range;
use std::rc::Rc;

/// Texels of a band, about.
pub(crate) const TEXELS_OF_BAND: usize = 1 << 23;

/// The distance around valid texels that is filled at least: a 4×4 block, which one chart owns.
pub(crate) const LEAST_FILLED: u32 = 4;

/// Light of a band's texels, row by row.
pub(super) type BandLight<'a> = Cow<'a, [[f32; 3]]>;

/// A page in bands of rows: its covered texels, and what is filled and stitched.
pub(super) struct PageBands<'a> {
    atlas: &'a Atlas,
    /// The covered texels.
    pub texels: Vec<Texel>,
    /// Valid texels of the virtual page.
    pub mask: Mask,
    /// Where charts meet.
    pub seams: Seams,
    bands: Vec<Band>,
    rows_of_band: usize,
}

/// Rows that are in memory together.
struct Band {
    rows: Range<usize>,
    /// These rows, and those around them from which light may be filled in.
    window: Range<usize>,
    /// The covered texels of the blocks that the window touches, by position.
    positions: Range<usize>,
    dilation: Dilation,
    /// Texels at seams: the index in the band, and that in [`Seams::texels`].
    at_seams: Vec<(u32, u32)>,
}

/// A part of a layer on the page, read band by band.
pub(super) struct PartLight {
    reader: LayerReader,
    scale: Rgb,
    /// At the texels of seams, dilated only.
    pub dilated_at_seams: Vec<[f32; 3]>,
    /// The same after stitching.
    pub stitched_at_seams: Vec<[f32; 3]>,
    /// By page, whether any texel holds light.
    pub is_lit: Vec<bool>,
    /// All texels, where they are one band.
    whole: Option<Vec<[f32; 3]>>,
}

/// A sum of parts on the page, likewise read band by band.
#[derive(Default)]
pub(super) struct LightSum {
    /// Of all texels, where they are one band.
    whole: Option<Vec<[f32; 3]>>,
    /// Else what is summed, in this order.
    terms: Vec<Term>,
}

enum Term {
    Part(PartLight),
    Sum(Rc<LightSum>),
}

impl LightSum {
    /// Adds a part.
    pub(super) fn add_part(&mut self, part: PartLight) {
        match part.whole {
            Some(whole) => self.add_whole(&whole),
            None => self.terms.push(Term::Part(part)),
        }
    }

    /// Adds a sum.
    pub(super) fn add_sum(&mut self, sum: &Rc<LightSum>) {
        match &sum.whole {
            Some(whole) => self.add_whole(whole),
            None => self.terms.push(Term::Sum(Rc::clone(sum))),
        }
    }

    fn add_whole(&mut self, whole: &[[f32; 3]]) {
        add(self.whole.get_or_insert_with(|| vec![[0.0; 3]; whole.len()]), whole);
    }
}

impl<'a> PageBands<'a> {
    /// Light is filled in up to `padding` texels around valid ones; bands have about `texels_of_band` texels.
    pub(super) fn new(
        geometry: &Geometry,
        atlas: &'a Atlas,
        owners: &Owners,
        (texels, mask): (Vec<Texel>, Mask),
        padding: u32,
        texels_of_band: usize,
    ) -> Self {
        let seams = Seams::new(geometry, atlas, &mask);
        let distance = padding.max(LEAST_FILLED);
        let (width, height) = (mask.width, mask.height);
        let rows_of_band = (texels_of_band / width).max(1).next_multiple_of(BLOCK);
        let first_in_block_row =
            |row: usize| texels.partition_point(|texel| (texel.index as usize / width / BLOCK) < row);
        let mut at_seams: Vec<(u32, u32)> = seams.texels().iter().copied().zip(0..).collect();
        at_seams.sort_unstable();
        let band = |start: usize| {
            let rows = start..(start + rows_of_band).min(height);
            let reach = Dilation::reach(distance);
            let window = rows.start.saturating_sub(reach)..(rows.end + reach).min(height);
            let [from, to] = [window.start / BLOCK, window.end.div_ceil(BLOCK)].map(first_in_block_row);
            let before = |row: usize| at_seams.partition_point(|(texel, _)| (*texel as usize) < row * width);
            let in_band = |&(texel, seam): &(u32, u32)| (texel - (rows.start * width) as u32, seam);
            Band {
                at_seams: at_seams[before(rows.start)..before(rows.end)].iter().map(in_band).collect(),
                dilation: Dilation::of_rows(&mask, owners, distance, window.clone()),
                positions: from..to,
                window,
                rows,
            }
        };
        let bands = (0..height).step_by(rows_of_band).map(band).collect();
        PageBands { atlas, texels, mask, seams, bands, rows_of_band }
    }

    /// Whether a covered texel is valid.
    pub(super) fn is_valid(&self, position: usize) -> bool {
        self.mask.valid[self.texels[position].index as usize]
    }

    /// The band that a row of the virtual page is in, and its number there.
    pub(super) fn place_of_row(&self, y: usize) -> (usize, usize) {
        (y / self.rows_of_band, y % self.rows_of_band)
    }

    /// A part of a layer, each texel times a colour. Reads it once, to stitch the seams.
    pub(super) fn part(&self, reader: LayerReader, scale: Rgb) -> Result<PartLight> {
        let mut dilated_at_seams = vec![[0.0; 3]; self.seams.texels().len()];
        let mut is_lit = vec![false; self.atlas.pages as usize];
        let mut whole = None;
        for band in &self.bands {
            let mut image = self.dilated(&reader, scale, band)?;
            for &(texel, seam) in &band.at_seams {
                dilated_at_seams[seam as usize] = std::mem::take(&mut image[texel as usize]);
            }
            for (page, is_lit) in is_lit.iter_mut().enumerate().filter(|(_, is_lit)| !**is_lit) {
                *is_lit = self.rows_of_page(page, band).iter().any(|rows| {
                    let (from, to) = (rows.start * self.mask.width, rows.end * self.mask.width);
                    image[from..to].iter().any(|texel| *texel != [0.0; 3])
                });
            }
            whole = Some(image).filter(|_| self.bands.len() == 1);
        }
        let stitched_at_seams = self.seams.stitched(&dilated_at_seams);
        for (&texel, light) in self.seams.texels().iter().zip(&stitched_at_seams) {
            let row = (texel as usize / self.mask.width) as u32;
            let of_page = |page: &usize| self.atlas.page_rows(*page as u32).contains(&row);
            if let Some(page) = (0..is_lit.len()).find(of_page).filter(|_| *light != [0.0; 3]) {
                is_lit[page] = true;
            }
        }
        if let Some(image) = &mut whole {
            stitch(image, &self.bands[0], &stitched_at_seams);
        }
        Ok(PartLight { reader, scale, dilated_at_seams, stitched_at_seams, is_lit, whole })
    }

    /// A band of it.
    pub(super) fn band<'p>(&self, part: &'p PartLight, band: usize) -> Result<BandLight<'p>> {
        if let Some(whole) = &part.whole {
            return Ok(Cow::Borrowed(whole));
        }
        let mut image = self.dilated(&part.reader, part.scale, &self.bands[band])?;
        stitch(&mut image, &self.bands[band], &part.stitched_at_seams);
        Ok(Cow::Owned(image))
    }

    /// A band of a sum.
    pub(super) fn band_of_sum<'s>(&self, sum: &'s LightSum, band: usize) -> Result<BandLight<'s>> {
        if let Some(whole) = &sum.whole {
            return Ok(Cow::Borrowed(whole));
        }
        let mut texels: Option<BandLight> = None;
        for term in &sum.terms {
            let of_term = match term {
                Term::Part(part) => self.band(part, band)?,
                Term::Sum(sum) => self.band_of_sum(sum, band)?,
            };
            match &mut texels {
                Some(texels) => add(texels.to_mut(), &of_term),
                // (Light is never negative zero, so that nothing plus it is it.)
                None => texels = Some(of_term),
            }
        }
        let black = || Cow::Owned(vec![[0.0; 3]; self.bands[band].rows.len() * self.mask.width]);
        Ok(texels.unwrap_or_else(black))
    }

    /// A band of what a reader gives, dilated.
    fn dilated(&self, reader: &LayerReader, scale: Rgb, band: &Band) -> Result<Vec<[f32; 3]>> {
        let width = self.mask.width;
        let mut image = Image::black(width, band.window.len());
        let (from, to) = (band.window.start * width, band.window.end * width);
        reader.each_of(band.positions.clone(), |position, value| {
            let index = self.texels[position].index as usize;
            if (from..to).contains(&index) && self.mask.valid[index] {
                image.texels[index - from] = (value.mean * scale).to_array();
            }
        })?;
        band.dilation.apply(&mut image);
        let mut texels = image.texels;
        texels.truncate((band.rows.end - band.window.start) * width);
        texels.drain(..(band.rows.start - band.window.start) * width);
        Ok(texels)
    }

    /// The rows of a band that are a page's, counted from the band's first.
    fn rows_of_page(&self, page: usize, band: &Band) -> Option<Range<usize>> {
        let rows = self.atlas.page_rows(page as u32);
        let from = band.rows.start.max(rows.start as usize);
        let to = band.rows.end.min(rows.end as usize);
        (from < to).then(|| from - band.rows.start..to - band.rows.start)
    }
}

/// Gives texels at seams their stitched light.
fn stitch(image: &mut [[f32; 3]], band: &Band, stitched: &[[f32; 3]]) {
    band.at_seams.iter().for_each(|&(texel, seam)| image[texel as usize] = stitched[seam as usize]);
}

/// Adds light to light.
pub(super) fn add(to: &mut [[f32; 3]], what: &[[f32; 3]]) {
    for (t, w) in to.iter_mut().zip(what) {
        (0..3).for_each(|c| t[c] += w[c]);
    }
}
