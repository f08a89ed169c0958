//! Triangulation of the polygons of OBJ files, by clipping ears; concave ones too.

use glam::{DVec2, DVec3};

/// Cuts a simple polygon, nearly flat, into `corners.len() − 2` triangles of the same orientation. `out` gets
/// indices into `corners`. A polygon that crosses itself or has no area falls back to a fan for what is left
/// of it.
pub(super) fn triangulate(corners: &[DVec3], out: &mut Vec<[usize; 3]>) {
    if corners.len() < 3 {
        return;
    }
    // Newell's normal; the plane is seen along its largest axis.
    let normal: DVec3 = (0..corners.len())
        .map(|i| (corners[i] - corners[0]).cross(corners[(i + 1) % corners.len()] - corners[0]))
        .sum();
    let axis = normal.abs().max_position();
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let flip = if normal[axis] < 0.0 { -1.0 } else { 1.0 };
    let points: Vec<DVec2> = corners.iter().map(|p| DVec2::new(p[u] * flip, p[v])).collect();
    let turn = |a: usize, b: usize, c: usize| (points[b] - points[a]).perp_dot(points[c] - points[a]);

    let mut left: Vec<usize> = (0..corners.len()).collect();
    let mut start = 0;
    while left.len() > 3 {
        let n = left.len();
        // An ear is a convex corner with no other corner in its triangle.
        let ear = (0..n).map(|k| (start + k) % n).find(|&i| {
            let (a, b, c) = (left[(i + n - 1) % n], left[i], left[(i + 1) % n]);
            turn(a, b, c) > 0.0
                && left.iter().filter(|&&p| p != a && p != b && p != c).all(|&p| {
                    let inside = turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0;
                    !inside || [a, b, c].iter().any(|&q| points[q] == points[p])
                })
        });
        let Some(i) = ear else { break };
        out.push([left[(i + n - 1) % n], left[i], left[(i + 1) % n]]);
        left.remove(i);
        // Going on past the cut gives rounder triangles than a fan.
        start = i % left.len();
    }
    for i in 1..left.len() - 1 {
        out.push([left[0], left[i], left[i + 1]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Signed area of the triangles against the polygon's normal, and of their absolute values.
    fn areas(corners: &[DVec3]) -> (usize, f64, f64) {
        let mut triangles = Vec::new();
        triangulate(corners, &mut triangles);
        let area =
            |[a, b, c]: &[usize; 3]| 0.5 * (corners[*b] - corners[*a]).cross(corners[*c] - corners[*a]);
        let sum: DVec3 = triangles.iter().map(area).sum();
        (triangles.len(), sum.length(), triangles.iter().map(|t| area(t).length()).sum())
    }

    #[test]
    fn concave_polygons_are_covered_once() {
        let l = [(0., 0.), (3., 0.), (3., 1.), (1., 1.), (1., 3.), (0., 3.)];
        let arrow = [(0., 0.), (2., 1.), (0., 2.), (1., 1.)];
        for (outline, area) in [(&l[..], 5.0), (&arrow[..], 1.0)] {
            for shift in 0..outline.len() {
                // Tilted plane, both orientations.
                let mut corners: Vec<DVec3> =
                    outline.iter().map(|&(x, y)| DVec3::new(x, 0.5 * x + 0.25 * y, y)).collect();
                corners.rotate_left(shift);
                let scale = DVec3::new(1., 0.5, 0.).cross(DVec3::new(0., 0.25, 1.)).length();
                for _ in 0..2 {
                    let (count, signed, absolute) = areas(&corners);
                    assert_eq!(count, outline.len() - 2);
                    assert!((signed - area * scale).abs() < 1e-12 && (absolute - signed).abs() < 1e-12);
                    corners.reverse();
                }
            }
        }
    }

    #[test]
    fn degenerate_polygons_do_not_hang() {
        assert_eq!(areas(&[DVec3::ZERO; 5]).0, 3);
        assert_eq!(areas(&[DVec3::ZERO, DVec3::X, DVec3::X * 2.0, DVec3::X * 3.0]).0, 2);
        assert_eq!(areas(&[DVec3::ZERO, DVec3::X]).0, 0);
    }
}
