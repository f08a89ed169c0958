//! After tracing, per layer: light is carried from valid texels into the gutter between charts.

use dataset::image::{Image, Mask};

/// Fills invalid texels within `distance` of valid ones (Chebyshev) with the mean of their filled 8-neighbours, ring by
/// ring. Linear in the layer's values, so layers may be dilated one by one and summed.
pub fn dilate(image: &mut Image, mask: &Mask, distance: u32) {
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
