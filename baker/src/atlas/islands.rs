//! Connected pieces: of an authored layout, and of a surface.

use crate::geometry::Geometry;

/// Per triangle, the lowest place in the list of a triangle of its island. Triangles of one island are joined
/// by edges, that is, by two corners alike in position and lightmap coordinates.
pub(super) fn islands(geometry: &Geometry, triangles: &[u32]) -> Vec<usize> {
    joined(triangles.len(), |i, k| {
        let v = geometry.triangles[triangles[i] as usize][k] as usize;
        let (p, uv) = (geometry.positions[v], geometry.lightmap_uvs[v]);
        [p.x, p.y, p.z, uv.x, uv.y]
    })
}

/// The same for triangles that lie on pages already: corners are alike where they are so in position, page
/// and place on it. `at` gives page, u and v of a corner of the triangle at a place in the list.
pub(super) fn laid_islands(
    geometry: &Geometry,
    triangles: &[u32],
    at: impl Fn(usize, usize) -> [f32; 3],
) -> Vec<usize> {
    joined(triangles.len(), |i, k| {
        let p = geometry.corners(triangles[i] as usize)[k];
        let [page, u, v] = at(i, k);
        [p.x, p.y, p.z, page, u, v]
    })
}

/// Per triangle, the lowest place in the list of a triangle of its piece of surface: joined by edges in
/// space.
pub(super) fn surfaces(geometry: &Geometry, triangles: &[u32]) -> Vec<usize> {
    joined(triangles.len(), |i, k| geometry.corners(triangles[i] as usize)[k].to_array())
}

/// Per triangle of so many, the lowest place of one that edges join it to. Corners (of a triangle, from 0
/// to 2) are one where their keys are equal.
fn joined<const N: usize>(triangles: usize, key: impl Fn(usize, usize) -> [f32; N]) -> Vec<usize> {
    let mut edges = Vec::with_capacity(3 * triangles);
    for i in 0..triangles {
        let v = [0, 1, 2].map(|k| key(i, k).map(|x| (x + 0.0).to_bits()));
        edges.extend([(0, 1), (1, 2), (2, 0)].map(|(a, b)| (v[a].min(v[b]), v[a].max(v[b]), i)));
    }
    edges.sort_unstable();
    let mut island: Vec<usize> = (0..triangles).collect();
    fn root(island: &mut [usize], mut i: usize) -> usize {
        while island[i] != i {
            island[i] = island[island[i]];
            i = island[i];
        }
        i
    }
    for pair in edges.windows(2).filter(|pair| pair[0].0 == pair[1].0 && pair[0].1 == pair[1].1) {
        let (a, b) = (root(&mut island, pair[0].2), root(&mut island, pair[1].2));
        island[a.max(b)] = a.min(b);
    }
    (0..triangles).map(|i| root(&mut island, i)).collect()
}
