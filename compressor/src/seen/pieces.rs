//! Which texels of a tile belong together, and their light.

/// Side of a cell in texels, as in bakes.
pub const CELL: usize = 16;
/// What is darker than this share of the median counts as if it were that bright, as in bakes.
const VISIBLE_PART: f64 = 1.0 / 30.0;
/// The same of the brightest, where half of a tile is black.
const VISIBLE_PART_OF_BRIGHTEST: f64 = 1.0 / 300.0;

/// The pieces of a tile: connected valid texels of one cell.
#[derive(Clone, Debug)]
pub struct Pieces {
    /// Row by row, the piece of each texel; `None` where it is not valid.
    of: Vec<Option<u32>>,
    /// Texels of each piece.
    sizes: Vec<u32>,
}

/// The light that a tile's errors are relative to, at one time.
#[derive(Clone, Debug)]
pub struct LocalLight {
    /// The floor.
    pub floor: f64,
    /// Per piece, its mean light or the floor, whichever is more.
    of_pieces: Vec<f64>,
}

impl Pieces {
    /// Of a tile of this width, whose texels are valid or not, row by row. Its first texel should be the
    /// first of a cell of its page.
    ///
    /// # Panics
    /// If the tile is not whole rows.
    pub fn new(width: usize, valid: &[bool]) -> Self {
        assert!(width > 0 && valid.len().is_multiple_of(width), "{} texels of width {width}", valid.len());
        let (mut of, mut sizes) = (vec![None; valid.len()], Vec::new());
        let mut open = Vec::new();
        for first in 0..valid.len() {
            if !valid[first] || of[first].is_some() {
                continue;
            }
            let piece = sizes.len() as u32;
            let mut size = 0;
            of[first] = Some(piece);
            open.push(first);
            while let Some(texel) = open.pop() {
                size += 1;
                for next in neighbours(width, valid.len(), texel) {
                    if valid[next] && of[next].is_none() {
                        of[next] = Some(piece);
                        open.push(next);
                    }
                }
            }
            sizes.push(size);
        }
        Pieces { of, sizes }
    }

    /// Texels of the tile, valid or not.
    pub fn texels(&self) -> usize {
        self.of.len()
    }

    /// The valid texels with their pieces, in order.
    pub(super) fn valid(&self) -> impl Iterator<Item = (usize, usize)> {
        self.of.iter().enumerate().filter_map(|(texel, piece)| Some((texel, (*piece)? as usize)))
    }

    /// The local light of all texels, from the true light of the tile, row by row; `least` is the least floor
    /// ([`super::least_floor`]). `None` if no valid texel has light.
    ///
    /// # Panics
    /// If there is not a value for each texel.
    pub fn local_light(&self, light: &[[f32; 3]], least: f64) -> Option<LocalLight> {
        assert_eq!(light.len(), self.of.len(), "a value for each texel");
        let mut sums = vec![0.0; self.sizes.len()];
        let mut all: Vec<f64> = Vec::with_capacity(light.len());
        for (texel, piece) in self.valid() {
            let light = mean_of_channels(light[texel]);
            sums[piece] += light;
            all.push(light);
        }
        let brightest = all.iter().copied().fold(0.0, f64::max);
        if brightest == 0.0 {
            return None;
        }
        // Of two in the middle the lesser: it asks for more.
        let middle = (all.len() - 1) / 2;
        let (_, &mut median, _) = all.select_nth_unstable_by(middle, f64::total_cmp);
        let floor = match median > 0.0 {
            true => VISIBLE_PART * median,
            false => VISIBLE_PART_OF_BRIGHTEST * brightest,
        };
        let floor = floor.max(least);
        let of_piece = |(sum, size): (&f64, &u32)| (sum / f64::from(*size)).max(floor);
        Some(LocalLight { floor, of_pieces: sums.iter().zip(&self.sizes).map(of_piece).collect() })
    }
}

impl LocalLight {
    /// That of the texels of a piece.
    pub(super) fn of(&self, piece: usize) -> f64 {
        self.of_pieces[piece]
    }
}

/// The mean of red, green and blue.
pub(super) fn mean_of_channels(light: [f32; 3]) -> f64 {
    light.iter().map(|&value| f64::from(value)).sum::<f64>() / 3.0
}

/// The texels beside one that lie in its cell.
fn neighbours(width: usize, texels: usize, texel: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (texel % width, texel / width);
    let left = (!x.is_multiple_of(CELL)).then(|| texel - 1);
    let right = (!(x + 1).is_multiple_of(CELL) && x + 1 < width).then_some(texel + 1);
    let up = (!y.is_multiple_of(CELL)).then(|| texel - width);
    let down = (!(y + 1).is_multiple_of(CELL) && texel + width < texels).then_some(texel + width);
    [left, right, up, down].into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_connected_and_end_with_their_cell() {
        // Two cells side by side: the first is cut in two by a column that is not valid, the second has
        // texels that touch by corners alone.
        let (width, height) = (32, 16);
        let is_valid = |x: usize, y: usize| match x {
            0..16 => x != 5,
            _ => (x, y) == (20, 3) || (x, y) == (21, 4),
        };
        let valid: Vec<bool> = (0..width * height).map(|i| is_valid(i % width, i / width)).collect();
        let pieces = Pieces::new(width, &valid);
        assert_eq!(pieces.sizes, [5 * 16, 10 * 16, 1, 1]);
        assert_eq!((pieces.of[0], pieces.of[6], pieces.of[5]), (Some(0), Some(1), None));
        // Without the cut, cells alone part texels: a tile of 40 × 20 has 3 × 2.
        assert_eq!(Pieces::new(40, &[true; 800]).sizes, [256, 256, 128, 64, 64, 32]);
    }

    #[test]
    fn local_light_is_the_mean_of_a_piece_or_the_floor() {
        // Pieces of light 3, 0.3 and 0.003: the median is 0.3, the floor 0.01.
        let valid: Vec<bool> = (0..48 * 16).map(|_| true).collect();
        let light: Vec<[f32; 3]> = (0..48 * 16)
            .map(|i| [3.0, 0.3, 0.003][i % 48 / 16])
            .map(|light: f32| [0.5 * light, light, 1.5 * light])
            .collect();
        let pieces = Pieces::new(48, &valid);
        let local = pieces.local_light(&light, 0.0).unwrap();
        let expected = [3.0, 0.3, 0.01];
        for (piece, expected) in expected.into_iter().enumerate() {
            assert!((local.of(piece) / expected - 1.0).abs() < 1e-6, "{local:?}");
        }
        // The least floor, and nothing without light.
        assert_eq!(pieces.local_light(&light, 0.05).unwrap().of(2), 0.05);
        assert!(pieces.local_light(&vec![[0.0; 3]; 48 * 16], 1.0).is_none());
        // Half black: by the brightest.
        let mut half = vec![[0.0; 3]; 48 * 16];
        half[0] = [6.0; 3];
        assert!((pieces.local_light(&half, 0.0).unwrap().floor - 0.02).abs() < 1e-9);
    }
}
