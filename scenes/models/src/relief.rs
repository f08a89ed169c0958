//! Sheets: welded grids with relief and holes. A sheet is one smooth connected surface, so that it becomes
//! one lightmap chart.

use crate::mesh::Mesh;
use glam::{DVec2, DVec3};
use std::collections::BTreeMap;

/// A grid over the coordinate lists `us` × `vs`, without the cells (i, j) for which `filled` is false, each
/// vertex at `place(u, v)`. The front looks along du × dv.
pub fn sheet(
    us: &[f64],
    vs: &[f64],
    filled: impl Fn(usize, usize) -> bool,
    place: impl Fn(f64, f64) -> DVec3,
) -> Mesh {
    let mut mesh = Mesh::default();
    let mut index = BTreeMap::new();
    for j in 0..vs.len() - 1 {
        for i in 0..us.len() - 1 {
            if !filled(i, j) {
                continue;
            }
            let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| {
                *index
                    .entry((i, j))
                    .or_insert_with(|| mesh.vertex(place(us[i], vs[j]), DVec2::new(us[i], -vs[j])))
            });
            mesh.triangles.push([a, b, c]);
            mesh.triangles.push([a, c, d]);
        }
    }
    mesh.smoothed()
}

/// A whole sheet without holes.
pub fn full(us: &[f64], vs: &[f64], place: impl Fn(f64, f64) -> DVec3) -> Mesh {
    sheet(us, vs, |_, _| true, place)
}

/// `count` + 1 numbers from `low` to `high`.
pub fn steps(low: f64, high: f64, count: usize) -> Vec<f64> {
    (0..=count).map(|i| low + (high - low) * i as f64 / count as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_looks_along_du_cross_dv() {
        let mesh = full(&steps(0.0, 1.0, 2), &steps(0.0, 1.0, 2), |u, v| DVec3::new(v, 0.0, u));
        assert!(mesh.normals.iter().all(|n| (*n - DVec3::Y).length() < 1e-12));
        assert_eq!((mesh.triangles.len(), mesh.positions.len()), (8, 9));
    }
}
