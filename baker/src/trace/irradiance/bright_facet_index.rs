//! From a hit back to the bright facets there, those of daylight and those of each light group.

use super::bright_facets::{BrightFacet, number_of};
use crate::trace::rays::Hit;

/// No facet.
const NONE: u32 = u32::MAX;

/// Which facets hold a point of a surface.
pub(crate) struct BrightFacetIndex {
    /// Per triangle and side, the index of its first facet in `from`, and the facets along an edge.
    sides: Vec<[(u32, u32); 2]>,
    /// Per facet of those sides, where its entries begin in `held`; one more at the end.
    from: Vec<u32>,
    held: Vec<FacetRef>,
}

/// A bright facet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FacetRef {
    /// Index of its list, as given to [`BrightFacetIndex::new`].
    pub list: u32,
    /// Its index in that list.
    pub facet: u32,
}

impl BrightFacetIndex {
    /// The index of several lists of facets, of a scene of so many triangles. (All cut a side in the same
    /// way.)
    pub(crate) fn new(triangles: usize, lists: &[&[BrightFacet]]) -> Self {
        let mut sides = vec![[(NONE, 0); 2]; if lists.is_empty() { 0 } else { triangles }];
        // How many each holds, one place further on; then their sums.
        let mut from = vec![0u32];
        for facet in lists.iter().copied().flatten() {
            let first_and_along = &mut sides[facet.triangle as usize][usize::from(facet.is_back)];
            if first_and_along.0 == NONE {
                *first_and_along = (from.len() as u32 - 1, facet.along);
                from.resize(from.len() + (facet.along * facet.along) as usize, 0);
            }
            from[(first_and_along.0 + facet.number) as usize + 1] += 1;
        }
        (1..from.len()).for_each(|i| from[i] += from[i - 1]);
        let mut next = from.clone();
        let mut held = vec![FacetRef { list: 0, facet: 0 }; from[from.len() - 1] as usize];
        for (list, facets) in lists.iter().enumerate() {
            for (i, facet) in facets.iter().enumerate() {
                let first = sides[facet.triangle as usize][usize::from(facet.is_back)].0;
                let next = &mut next[(first + facet.number) as usize];
                held[*next as usize] = FacetRef { list: list as u32, facet: i as u32 };
                *next += 1;
            }
        }
        BrightFacetIndex { sides, from, held }
    }

    /// The facets that hold a point of a surface, at most one of each list, in the order of the lists.
    pub(crate) fn at(&self, hit: &Hit, is_back: bool) -> &[FacetRef] {
        let Some(sides) = self.sides.get(hit.triangle as usize) else { return &[] };
        let (first, along) = sides[usize::from(is_back)];
        if first == NONE {
            return &[];
        }
        let cell = (first + number_of(along, hit.barycentric)) as usize;
        &self.held[self.from[cell] as usize..self.from[cell + 1] as usize]
    }
}
