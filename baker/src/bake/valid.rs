//! Which texels of a page are valid: covered by surface, not inside a solid, and reached by light in some
//! layer, or amid such texels. In a scene without any light the last does not count.

use super::layers::{Layers, Part, Texel};
use crate::Result;
use crate::atlas::Atlas;
use crate::atlas::owners::Owners;
use dataset::image::Mask;
use std::ops::Range;

/// The valid texels of a page.
pub struct ValidTexels {
    /// On the virtual page.
    pub mask: Mask,
    /// Per covered texel, the sum of all layers.
    pub light: Vec<f32>,
    /// Covered texels that are not valid: too little of them is surface, the rest in solids or beyond a wall.
    pub buried: usize,
    /// Covered texels that are not valid: no light reaches them.
    pub unlit: usize,
}

impl ValidTexels {
    /// Of the covered `texels`, by some layers of the folder: by all that is kept of them, so that the mask
    /// does not hang on which part of a light lightmaps hold.
    pub fn find<'l>(
        atlas: &Atlas,
        owners: &Owners,
        texels: &[Texel],
        folder: &Layers,
        layers: impl Iterator<Item = (&'l String, &'static [Part])>,
    ) -> Result<Self> {
        let mut light = vec![0.0f32; texels.len()];
        for (digest, parts) in layers {
            for &part in parts {
                folder.each(digest, part, |i, value| light[i] += value.mean.element_sum())?;
            }
        }
        let (width, height) = (atlas.width as usize, atlas.height as usize);
        let page_index = |i: usize| texels[i].index as usize;
        let mut mask = Mask { width, height, valid: vec![false; width * height] };
        let (mut buried, mut is_lit, mut dark) = (0, false, Vec::new());
        for i in 0..texels.len() {
            match (texels[i].usable == 1, light[i] > 0.0) {
                (false, _) => buried += 1,
                (true, false) => dark.push(page_index(i)),
                (true, true) => {
                    is_lit = true;
                    mask.valid[page_index(i)] = true;
                }
            }
        }
        let of_dark = dark.len();
        dark.retain(|&i| !is_lit || is_surrounded(&mask, owners, i));
        dark.iter().for_each(|&i| mask.valid[i] = true);
        let unlit = of_dark - dark.len();
        Ok(ValidTexels { mask, light, buried, unlit })
    }

    /// Per covered texel, whether it is valid.
    pub fn by_position(&self, texels: &[Texel]) -> Vec<bool> {
        texels.iter().map(|texel| self.mask.valid[texel.index as usize]).collect()
    }
}

/// Whether valid texels lie in all four quadrants about a texel. Then it got no light by chance: to leave it
/// out, and keep the lucky ones about it, would make dim places as bright as these. (What is buried in
/// something has its lit neighbours on some sides.)
///
/// Only texels of the same chart count, or of none known.
fn is_surrounded(mask: &Mask, owners: &Owners, texel: usize) -> bool {
    /// Texels along the side of a quadrant.
    const SIDE: usize = 4;
    let (x, y) = (texel % mask.width, texel / mask.width);
    let [left, above] = [x, y].map(|c| c.saturating_sub(SIDE)..c);
    let right = x + 1..(x + 1 + SIDE).min(mask.width);
    let below = y + 1..(y + 1 + SIDE).min(mask.height);
    let own = owners.of(x, y);
    let counts = |x: usize, y: usize| mask.valid[y * mask.width + x] && owners.of(x, y) == own;
    let holds = |columns: &Range<usize>, rows: &Range<usize>| {
        rows.clone().any(|y| columns.clone().any(|x| counts(x, y)))
    };
    [&left, &right].into_iter().all(|columns| [&above, &below].into_iter().all(|rows| holds(columns, rows)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dark_texels_amid_lit_ones_are_told_from_buried_ones() {
        let mask = |valid: fn(usize, usize) -> bool| Mask {
            width: 20,
            height: 16,
            valid: (0..320).map(|i| valid(i % 20, i / 20)).collect(),
        };
        let at = |x: usize, y: usize| y * 20 + x;
        let none = Owners::new(&Atlas::for_tests(20, 16, Vec::new()));
        // One in eight is lit; only beyond a line; around a block.
        let few = mask(|x, y| (x + 3 * y) % 8 == 0);
        assert!((5..15).all(|x| few.valid[at(x, 8)] || is_surrounded(&few, &none, at(x, 8))));
        let line = mask(|x, y| x + y > 16);
        assert!((0..320).all(|i| line.valid[i] || !is_surrounded(&line, &none, i)));
        let block = mask(|x, y| !(4..14).contains(&x) || !(3..13).contains(&y));
        assert!((0..320).all(|i| block.valid[i] || !is_surrounded(&block, &none, i)));
        // At the page's corners there are no four quadrants.
        assert!([at(0, 0), at(19, 0), at(0, 15), at(19, 15)].iter().all(|&i| !is_surrounded(&few, &none, i)));
    }
}
