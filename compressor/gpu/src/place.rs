//! Where maps lie on the layers of one texture.

/// A rectangle's position: x, y, layer.
pub(crate) type Spot = [u32; 3];

/// Least and largest side of a layer.
const SIDES: [u32; 2] = [128, 2048];

/// Places rectangles, whose sides are multiples of 4 and at most 128, on layers. Gives the layers' side, their number, and each one's place.
pub(crate) fn place(sizes: &[[u32; 2]]) -> (u32, u32, Vec<Spot>) {
    let area: u64 = sizes.iter().map(|[width, height]| u64::from(width * height)).sum();
    let side = (area as f64).sqrt().ceil() as u32;
    let side = side.next_power_of_two().clamp(SIDES[0], SIDES[1]);
    // The highest first, from left to right on shelves; the order of those alike is kept.
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| std::cmp::Reverse(sizes[i][1]));
    let mut spots = vec![[0; 3]; sizes.len()];
    let ([mut x, mut y, mut layer], mut shelf) = ([0, 0, 0], 0);
    for i in order {
        let [width, height] = sizes[i];
        if x + width > side {
            (x, y, shelf) = (0, y + shelf, 0);
        }
        if y + height > side {
            (x, y, shelf) = (0, 0, 0);
            layer += 1;
        }
        spots[i] = [x, y, layer];
        x += width;
        shelf = shelf.max(height);
    }
    (side, layer + 1, spots)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_overlap_and_none_leaves_its_layer() {
        let sizes: Vec<[u32; 2]> =
            (0..900u32).map(|i| [4 + 4 * (i * 7 % 32), 4 + 4 * (i * 13 % 32)]).collect();
        for sizes in [&sizes[..], &sizes[..3], &[[128, 128]; 300], &[]] {
            let (side, layers, spots) = place(sizes);
            let mut taken = vec![false; (side * side * layers) as usize];
            for ([width, height], [x, y, layer]) in sizes.iter().zip(spots) {
                assert!(x + width <= side && y + height <= side && layer < layers);
                for (dx, dy) in (0..*height).flat_map(|dy| (0..*width).map(move |dx| (dx, dy))) {
                    let at = (layer * side * side + (y + dy) * side + x + dx) as usize;
                    assert!(!std::mem::replace(&mut taken[at], true), "({x}, {y})");
                }
            }
        }
    }
}
