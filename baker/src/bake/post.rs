//! After tracing, per layer: light is carried from valid texels into the gutter between charts.

use dataset::image::{Image, Mask};

/// Fills invalid texels within a distance of valid ones (Chebyshev) with the mean of their filled 8-neighbours, ring by ring. Linear
/// in the layer's values, so layers may be dilated one by one and summed. Which texels are filled from which is found once for all
/// images of one mask.
///
/// A texel k steps from a chart and more than k from any other is filled from the first alone: until its turn comes, what the other
/// has filled does not touch it. Charts are `distance` texels apart, so only texels halfway between two charts mix them, and those
/// nearest to a chart, which bilinear samples on it read, never do.
#[derive(Clone, Debug)]
pub struct Dilation {
    width: usize,
    height: usize,
    /// The texels to be filled, ring by ring, each with a bit per 8-neighbour that is filled before it.
    fills: Vec<(u32, u8)>,
}

impl Dilation {
    /// Finds what is filled from what, in time proportional to the mask.
    pub fn new(mask: &Mask, distance: u32) -> Self {
        let (width, height) = (mask.width, mask.height);
        let mut fills = Vec::new();
        let mut filled = mask.valid.clone();
        // The texels that were filled last; at first all valid ones.
        let mut ring: Vec<u32> = (0..(width * height) as u32).filter(|&i| filled[i as usize]).collect();
        let mut queued = mask.valid.clone();
        for _ in 0..distance {
            let mut next: Vec<u32> = Vec::new();
            for &texel in &ring {
                for (_, n) in neighbours(texel as usize, width, height) {
                    if !queued[n] {
                        queued[n] = true;
                        next.push(n as u32);
                    }
                }
            }
            next.sort_unstable();
            for &texel in &next {
                let near = neighbours(texel as usize, width, height).filter(|&(_, n)| filled[n]);
                fills.push((texel, near.fold(0, |bits, (bit, _)| bits | 1 << bit)));
            }
            next.iter().for_each(|&texel| filled[texel as usize] = true);
            ring = next;
        }
        Dilation { width, height, fills }
    }

    /// Fills them, in time proportional to their number.
    ///
    /// # Panics
    /// If the image is not of the mask's size.
    pub fn apply(&self, image: &mut Image) {
        assert_eq!((image.width, image.height), (self.width, self.height), "width and height of the image");
        for &(texel, bits) in &self.fills {
            let (mut sum, mut n) = ([0.0; 3], 0.0);
            for (_, source) in
                neighbours(texel as usize, self.width, self.height).filter(|(bit, _)| bits >> bit & 1 != 0)
            {
                let v = image.texels[source];
                (0..3).for_each(|c| sum[c] += v[c]);
                n += 1.0;
            }
            image.texels[texel as usize] = sum.map(|s| s / n);
        }
    }
}

/// The 8-neighbours of a texel on the page, row by row, each with its number from 0 to 7.
fn neighbours(texel: usize, width: usize, height: usize) -> impl Iterator<Item = (u8, usize)> {
    let (x, y) = (texel % width, texel / width);
    (0..9u8).filter(|&i| i != 4).filter_map(move |i| {
        let (nx, ny) = (x + usize::from(i % 3), y + usize::from(i / 3));
        // Both one too large, so that nothing falls below zero.
        let inside = (1..=width).contains(&nx) && (1..=height).contains(&ny);
        inside.then(|| (i - u8::from(i > 4), (ny - 1) * width + nx - 1))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What [`Dilation`] does, the plain way.
    fn dilate(image: &mut Image, mask: &Mask, distance: u32) {
        let (w, h) = (image.width, image.height);
        let mut filled = mask.valid.clone();
        for _ in 0..distance {
            let ring: Vec<(usize, [f32; 3])> = (0..w * h)
                .filter(|&i| !filled[i])
                .filter_map(|i| {
                    let (x, y) = (i % w, i / w);
                    let (mut sum, mut n) = ([0.0; 3], 0.0);
                    for ny in y.saturating_sub(1)..(y + 2).min(h) {
                        for nx in x.saturating_sub(1)..(x + 2).min(w) {
                            if filled[ny * w + nx] {
                                let v = image.texels[ny * w + nx];
                                (0..3).for_each(|c| sum[c] += v[c]);
                                n += 1.0;
                            }
                        }
                    }
                    (n > 0.0).then(|| (i, sum.map(|s| s / n)))
                })
                .collect();
            for (i, value) in ring {
                image.texels[i] = value;
                filled[i] = true;
            }
        }
    }

    #[test]
    fn light_reaches_as_far_as_asked_and_keeps_its_value() {
        let mut image = Image::black(9, 7);
        let mut mask = Mask { width: 9, height: 7, valid: vec![false; 63] };
        for x in 3..5 {
            mask.valid[3 * 9 + x] = true;
            image.texels[3 * 9 + x] = [2.0, 1.0, 0.5];
        }
        dilate(&mut image, &mask, 2);
        for y in 0..7usize {
            for x in 0..9usize {
                let near = y.abs_diff(3) <= 2 && (1..=6).contains(&x);
                let expected = if near { [2.0, 1.0, 0.5] } else { [0.0; 3] };
                assert_eq!(image.texels[y * 9 + x], expected, "({x}, {y})");
            }
        }
    }

    /// A repeatable number in [0, 1).
    fn random(i: u32) -> f32 {
        let x = (i ^ 0x9e37_79b9).wrapping_mul(0x85eb_ca6b);
        let x = (x ^ x >> 13).wrapping_mul(0xc2b2_ae35);
        ((x ^ x >> 16) >> 8) as f32 / (1 << 24) as f32
    }

    #[test]
    fn found_once_or_each_time_the_same_bits() {
        for (case, (width, height)) in [(1, 1), (1, 9), (13, 1), (31, 17), (64, 40)].into_iter().enumerate() {
            for density in [0.0, 0.01, 0.1, 0.7, 1.0] {
                let of = |i: usize, what: u32| random((i as u32 * 8 + what) * 5 + case as u32);
                let valid: Vec<bool> = (0..width * height).map(|i| of(i, 0) < density).collect();
                let mask = Mask { width, height, valid };
                let mut image = Image::black(width, height);
                for i in (0..width * height).filter(|&i| mask.valid[i]) {
                    image.texels[i] = [of(i, 1), of(i, 2) * 1e4, of(i, 3)];
                }
                for distance in 0..6 {
                    let (mut once, mut each) = (image.clone(), image.clone());
                    Dilation::new(&mask, distance).apply(&mut once);
                    dilate(&mut each, &mask, distance);
                    assert_eq!(once, each, "{width}x{height}, density {density}, distance {distance}");
                }
            }
        }
    }

    #[test]
    fn charts_do_not_bleed_into_texels_nearer_to_others() {
        // Two charts with ragged rims, everywhere at least `distance` empty texels apart.
        for distance in 2..7usize {
            let (width, height) = (40, 24);
            let mut mask = Mask { width, height, valid: vec![false; width * height] };
            let mut image = Image::black(width, height);
            let rim: Vec<usize> = (0..height).map(|y| 11 + (random(y as u32) * 3.0) as usize).collect();
            for (y, &rim) in rim.iter().enumerate() {
                for x in 0..width {
                    let chart = if x < rim { 0 } else { 1 };
                    if chart == 0 || x >= 13 + distance {
                        mask.valid[y * width + x] = true;
                        image.texels[y * width + x][chart] = 1.0;
                    }
                }
            }
            Dilation::new(&mask, distance as u32).apply(&mut image);
            let valid_of = |chart: usize| {
                (0..width * height)
                    .filter(|&i| mask.valid[i])
                    .filter(move |i| (i % width < 13) == (chart == 0))
            };
            let far = |i: usize, chart: usize| {
                let steps = |j: usize| (i % width).abs_diff(j % width).max((i / width).abs_diff(j / width));
                valid_of(chart).map(steps).min().unwrap()
            };
            for i in 0..width * height {
                let [near, other] = [far(i, 0), far(i, 1)];
                if near != other && near.min(other) <= distance {
                    let expected = if near < other { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
                    assert_eq!(image.texels[i], expected, "texel {i}, distance {distance}");
                }
            }
        }
    }
}
