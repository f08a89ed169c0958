//! Cuts pages into tiles: the training data of one tile.
//!
//! A page is read one band (row of tiles) at a time, so memory grows with its width and the number of frames,
//! never with its height.

use crate::Result;
use crate::grid::{Grid, Place, mirrored};
use crate::law::{Law, LayerRows, Shares, Sums};
use crate::model::{BORDER, PAYLOAD};
use dataset::format::{Light, Rect};
use dataset::image::Mask;
use dataset::store::Dataset;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

/// Texels around a valid one that filtering near a chart's edge may read.
pub const GUTTER: usize = 2;

/// A light group whose light is below this share of every frame's, RMS over the tile, does not light it,
const TRIFLE: f64 = 1e-3;
/// unless it is above this share in some texel.
const TRIFLE_ANYWHERE: f32 = 0.01;

/// How much a stored texel counts in training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coverage {
    /// Not on a surface and not near one: never read.
    Outside,
    /// Within two texels of a valid one: carries dilated light that filtering at chart edges reads; trained
    /// at low weight.
    Gutter,
    /// On a surface.
    Valid,
}

/// A light group that may switch a tile's light.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gate {
    /// The group's index.
    pub group: u16,
    /// Per frame: whether the group is on.
    pub on: Vec<bool>,
}

/// The light of one tile over all frames.
#[derive(Clone, Debug)]
pub struct TileSource {
    /// Stored width in texels, a multiple of 4.
    pub width: usize,
    /// Stored height in texels, a multiple of 4.
    pub height: usize,
    /// Per frame: its hour, strictly ascending in [0, 24).
    pub hours: Vec<f64>,
    /// Per frame: `width · height` texels of linear irradiance, finite and ≥ 0, borders filled from the
    /// neighbours or mirrored.
    pub frames: Vec<Vec<[f32; 3]>>,
    /// Per stored texel.
    pub coverage: Vec<Coverage>,
    /// Light groups that light the tile, ascending.
    pub gates: Vec<Gate>,
    /// True if the page continues in another tile: to the left, to the right, above, below.
    pub neighbours: [bool; 4],
}

/// Coverage of the page's rows `rows`, row by row. Gutter is within [`GUTTER`] texels (Chebyshev) of a valid
/// texel of the page.
pub fn coverage(mask: &Mask, rows: Range<usize>) -> Vec<Coverage> {
    let (width, height) = (mask.width, mask.height);
    let mut out = Vec::with_capacity(width * rows.len());
    for y in rows {
        // Columns with a valid texel within GUTTER rows, then columns within GUTTER of such a one.
        let mut near_rows = vec![false; width];
        for row in y.saturating_sub(GUTTER)..(y + GUTTER + 1).min(height) {
            for (near, &valid) in near_rows.iter_mut().zip(&mask.valid[row * width..(row + 1) * width]) {
                *near |= valid;
            }
        }
        out.extend((0..width).map(|x| {
            if mask.valid[y * width + x] {
                Coverage::Valid
            } else if near_rows[x.saturating_sub(GUTTER)..(x + GUTTER + 1).min(width)].contains(&true) {
                Coverage::Gutter
            } else {
                Coverage::Outside
            }
        }));
    }
    out
}

/// Valid texels of a tile, its border with them: those that it is trained to.
pub fn valid_texels(mask: &Mask, place: Place) -> usize {
    let grid = Grid { width: mask.width, height: mask.height };
    let own = grid.payload(place.column, place.row);
    let range = |at: usize, own: usize, extent: usize| {
        let first = at * PAYLOAD;
        first.saturating_sub(BORDER)..(first + own + BORDER).min(extent)
    };
    let columns = range(place.column, own.0, mask.width);
    let rows = range(place.row, own.1, mask.height);
    rows.flat_map(|y| &mask.valid[y * mask.width..][columns.clone()]).filter(|valid| **valid).count()
}

/// Per texel of a rectangle from (left, top) on, row by row, which of the page's rows it is: past the page's
/// edge mirrored.
pub(crate) fn stored(
    page: Grid,
    rows: &Range<usize>,
    [left, top]: [isize; 2],
    [width, height]: [usize; 2],
) -> Vec<usize> {
    let mut from = Vec::with_capacity(width * height);
    for y in 0..height as isize {
        // Texels that are never read may lie past the rows in memory.
        let row = mirrored(top + y, page.height).clamp(rows.start, rows.end - 1);
        let line = (row - rows.start) * page.width;
        from.extend((0..width as isize).map(|x| line + mirrored(left + x, page.width)));
    }
    from
}

/// A row of tiles with its light, in memory.
#[derive(Debug)]
pub struct Band {
    grid: Grid,
    page: usize,
    row: usize,
    hours: Vec<f64>,
    /// The page rows held.
    rows: Range<usize>,
    /// Per frame, `rows.len() × width` texels; frames that share a file share the texels.
    frames: Vec<Arc<Vec<[f32; 3]>>>,
    /// Per texel of `rows`.
    coverage: Vec<Coverage>,
    /// Per column of tiles and frame, the shares of its light, over all rows held; nothing where no layer has
    /// a curve.
    shares: Vec<Vec<Shares>>,
    /// Light groups that are on at some frames and off at others, with their own light where the dataset
    /// keeps it.
    groups: Vec<(Gate, Option<Vec<[f32; 3]>>)>,
    /// Light groups whose light maps do not hold, with it.
    lamps: Vec<(Gate, Vec<[f32; 3]>)>,
    /// Where [`Band::lamps`] are apart, all light of the frames, the sun's direct light with it.
    whole: Vec<Arc<Vec<[f32; 3]>>>,
    /// See [`Band::digest`].
    digest: OnceLock<String>,
}

impl Band {
    /// The page rows that a band of tiles needs: payload, borders and filler, inside the page.
    pub fn rows(grid: Grid, row: usize) -> Range<usize> {
        let top = Place { page: 0, column: 0, row }.origin().1;
        let (_, stored) = grid.stored(0, row);
        // Filler past the page's end mirrors rows above it; at most 4 of them, all within the band.
        top.max(0) as usize..grid.height.min((top + stored as isize) as usize)
    }

    /// Reads one band of all frames: the light that maps hold. Texels are checked by [`Dataset::map_rows`].
    pub fn load(dataset: &Dataset, law: &Law, mask: &Mask, page: usize, row: usize) -> Result<Self> {
        let grid = Grid { width: mask.width, height: mask.height };
        Self::read(dataset, law, mask, page, row, Self::rows(grid, row))
    }

    /// Reads the rows of a page that hold `rect`, of all frames, and cuts out its texels alone: a tile
    /// without a border. `rect` is at most 128×128.
    pub(crate) fn load_alone(dataset: &Dataset, mask: &Mask, page: usize, rect: Rect) -> Result<TileSource> {
        let band = Self::read(dataset, &Law::of(false), mask, page, 0, rect.y0..rect.y1)?;
        let size = [rect.width(), rect.height()];
        Ok(band.cut([rect.x0 as isize, rect.y0 as isize], size.map(|side| side.next_multiple_of(4)), size))
    }

    /// The rows `rows` of a page, which contain band `row` or are read otherwise.
    fn read(
        dataset: &Dataset,
        law: &Law,
        mask: &Mask,
        page: usize,
        row: usize,
        rows: Range<usize>,
    ) -> Result<Self> {
        let grid = Grid { width: mask.width, height: mask.height };
        let mut read: BTreeMap<Vec<&str>, Arc<Vec<[f32; 3]>>> = BTreeMap::new();
        let mut frames = Vec::with_capacity(dataset.config.frames.len());
        let mut shares: Vec<Vec<Shares>> = vec![Vec::new(); grid.columns()];
        let mut kept = LayerRows::new();
        for k in 0..dataset.config.frames.len() {
            let files = law.files(dataset, k, page);
            // Frames of the same light have the same shares of it, unless the shares alone are wanted.
            if let Some(texels) = read.get(&files)
                && !law.has_curves()
            {
                frames.push(texels.clone());
                continue;
            }
            let light = law.rows(dataset, [k, page], [rows.start, rows.end], &mut kept)?;
            if law.has_curves() {
                for (column, shares) in shares.iter_mut().enumerate() {
                    let own = column * PAYLOAD..((column + 1) * PAYLOAD).min(grid.width);
                    let mut sums = Sums::new(law);
                    for y in rows.clone() {
                        let line = (y - rows.start) * grid.width;
                        let valid = own.clone().filter(|x| mask.valid[y * grid.width + x]);
                        sums.add(&light, valid.map(|x| line + x));
                    }
                    shares.push(sums.mean());
                }
            }
            frames.push(read.entry(files).or_insert(Arc::new(light.0)).clone());
        }
        let hours = dataset.config.frames.iter().map(|frame| frame.hour).collect();
        let (mut groups, mut lamps, mut whole) = (Vec::new(), Vec::new(), Vec::new());
        let config = &dataset.config;
        if law.are_lamps_apart {
            let mut read: BTreeMap<&str, Arc<Vec<[f32; 3]>>> = BTreeMap::new();
            for (k, frame) in config.frames.iter().enumerate() {
                let file = frame.maps[page].path.as_str();
                if !read.contains_key(file) {
                    read.insert(file, Arc::new(dataset.map_rows(k, page, rows.start, rows.end)?));
                }
                whole.push(read[file].clone());
            }
        }
        for i in 0..config.groups.len() {
            let on: Vec<bool> = config.frames.iter().map(|frame| frame.groups_on[i]).collect();
            if law.are_lamps_apart {
                if let Ok(group) = u16::try_from(i)
                    && on.contains(&true)
                {
                    let files = config.files_of(Light::Group, Some(i as u32), 0, page);
                    let layer = dataset.sum_rows(&files, page, rows.start, rows.end)?;
                    lamps.push((Gate { group, on }, layer));
                }
                continue;
            }
            // The format counts this many groups as gates.
            if let Ok(group_index) = u16::try_from(i)
                && on.contains(&true)
                && on.contains(&false)
            {
                let files = config.files_of(Light::Group, Some(i as u32), 0, page);
                let is_kept = config.layers_of(Light::Group, Some(i as u32)).next().is_some();
                let layer =
                    is_kept.then(|| dataset.sum_rows(&files, page, rows.start, rows.end)).transpose()?;
                groups.push((Gate { group: group_index, on }, layer));
            }
        }
        Ok(Band {
            grid,
            page,
            row,
            hours,
            coverage: coverage(mask, rows.clone()),
            rows,
            frames,
            groups,
            lamps,
            whole,
            shares,
            digest: OnceLock::new(),
        })
    }

    /// Digest of the light in memory.
    pub(crate) fn digest(&self) -> &str {
        self.digest.get_or_init(|| {
            let mut hasher = blake3::Hasher::new();
            let mut seen: Vec<*const Vec<[f32; 3]>> = Vec::new();
            for frame in &self.frames {
                // (Frames of the same files share their texels.)
                let at = seen.iter().position(|other| *other == Arc::as_ptr(frame)).unwrap_or(seen.len());
                hasher.update(&(at as u64).to_le_bytes());
                if at == seen.len() {
                    seen.push(Arc::as_ptr(frame));
                    hasher.update(bytemuck::cast_slice(frame));
                }
            }
            for (gate, layer) in &self.groups {
                hasher.update(&gate.group.to_le_bytes());
                layer.iter().for_each(|texels| _ = hasher.update(bytemuck::cast_slice(texels)));
            }
            for (gate, layer) in &self.lamps {
                hasher.update(&gate.group.to_le_bytes());
                hasher.update(bytemuck::cast_slice(layer));
            }
            hasher.update(format!("{:?}", self.shares).as_bytes());
            hasher.finalize().to_hex()[..32].to_owned()
        })
    }

    /// The shares of a tile's light per frame, its border's rows with them; nothing where no layer has a
    /// curve.
    pub(crate) fn shares(&self, column: usize) -> &[Shares] {
        &self.shares[column]
    }

    /// The light of the groups that are apart on one tile: of each, when it is on, and its light.
    pub fn lamps(&self, column: usize) -> Vec<(Gate, Vec<[f32; 3]>)> {
        let from = self.stored(column);
        let cut = |texels: &Vec<[f32; 3]>| from.iter().map(|&i| texels[i]).collect();
        self.lamps.iter().map(|(gate, texels)| (gate.clone(), cut(texels))).collect()
    }

    /// Per frame, the largest value of all its light on the valid texels of a tile; nothing unless lamps are
    /// apart.
    pub fn peaks(&self, column: usize) -> Vec<f32> {
        let from = self.stored(column);
        let valid: Vec<usize> = from.into_iter().filter(|&i| self.coverage[i] == Coverage::Valid).collect();
        let peak = |texels: &Arc<Vec<[f32; 3]>>| valid.iter().flat_map(|&i| texels[i]).fold(0.0, f32::max);
        self.whole.iter().map(peak).collect()
    }

    fn stored(&self, column: usize) -> Vec<usize> {
        let (width, height) = self.grid.stored(column, self.row);
        let (left, top) = Place { page: self.page, column, row: self.row }.origin();
        stored(self.grid, &self.rows, [left, top], [width, height])
    }

    /// Cuts out one tile. Past the page's edge texels are mirrored; filler past the border is never read, so
    /// it is `Outside`.
    pub fn tile(&self, column: usize) -> TileSource {
        let (width, height) = self.grid.stored(column, self.row);
        let (own_width, own_height) = self.grid.payload(column, self.row);
        let (left, top) = Place { page: self.page, column, row: self.row }.origin();
        let examined = [own_width, own_height].map(|own| own + 2 * BORDER);
        let after = [column + 1 < self.grid.columns(), self.row + 1 < self.grid.rows()];
        TileSource {
            neighbours: [column > 0, after[0], self.row > 0, after[1]],
            ..self.cut([left, top], [width, height], examined)
        }
    }

    /// The texels from (left, top) on, of which only the first `looked_at` across and down are; without
    /// neighbours.
    fn cut(&self, [left, top]: [isize; 2], [width, height]: [usize; 2], examined: [usize; 2]) -> TileSource {
        let from = stored(self.grid, &self.rows, [left, top], [width, height]);
        let frames = self.frames.iter().map(|texels| from.iter().map(|&i| texels[i]).collect()).collect();
        let read = |i: usize| i % width < examined[0] && i / width < examined[1];
        let coverage = from
            .iter()
            .enumerate()
            .map(|(i, &at)| if read(i) { self.coverage[at] } else { Coverage::Outside });
        let coverage: Vec<Coverage> = coverage.collect();
        let valid: Vec<usize> =
            (0..from.len()).filter(|&i| coverage[i] == Coverage::Valid).map(|i| from[i]).collect();
        let lights =
            |(gate, layer): &&(Gate, Option<Vec<[f32; 3]>>)| self.lights(gate, layer.as_deref(), &valid);
        let gates = self.groups.iter().filter(lights).map(|(gate, _)| gate.clone()).collect();
        TileSource {
            width,
            height,
            hours: self.hours.clone(),
            coverage,
            frames,
            gates,
            neighbours: [false; 4],
        }
    }

    /// Whether a group's light is more than a trifle of some frame's, over the valid texels of a tile or in
    /// one of them. Without the group's own light: unless two frames between which it alone switches are the
    /// same.
    fn lights(&self, gate: &Gate, layer: Option<&[[f32; 3]]>, valid: &[usize]) -> bool {
        let square = |texels: &[[f32; 3]]| -> f64 {
            valid.iter().flat_map(|&i| texels[i]).map(|v| f64::from(v) * f64::from(v)).sum()
        };
        let on = || (0..gate.on.len()).filter(|&k| gate.on[k]);
        match layer {
            Some(layer) => {
                let own = square(layer);
                let somewhere = |frame: &[[f32; 3]]| {
                    valid.iter().any(|&i| (0..3).any(|c| layer[i][c] > TRIFLE_ANYWHERE * frame[i][c]))
                };
                let lights =
                    |k: usize| own > TRIFLE * TRIFLE * square(&self.frames[k]) || somewhere(&self.frames[k]);
                own > 0.0 && on().any(lights)
            }
            None => {
                let alone = |a: usize, b: usize| {
                    gate.on[a] != gate.on[b]
                        && self.groups.iter().all(|(g, _)| g == gate || g.on[a] == g.on[b])
                };
                let same = |a: usize, b: usize| valid.iter().all(|&i| self.frames[a][i] == self.frames[b][i]);
                !(1..self.frames.len()).any(|k| alone(k - 1, k) && same(k - 1, k))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(width: usize, height: usize, valid: impl Fn(usize, usize) -> bool) -> Mask {
        Mask { width, height, valid: (0..width * height).map(|i| valid(i % width, i / width)).collect() }
    }

    /// A band of one frame whose texel (x, y) is [x, y, 0].
    fn band(mask: &Mask, row: usize) -> Band {
        let grid = Grid { width: mask.width, height: mask.height };
        let rows = Band::rows(grid, row);
        let texels = rows.clone().flat_map(|y| (0..mask.width).map(move |x| [x as f32, y as f32, 0.0]));
        Band {
            grid,
            page: 0,
            row,
            hours: vec![12.0],
            frames: vec![Arc::new(texels.collect())],
            coverage: coverage(mask, rows.clone()),
            lamps: Vec::new(),
            whole: Vec::new(),
            groups: vec![],
            shares: vec![],
            digest: OnceLock::new(),
            rows,
        }
    }

    #[test]
    fn gutter_is_a_square_of_five_around_a_valid_texel_and_crosses_tiles() {
        let mask = mask(300, 9, |x, y| (x, y) == (PAYLOAD, 4));
        let all = coverage(&mask, 0..9);
        for (i, &c) in all.iter().enumerate() {
            let (dx, dy) = ((i % 300).abs_diff(PAYLOAD), (i / 300).abs_diff(4));
            let expected = match dx.max(dy) {
                0 => Coverage::Valid,
                1..=2 => Coverage::Gutter,
                _ => Coverage::Outside,
            };
            assert_eq!(c, expected, "{i}");
        }
        // The valid texel belongs to the second tile; the first sees it in its border and has gutter of its
        // own.
        let first = band(&mask, 0).tile(0);
        let line = &first.coverage[5 * first.width..6 * first.width];
        assert_eq!(line[BORDER + PAYLOAD], Coverage::Valid);
        assert_eq!(line[BORDER + PAYLOAD - 2], Coverage::Gutter);
        assert_eq!(line[BORDER + PAYLOAD - 3], Coverage::Outside);
    }

    #[test]
    fn a_tile_is_trained_to_the_texels_of_its_border_too() {
        let mask = mask(300, 130, |x, y| (x, y) == (PAYLOAD, 4) || (x, y) == (299, 129));
        let texels = |column, row| valid_texels(&mask, Place { page: 0, column, row });
        assert_eq!([texels(0, 0), texels(1, 0), texels(2, 0)], [1, 1, 0]);
        assert_eq!([texels(0, 1), texels(1, 1), texels(2, 1)], [0, 0, 1]);
    }

    #[test]
    fn a_group_is_a_gate_of_the_tiles_that_it_lights() {
        let mask = mask(300, 20, |_, _| true);
        let mut band = band(&mask, 0);
        // Four frames; the first group switches after the first frame, the second after the third.
        let first = Gate { group: 3, on: vec![false, true, true, true] };
        let second = Gate { group: 5, on: vec![true, true, true, false] };
        let frame = |left: f32, right: f32| {
            let texel = move |i: usize| [if i % 300 < 150 { left } else { right }; 3];
            Arc::new((0..300 * 20).map(texel).collect::<Vec<_>>())
        };
        band.hours = vec![1.0, 2.0, 3.0, 4.0];
        band.frames = vec![frame(1.0, 1.0), frame(2.0, 1.0), frame(2.5, 1.5), frame(2.5, 1.0)];
        let groups = |band: &Band, column: usize| -> Vec<u16> {
            band.tile(column).gates.iter().map(|gate| gate.group).collect()
        };
        // By their own light: above a thousandth of a frame's.
        let layer = |left: f32, right: f32| Some(frame(left, right).to_vec());
        band.groups = vec![(first.clone(), layer(0.01, 0.0)), (second.clone(), layer(1e-4, 0.5))];
        assert_eq!((groups(&band, 0), groups(&band, 2)), (vec![3], vec![5]));
        // Or by one texel, however bright others are.
        let spot = |i: usize| [if i == 40 { 0.1 } else { 0.0 }; 3];
        let bright = |i: usize| [if i == 41 { 1e6 } else { 2.0 }; 3];
        let frames = std::mem::replace(
            &mut band.frames,
            (0..4).map(|_| Arc::new((0..6000).map(bright).collect())).collect(),
        );
        band.groups =
            vec![(first.clone(), Some((0..6000).map(spot).collect())), (second.clone(), layer(0.001, 0.0))];
        assert_eq!(groups(&band, 0), [3]);
        band.frames = frames;
        // Without it, by what happens where one switches alone.
        band.groups = vec![(first, None), (second, None)];
        assert_eq!((groups(&band, 0), groups(&band, 2)), (vec![3], vec![5]));
    }

    #[test]
    fn tiles_of_any_page_repeat_the_right_texels() {
        for (width, height) in [(1, 1), (2, 3), (126, 126), (127, 128), (129, 255), (150, 140), (300, 2)] {
            let mask = mask(width, height, |_, _| true);
            let grid = Grid { width, height };
            for row in 0..grid.rows() {
                let band = band(&mask, row);
                for column in 0..grid.columns() {
                    let tile = band.tile(column);
                    let (left, top) = Place { page: 0, column, row }.origin();
                    let (own_width, own_height) = grid.payload(column, row);
                    assert_eq!((tile.width, tile.height), grid.stored(column, row));
                    for (i, texel) in tile.frames[0].iter().enumerate() {
                        let (x, y) = (i % tile.width, i / tile.width);
                        let expected = [
                            mirrored(left + x as isize, width) as f32,
                            mirrored(top + y as isize, height) as f32,
                            0.0,
                        ];
                        assert_eq!(*texel, expected);
                        let read = x < own_width + 2 * BORDER && y < own_height + 2 * BORDER;
                        assert_eq!(tile.coverage[i] == Coverage::Valid, read);
                    }
                }
            }
        }
    }
}
