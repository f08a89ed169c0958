//! Connected pieces: of an authored layout, and of a surface.

use crate::geometry::Geometry;

/// Per triangle, the lowest place in the list of a triangle of its island. Triangles of one island are joined by edges, that is, by two
/// corners alike in position and lightmap coordinates.
pub fn islands(geometry: &Geometry, triangles: &[u32]) -> Vec<usize> {
    joined(geometry, triangles, |v| {
        let (p, uv) = (geometry.positions[v as usize], geometry.lightmap_uvs[v as usize]);
        [p.x, p.y, p.z, uv.x, uv.y]
    })
}

/// Per triangle, the lowest place in the list of a triangle of its piece of surface: joined by edges in space.
pub fn surfaces(geometry: &Geometry, triangles: &[u32]) -> Vec<usize> {
    joined(geometry, triangles, |v| geometry.positions[v as usize].to_array())
}

/// Per triangle, the lowest place of one that edges join it to. Corners are one where their keys are equal.
fn joined<const N: usize>(
    geometry: &Geometry,
    triangles: &[u32],
    key: impl Fn(u32) -> [f32; N],
) -> Vec<usize> {
    let bits = |v: u32| key(v).map(|x| (x + 0.0).to_bits());
    let mut edges = Vec::with_capacity(3 * triangles.len());
    for (i, &triangle) in triangles.iter().enumerate() {
        let v = geometry.triangles[triangle as usize].map(bits);
        edges.extend([(0, 1), (1, 2), (2, 0)].map(|(a, b)| (v[a].min(v[b]), v[a].max(v[b]), i)));
    }
    edges.sort_unstable();
    let mut island: Vec<usize> = (0..triangles.len()).collect();
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
    (0..triangles.len()).map(|i| root(&mut island, i)).collect()
}
