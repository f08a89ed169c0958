//! Triangulation of the polygons of OBJ files, by clipping ears; concave ones too.

use glam::{DVec2, DVec3};

/// Corners looked at for one polygon at most, for each pair of its corners and in all. A simple polygon takes
/// about one for each pair. One that crosses itself in a thousand places could take one for every three of
/// its corners.
const MOST_PER_PAIR: u64 = 16;
const MOST_LOOKS: u64 = 1 << 28;

/// Cuts a simple polygon, nearly flat, into `corners.len() − 2` triangles of the same orientation. `out` gets
/// indices into `corners`. A polygon that crosses itself or has no area falls back to a fan for what is left
/// of it, and so does what takes too long. Gives whether it did without.
pub(super) fn triangulate(corners: &[DVec3], out: &mut Vec<[usize; 3]>) -> bool {
    if corners.len() < 3 {
        return true;
    }
    let mut outline = Outline::new(corners);
    while outline.left > 3 {
        let Some(ear) = outline.next_ear() else { break };
        out.push(outline.cut(ear));
    }
    let is_whole = outline.left == 3;
    let first = (0..corners.len()).find(|&i| !outline.is_cut(i)).unwrap_or(0);
    let (mut last, mut next) = (outline.next[first], outline.next[outline.next[first]]);
    while next != first {
        out.push([first, last, next]);
        (last, next) = (next, outline.next[next]);
    }
    is_whole
}

/// No corner.
const NONE: usize = usize::MAX;

/// What is left of a polygon: a ring of corners, seen against its normal.
struct Outline {
    points: Vec<DVec2>,
    /// How many corners are left.
    left: usize,
    /// Per corner, those beside it; `next` of one that is cut off is `NONE`.
    previous: Vec<usize>,
    next: Vec<usize>,
    /// The corners that were not convex at first.
    reflex: Vec<usize>,
    /// Per corner, what kept it from being an ear when it was last looked at: those beside it then, and the
    /// corner in its triangle.
    blocked: Vec<[usize; 3]>,
    /// Where the search for the next ear begins.
    start: usize,
    /// Corners that may still be looked at.
    looks: u64,
}

impl Outline {
    fn new(corners: &[DVec3]) -> Self {
        let n = corners.len();
        // Newell's normal; the plane is seen along its largest axis.
        let normal: DVec3 =
            (0..n).map(|i| (corners[i] - corners[0]).cross(corners[(i + 1) % n] - corners[0])).sum();
        let axis = normal.abs().max_position();
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let flip = if normal[axis] < 0.0 { -1.0 } else { 1.0 };
        let mut outline = Outline {
            points: corners.iter().map(|p| DVec2::new(p[u] * flip, p[v])).collect(),
            left: n,
            previous: (0..n).map(|i| (i + n - 1) % n).collect(),
            next: (0..n).map(|i| (i + 1) % n).collect(),
            reflex: Vec::new(),
            blocked: vec![[NONE; 3]; n],
            start: 0,
            looks: MOST_LOOKS.min(MOST_PER_PAIR * (n as u64).pow(2)),
        };
        outline.reflex = (0..n).filter(|&i| !outline.is_convex(i)).collect();
        outline
    }

    fn is_cut(&self, corner: usize) -> bool {
        self.next[corner] == NONE
    }

    /// Twice the area of a triangle of corners.
    fn turn(&self, a: usize, b: usize, c: usize) -> f64 {
        (self.points[b] - self.points[a]).perp_dot(self.points[c] - self.points[a])
    }

    fn is_convex(&self, corner: usize) -> bool {
        self.turn(self.previous[corner], corner, self.next[corner]) > 0.0
    }

    /// The next ear from the last one on; `None` if there is none, or if finding one takes too long.
    fn next_ear(&mut self) -> Option<usize> {
        let mut corner = self.start;
        for _ in 0..self.left {
            self.looks = self.looks.checked_sub(1)?;
            if self.is_ear(corner) {
                return Some(corner);
            }
            corner = self.next[corner];
        }
        None
    }

    /// An ear is a convex corner with no other corner in its triangle: it is enough to look for those that
    /// are not convex.
    fn is_ear(&mut self, b: usize) -> bool {
        if !self.is_convex(b) {
            return false;
        }
        let (a, c) = (self.previous[b], self.next[b]);
        let [before, after, inside] = self.blocked[b];
        if [before, after] == [a, c] && !self.is_cut(inside) {
            return false;
        }
        let triangle = [a, b, c].map(|q| self.points[q]);
        let low = triangle[0].min(triangle[1]).min(triangle[2]);
        let high = triangle[0].max(triangle[1]).max(triangle[2]);
        let mut i = 0;
        while let Some(&p) = self.reflex.get(i) {
            self.looks = self.looks.saturating_sub(1);
            if self.is_cut(p) {
                self.reflex.swap_remove(i);
                continue;
            }
            i += 1;
            let point = self.points[p];
            let is_inside = point.cmpge(low).all()
                && point.cmple(high).all()
                && !triangle.contains(&point)
                && self.turn(a, b, p) >= 0.0
                && self.turn(b, c, p) >= 0.0
                && self.turn(c, a, p) >= 0.0;
            if is_inside && !self.is_convex(p) {
                self.blocked[b] = [a, c, p];
                return false;
            }
        }
        true
    }

    /// Cuts off an ear.
    fn cut(&mut self, ear: usize) -> [usize; 3] {
        let (a, c) = (self.previous[ear], self.next[ear]);
        (self.next[a], self.previous[c], self.next[ear]) = (c, a, NONE);
        self.left -= 1;
        // Going on past the cut gives rounder triangles than a fan.
        self.start = c;
        [a, ear, c]
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
    fn thousands_of_corners_are_cut_by_ears() {
        // A star: ½ n r R sin(2π/n).
        let n = 2000;
        let corner = |i: usize| {
            let (radius, angle) = ([1.0, 0.25][i % 2], i as f64 * std::f64::consts::TAU / n as f64);
            DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.0)
        };
        let corners: Vec<DVec3> = (0..n).map(corner).collect();
        let area = 0.125 * n as f64 * (std::f64::consts::TAU / n as f64).sin();
        let (count, signed, absolute) = areas(&corners);
        assert_eq!(count, n - 2);
        assert!((signed - area).abs() < 1e-9 && (absolute - area).abs() < 1e-9, "{signed} {absolute}");
        assert!(triangulate(&corners, &mut Vec::new()));
        // And one that crosses itself everywhere.
        let corners: Vec<DVec3> = (0..n).map(|i| corner(i * 7919 * i % n)).collect();
        assert_eq!(areas(&corners).0, n - 2);
    }

    #[test]
    fn degenerate_polygons_do_not_hang() {
        assert_eq!(areas(&[DVec3::ZERO; 5]).0, 3);
        assert_eq!(areas(&[DVec3::ZERO, DVec3::X, DVec3::X * 2.0, DVec3::X * 3.0]).0, 2);
        assert_eq!(areas(&[DVec3::ZERO, DVec3::X]).0, 0);
    }
}
