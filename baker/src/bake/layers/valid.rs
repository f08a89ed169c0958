//! Which texels of a page are valid: covered by surface, not inside a solid, and reached by light in some
//! layer, or amid such texels. In a scene without any light the last does not count.
//!
//! Two-sided bodies bound no solids, because there may be light inside. Where they close a texel in, lit
//! texels in the open do not make it valid, only others that are closed in. Light that one of these found
//! alone does not count, nor does the faintest trace of the light outside: it came from a sample on an edge,
//! beyond the neighbouring face. Otherwise chance would decide for each instance anew.

use super::folder::{Layers, Texel};
use crate::Result;
use crate::atlas::owners::Owners;
use crate::bake::prepare::Part;
use dataset::image::Mask;
use std::ops::Range;

/// The valid texels of a page.
pub(crate) struct ValidTexels {
    /// On the virtual page.
    pub mask: Mask,
    /// Per covered texel, the sum of all layers.
    pub light: Vec<f32>,
    /// Covered texels that are not valid: too little of them is surface, the rest in solids or beyond a wall.
    pub buried: usize,
    /// Covered texels that are not valid: no light reaches them.
    pub unlit: usize,
    /// Valid texels that no light reaches in any layer.
    pub black: usize,
}

impl ValidTexels {
    /// Of the covered `texels` of a page of this size, by some layers of the folder: by all that is kept of
    /// them, so that the mask does not hang on which part of a light lightmaps hold.
    pub(crate) fn find<'l>(
        [width, height]: [usize; 2],
        owners: &Owners,
        texels: &[Texel],
        folder: &Layers,
        layers: impl Iterator<Item = (&'l String, &'static [Part])>,
    ) -> Result<Self> {
        let mut light = vec![0.0f32; texels.len()];
        for (digest, parts) in layers {
            let mut of_layer = vec![0.0f32; texels.len()];
            for &part in parts {
                folder.each(digest, part, |i, value| of_layer[i] += value.mean.element_sum())?;
            }
            add_layer(&mut light, texels, &of_layer);
        }
        Ok(Self::by_light((width, height), owners, texels, light))
    }

    /// Of the covered `texels` of a page of this size, each with this `light`.
    fn by_light((width, height): (usize, usize), owners: &Owners, texels: &[Texel], light: Vec<f32>) -> Self {
        let page_index = |i: usize| texels[i].index as usize;
        let usable = || (0..texels.len()).filter(|&i| texels[i].usable == 1);
        let mut mask = Mask { width, height, valid: vec![false; width * height] };
        let mut closed_in = Mask { width, height, valid: vec![false; width * height] };
        usable().filter(|&i| light[i] > 0.0).for_each(|i| mask.valid[page_index(i)] = true);
        usable().filter(|&i| texels[i].closed_in == 1).for_each(|i| closed_in.valid[page_index(i)] = true);
        let is_lit = mask.valid.contains(&true);
        let stray: Vec<usize> = usable()
            .map(page_index)
            .filter(|&i| closed_in.valid[i] && mask.valid[i] && has_stray_light(&mask, &closed_in, owners, i))
            .collect();
        stray.iter().for_each(|&i| mask.valid[i] = false);
        let mut dark: Vec<usize> = usable().filter(|&i| light[i] <= 0.0).map(page_index).collect();
        let unlit = stray.len() + dark.len();
        dark.retain(|&i| !is_lit || is_surrounded(&mask, &closed_in, owners, i));
        dark.iter().for_each(|&i| mask.valid[i] = true);
        let buried = texels.len() - usable().count();
        ValidTexels { mask, light, buried, unlit: unlit - dark.len(), black: dark.len() }
    }

    /// Per covered texel, whether it is valid.
    pub(crate) fn by_position(&self, texels: &[Texel]) -> Vec<bool> {
        texels.iter().map(|texel| self.mask.valid[texel.index as usize]).collect()
    }
}

/// Adds the light of a layer; at closed-in texels a trace is left out, as surfaces reflect it from where a
/// stray sample fell.
fn add_layer(light: &mut [f32], texels: &[Texel], of_layer: &[f32]) {
    /// Of the mean light of a layer in the open.
    const TRACE: f64 = 3e-6;
    let in_the_open =
        || texels.iter().zip(of_layer).filter(|(texel, _)| (texel.usable, texel.closed_in) == (1, 0));
    let sum: f64 = in_the_open().map(|(_, light)| f64::from(*light)).sum();
    let trace = TRACE * sum / in_the_open().count().max(1) as f64;
    for ((light, texel), of_layer) in light.iter_mut().zip(texels).zip(of_layer) {
        let is_trace = texel.closed_in == 1 && f64::from(*of_layer) <= trace;
        *light += if is_trace { 0.0 } else { *of_layer };
    }
}

/// Whether a closed-in texel has its light by a stray sample: none of those beside it, closed in and of the
/// same chart, has any. (Where light does get in, surfaces reflect it to most, and a lamp lights more than
/// one.)
fn has_stray_light(lit: &Mask, closed_in: &Mask, owners: &Owners, texel: usize) -> bool {
    let (x, y) = (texel % lit.width, texel / lit.width);
    let beside = |at: usize, size: usize| at.saturating_sub(1)..(at + 2).min(size);
    let (mut of, mut are_lit) = (0, 0);
    for row in beside(y, lit.height) {
        for column in beside(x, lit.width) {
            let i = row * lit.width + column;
            if i != texel && closed_in.valid[i] && owners.of(column, row) == owners.of(x, y) {
                of += 1;
                are_lit += usize::from(lit.valid[i]);
            }
        }
    }
    of > 0 && are_lit == 0
}

/// Whether valid texels lie in all four quadrants about a texel. Then it got no light by chance: to leave it
/// out, and keep the lucky ones about it, would make dim places as bright as these. (What is buried in
/// something has its lit neighbours on some sides.)
///
/// Only texels of the same chart count, or of none known; about one that is closed in only such.
fn is_surrounded(mask: &Mask, closed_in: &Mask, owners: &Owners, texel: usize) -> bool {
    /// Texels along the side of a quadrant.
    const SIDE: usize = 4;
    let (x, y) = (texel % mask.width, texel / mask.width);
    let [left, above] = [x, y].map(|c| c.saturating_sub(SIDE)..c);
    let right = x + 1..(x + 1 + SIDE).min(mask.width);
    let below = y + 1..(y + 1 + SIDE).min(mask.height);
    let own = owners.of(x, y);
    let counts = |x: usize, y: usize| {
        let i = y * mask.width + x;
        mask.valid[i] && owners.of(x, y) == own && (closed_in.valid[i] || !closed_in.valid[texel])
    };
    let holds = |columns: &Range<usize>, rows: &Range<usize>| {
        rows.clone().any(|y| columns.clone().any(|x| counts(x, y)))
    };
    [&left, &right].into_iter().all(|columns| [&above, &below].into_iter().all(|rows| holds(columns, rows)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atlas::Atlas;

    /// A page of 20 × 16 texels, all of them usable: which is lit, which is closed in.
    fn page(lit: fn(usize, usize) -> bool, closed_in: fn(usize, usize) -> bool) -> ValidTexels {
        let at = |i: usize| (i % 20, i / 20);
        let texel = |i: usize| {
            let (x, y) = at(i);
            Texel { index: i as u32, usable: 1, closed_in: u8::from(closed_in(x, y)), points: u16::MAX }
        };
        let texels: Vec<Texel> = (0..320).map(texel).collect();
        let light = (0..320).map(|i| f32::from(u8::from(lit(at(i).0, at(i).1)))).collect();
        let none = Owners::new(&Atlas::for_tests(20, 16, Vec::new()));
        ValidTexels::by_light((20, 16), &none, &texels, light)
    }

    #[test]
    fn what_two_sided_bodies_close_in_is_dark_for_a_reason() {
        // A post of three texels' width stands on a lit face, which goes on around it.
        fn post(x: usize, y: usize) -> bool {
            (8..11).contains(&x) && (6..9).contains(&y)
        }
        let lit = |x: usize, y: usize| !post(x, y);
        let open = page(lit, |_, _| false);
        assert_eq!((open.mask.count(), open.unlit, open.black), (320, 0, 9));
        let closed = page(lit, post);
        assert_eq!((closed.mask.count(), closed.unlit, closed.black), (311, 9, 0));
        assert!((0..320).all(|i| closed.mask.valid[i] != post(i % 20, i / 20)));
        // In a scene without light all count.
        let night = page(|_, _| false, post);
        assert_eq!((night.mask.count(), night.unlit, night.black), (320, 0, 320));
    }

    #[test]
    fn light_that_one_closed_in_texel_found_alone_is_a_mistake() {
        fn inside(x: usize, _: usize) -> bool {
            x < 10
        }
        // One of those inside is lit; two; a third of them, as in a dim room; all. Where one is dark there by
        // chance, lit ones about it are valid.
        type Lit = fn(usize, usize) -> bool;
        let cases: [(Lit, usize, usize); 4] = [
            (|x, y| x >= 10 || (x, y) == (4, 7), 160, 0),
            (|x, y| x >= 10 || (x, y) == (4, 7) || (x, y) == (5, 8), 162, 0),
            (|x, y| x >= 10 || (x + y).is_multiple_of(3), 278, 66),
            (|_, _| true, 320, 0),
        ];
        for (lit, valid, black) in cases {
            let found = page(lit, inside);
            assert_eq!((found.mask.count(), found.unlit, found.black), (valid, 320 - valid, black));
        }
        // A trace of the light in the open is none; what a lamp inside gives is.
        let at = |i: u32| Texel { index: i, usable: 1, closed_in: u8::from(i > 1), points: u16::MAX };
        let (texels, mut light) = ([0, 1, 2, 3].map(at), [0.0; 4]);
        add_layer(&mut light, &texels, &[90.0, 0.0, 1e-4, 2e-4]);
        assert_eq!(light, [90.0, 0.0, 0.0, 2e-4]);
        add_layer(&mut light, &texels, &[0.0, 0.0, 1e-9, 0.0]);
        assert_eq!(light, [90.0, 0.0, 1e-9, 2e-4]);
        // Of those in the open one is enough.
        assert_eq!(page(|x, y| (x, y) == (4, 7), |_, _| false).mask.count(), 1);
    }

    #[test]
    fn dark_texels_amid_lit_ones_are_told_from_buried_ones() {
        let mask = |valid: fn(usize, usize) -> bool| Mask {
            width: 20,
            height: 16,
            valid: (0..320).map(|i| valid(i % 20, i / 20)).collect(),
        };
        let at = |x: usize, y: usize| y * 20 + x;
        let none = Owners::new(&Atlas::for_tests(20, 16, Vec::new()));
        let open = mask(|_, _| false);
        // One in eight is lit; only beyond a line; around a block.
        let few = mask(|x, y| (x + 3 * y) % 8 == 0);
        assert!((5..15).all(|x| few.valid[at(x, 8)] || is_surrounded(&few, &open, &none, at(x, 8))));
        let line = mask(|x, y| x + y > 16);
        assert!((0..320).all(|i| line.valid[i] || !is_surrounded(&line, &open, &none, i)));
        let block = mask(|x, y| !(4..14).contains(&x) || !(3..13).contains(&y));
        assert!((0..320).all(|i| block.valid[i] || !is_surrounded(&block, &open, &none, i)));
        // At the page's corners there are no four quadrants.
        assert!(
            [at(0, 0), at(19, 0), at(0, 15), at(19, 15)]
                .iter()
                .all(|&i| !is_surrounded(&few, &open, &none, i))
        );
    }
}
