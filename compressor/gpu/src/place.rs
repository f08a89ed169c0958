//! Where maps lie on the layers of one texture.

use ndgi::model::STORED;

/// A rectangle's position: x, y, layer.
pub(crate) type Spot = [u32; 3];

/// Where a tile lies on the device.
#[derive(Clone, Debug, Default)]
pub(crate) struct Site {
    /// Where its part of the resident buffer begins, in words.
    pub resident: u32,
    /// Where its part of the interval's buffer begins, in words.
    pub interval: u32,
    /// Its maps of BC7, in the order of [`maps`](crate::survey::maps).
    pub maps: Vec<Spot>,
}

/// Least and largest side of a layer.
const SIDES: [u32; 2] = [128, 2048];

/// Places rectangles, whose sides are multiples of 4 and at most 128, on layers. Gives the layers' side,
/// their number, and each one's place.
pub(crate) fn place(sizes: &[[u32; 2]]) -> (u32, u32, Vec<Spot>) {
    let area: u64 = sizes.iter().map(|[width, height]| u64::from(width * height)).sum();
    let side = (area as f64).sqrt().ceil() as u32;
    let side = side.next_power_of_two().clamp(SIDES[0], SIDES[1]);
    let (_, spots) = pack(sizes, [side; 2]);
    (side, spots.iter().map(|spot| spot[2]).max().unwrap_or(0) + 1, spots)
}

/// Places a tile's maps together, on one layer 128 texels wide. Gives the width and height that they take,
/// and each one's place.
pub(crate) fn shelves(sizes: &[[u32; 2]]) -> ([u32; 2], Vec<Spot>) {
    pack(sizes, [STORED as u32, u32::MAX])
}

/// Places rectangles on layers, the highest first, from left to right on shelves; the order of those alike is
/// kept. Gives the width and height that they take, and each one's place.
fn pack(sizes: &[[u32; 2]], [across, down]: [u32; 2]) -> ([u32; 2], Vec<Spot>) {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| std::cmp::Reverse(sizes[i][1]));
    let (mut spots, mut used) = (vec![[0; 3]; sizes.len()], [0; 2]);
    let ([mut x, mut y, mut layer], mut shelf) = ([0, 0, 0], 0);
    for i in order {
        let [width, height] = sizes[i];
        if x + width > across {
            (x, y, shelf) = (0, y + shelf, 0);
        }
        if y + height > down {
            (x, y, shelf) = (0, 0, 0);
            layer += 1;
        }
        spots[i] = [x, y, layer];
        x += width;
        shelf = shelf.max(height);
        used = [used[0].max(x), used[1].max(y + height)];
    }
    (used, spots)
}

/// Rectangles of one size on layers, row by row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lattice {
    size: [u32; 2],
    columns: u32,
    rows: u32,
    layers: u32,
}

impl Lattice {
    /// For this many rectangles: as few layers as there can be, with sides of at most `most` if a rectangle's
    /// allow it, and about square.
    pub(crate) fn new(size: [u32; 2], count: u32, most: u32) -> Self {
        let size = size.map(|side| side.max(4));
        let [across, down] = size.map(|side| (most / side).max(1));
        let layers = count.div_ceil(across * down).max(1);
        let each = count.div_ceil(layers).max(1);
        let square = (f64::from(each) * f64::from(size[1]) / f64::from(size[0])).sqrt().ceil() as u32;
        let columns = square.clamp(each.div_ceil(down), across.min(each));
        Lattice { size, columns, rows: each.div_ceil(columns), layers }
    }

    /// Width, height and number of the layers.
    pub(crate) fn extent(&self) -> [u32; 3] {
        [self.columns * self.size[0], self.rows * self.size[1], self.layers]
    }

    /// Where a rectangle lies.
    pub(crate) fn spot(&self, i: u32) -> Spot {
        let (layer, i) = (i / (self.columns * self.rows), i % (self.columns * self.rows));
        [i % self.columns * self.size[0], i / self.columns * self.size[1], layer]
    }
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

    #[test]
    fn slots_do_not_overlap_and_take_as_few_layers_as_there_can_be() {
        for (size, count, most) in
            [([128, 224], 300, 2048), ([128, 512], 7, 2048), ([52, 60], 1, 2048), ([128, 4096], 5, 2048)]
        {
            let lattice = Lattice::new(size, count, most);
            let [width, height, layers] = lattice.extent();
            let each = (most / size[0]).max(1) * (most / size[1]).max(1);
            assert_eq!(layers, count.div_ceil(each));
            assert!(width <= most && (height <= most || size[1] > most), "{width} × {height}");
            // No more than a row of them is left over.
            let room = width / size[0] * (height / size[1]) * layers;
            assert!((count..count + layers * (width / size[0])).contains(&room), "{room} for {count}");
            let mut spots: Vec<Spot> = (0..count).map(|i| lattice.spot(i)).collect();
            for [x, y, layer] in &spots {
                assert!(x + size[0] <= width && y + size[1] <= height && *layer < layers);
                assert!(x % size[0] == 0 && y % size[1] == 0);
            }
            spots.sort_unstable();
            spots.dedup();
            assert_eq!(spots.len(), count as usize);
        }
        assert_eq!(Lattice::new([0, 0], 3, 2048).extent()[2], 1);
    }
}
