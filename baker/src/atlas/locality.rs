//! The order in which surfaces are put on pages: what is near in space comes near in it, so that streaming
//! needs fewer tiles for a view.

use super::charts::{Chart, FlatMesh};
use glam::DVec3;

/// A piece of surface: a chart, or a shared layout where one of its members stands.
struct Piece {
    /// Metres.
    centre: DVec3,
    /// Area.
    weight: f64,
}

/// Per mesh, the rank of each chart (of each member, where it is shared) in the order of space.
pub(super) fn ranks(meshes: &[FlatMesh]) -> Vec<Vec<u32>> {
    let mut pieces: Vec<Piece> = Vec::new();
    for mesh in meshes {
        if mesh.is_shared() {
            let area: f64 = mesh.charts.iter().map(Chart::area).sum();
            let piece =
                |m: &super::sharing::Member| Piece { centre: m.centre, weight: area * m.scale.powi(2) };
            pieces.extend(mesh.members.iter().map(piece));
        } else {
            let piece = |chart: &Chart| Piece { centre: chart.centre, weight: chart.area() };
            pieces.extend(mesh.charts.iter().map(piece));
        }
    }
    let mut order: Vec<u32> = (0..pieces.len() as u32).collect();
    sort(&pieces, &mut order);
    let mut rank = vec![0; pieces.len()];
    order.iter().enumerate().for_each(|(r, &piece)| rank[piece as usize] = r as u32);
    let mut rest = rank.into_iter();
    let count = |mesh: &FlatMesh| if mesh.is_shared() { mesh.members.len() } else { mesh.charts.len() };
    meshes.iter().map(|mesh| rest.by_ref().take(count(mesh)).collect()).collect()
}

/// Halves the pieces by area across the axis along which they lie furthest apart, and so on with the halves.
fn sort(pieces: &[Piece], order: &mut [u32]) {
    if order.len() < 2 {
        return;
    }
    let (mut total, mut mean, mut square) = (0.0, DVec3::ZERO, DVec3::ZERO);
    for piece in order.iter().map(|&i| &pieces[i as usize]) {
        total += piece.weight;
        mean += piece.weight * piece.centre;
        square += piece.weight * piece.centre * piece.centre;
    }
    let spread = square * total - mean * mean;
    let axis = (0..3).fold(0, |widest, axis| if spread[axis] > spread[widest] { axis } else { widest });
    let value = |i: u32| pieces[i as usize].centre[axis];
    order.sort_unstable_by(|&a, &b| value(a).total_cmp(&value(b)).then(a.cmp(&b)));
    let mut sum = 0.0;
    let half = order.iter().position(|&i| {
        sum += pieces[i as usize].weight;
        sum >= 0.5 * total
    });
    // Not too far from the middle, so that the halves of halves are few whatever the areas.
    let (least, most) = (order.len().div_ceil(8), order.len() - order.len().div_ceil(8));
    let half = half.map_or(order.len() / 2, |i| i + 1).clamp(least, most.max(least)).min(order.len() - 1);
    let (low, high) = order.split_at_mut(half);
    sort(pieces, low);
    sort(pieces, high);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_near_in_space_is_near_in_the_order() {
        // Cells of a 16 × 16 × 4 grid, in a scrambled order: the quarters of the order are quarters of the
        // plan.
        let cell = |i: u32| DVec3::new(f64::from(i % 16), f64::from(i / 256), f64::from(i / 16 % 16));
        let pieces: Vec<Piece> =
            (0..1024u32).map(|i| Piece { centre: cell(i * 37 % 1024), weight: 1.0 }).collect();
        let mut order: Vec<u32> = (0..1024).collect();
        sort(&pieces, &mut order);
        for quarter in order.chunks(256) {
            let corner = |f: fn(f64, f64) -> f64, start| {
                quarter
                    .iter()
                    .map(|&i| pieces[i as usize].centre)
                    .fold(DVec3::splat(start), |a, p| DVec3::new(f(a.x, p.x), f(a.y, p.y), f(a.z, p.z)))
            };
            let size = corner(f64::max, f64::NEG_INFINITY) - corner(f64::min, f64::INFINITY);
            assert_eq!((size.x, size.z), (7.0, 7.0));
        }
        // Equal places do no harm.
        let equal: Vec<Piece> = (0..9).map(|_| Piece { centre: DVec3::ONE, weight: 0.0 }).collect();
        let mut order: Vec<u32> = (0..9).collect();
        sort(&equal, &mut order);
        assert_eq!(order, (0..9).collect::<Vec<_>>());
    }
}
