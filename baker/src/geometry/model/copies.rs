//! Triangles of a mesh that are the same as others, corner by corner.

use super::Mesh;

/// Most equal surfaces in one place: as many panes as rays can tell apart there. Fewer are left alone, since
/// without its copy of a face that two bodies share, one of them would not be closed.
pub(in crate::geometry) const MOST_COPIES: usize = 8;

/// Numbers of a corner: position, normal, colour and three pairs of coordinates.
const NUMBERS: usize = 16;

/// Drops triangles beyond the first [`MOST_COPIES`] that are equal, to the bit, in all that the baker reads
/// of their corners, and run the same way round. Gives how many it dropped.
pub(super) fn remove(mesh: &mut Mesh) -> usize {
    remove_beyond(mesh, MOST_COPIES)
}

fn remove_beyond(mesh: &mut Mesh, most: usize) -> usize {
    // Those of different positions soon differ; few are left to be compared.
    let mixed = |v: u32| {
        let [x, y, z] = mesh.positions[v as usize].to_array().map(|x| u64::from(x.to_bits()));
        (x ^ y << 21 ^ z << 42).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ z.wrapping_mul(0xbf58_476d_1ce4_e5b9)
    };
    let of_triangle = |t: &[u32; 3]| t.iter().fold(0, |sum: u64, &v| sum.wrapping_add(mixed(v)));
    let mut order: Vec<(u64, u32)> = mesh.triangles.iter().map(of_triangle).zip(0..).collect();
    order.sort_unstable();
    let mut is_copy = vec![false; mesh.triangles.len()];
    let mut copies = 0;
    for alike in order.chunk_by(|a, b| a.0 == b.0).filter(|alike| alike.len() > most) {
        let corners =
            |&(_, triangle): &(u64, u32)| (corners(mesh, mesh.triangles[triangle as usize]), triangle);
        let mut alike: Vec<_> = alike.iter().map(corners).collect();
        alike.sort_unstable();
        for equal in alike.chunk_by(|a, b| a.0 == b.0) {
            for &(_, triangle) in equal.iter().skip(most) {
                is_copy[triangle as usize] = true;
                copies += 1;
            }
        }
    }
    if copies > 0 {
        let mut is_copy = is_copy.into_iter();
        mesh.triangles.retain(|_| !is_copy.next().unwrap_or(false));
    }
    copies
}

/// The numbers of a triangle's corners, the least corner first.
fn corners(mesh: &Mesh, triangle: [u32; 3]) -> [[u32; NUMBERS]; 3] {
    let of_vertex = |v: u32| {
        let v = v as usize;
        let mut numbers = [0; NUMBERS];
        let mut put = |first: usize, values: &[f32]| {
            numbers[first..].iter_mut().zip(values).for_each(|(number, value)| *number = value.to_bits());
        };
        put(0, &mesh.positions[v].to_array());
        mesh.normals.get(v).into_iter().for_each(|normal| put(3, &normal.to_array()));
        mesh.colours.get(v).into_iter().for_each(|colour| put(6, &colour.to_array()));
        mesh.uvs.get(v).into_iter().for_each(|uv| put(10, &uv.to_array()));
        mesh.emission_uvs.get(v).into_iter().for_each(|uv| put(12, &uv.to_array()));
        mesh.lightmap_uvs.get(v).into_iter().for_each(|uv| put(14, &uv.to_array()));
        numbers
    };
    let [a, b, c] = triangle.map(of_vertex);
    [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap_or([a, b, c])
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec2, Vec3};

    #[test]
    fn copies_go_and_what_differs_stays() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        let positions = [corners, corners].concat();
        // The same by index, turned and by place; the other way round; another.
        let triangles = vec![[0, 1, 2], [1, 2, 0], [4, 5, 6], [0, 2, 1], [0, 1, 3], [0, 1, 2]];
        let mesh = Mesh { positions, triangles, ..Default::default() };
        for (most, left) in [(1, &[0, 3, 4][..]), (2, &[0, 1, 3, 4]), (8, &[0, 1, 2, 3, 4, 5])] {
            let mut dropped = mesh.clone();
            assert_eq!(remove_beyond(&mut dropped, most), 6 - left.len());
            assert_eq!(dropped.triangles, left.iter().map(|&i| mesh.triangles[i]).collect::<Vec<_>>());
        }
        // By place, but with texture coordinates of its own.
        let uvs = (0..8).map(|v| Vec2::splat(v as f32)).collect();
        let mut mesh = Mesh { uvs, ..mesh };
        assert_eq!(remove_beyond(&mut mesh, 1), 2);
        assert_eq!(mesh.triangles, [[0, 1, 2], [4, 5, 6], [0, 2, 1], [0, 1, 3]]);
    }
}
