//! Whether anything stands on a piece of flat surface: answered once for many points, without rays.

use super::space::{Receiver, Space};
use glam::{DVec3, Vec3};

/// Axes along a flat surface, the third one its normal, about a point of it.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceAxes {
    origin: Vec3,
    axes: [DVec3; 3],
}

impl SurfaceAxes {
    /// The axes of a point's surface; its first axis runs along `along` as far as the surface allows. `None`
    /// where that is nowhere.
    pub fn new(at: &Receiver, along: Vec3) -> Option<Self> {
        let normal = at.face_normal.as_dvec3().try_normalize()?;
        let u = along.as_dvec3().reject_from_normalized(normal).try_normalize()?;
        Some(SurfaceAxes { origin: at.origin, axes: [u, normal.cross(u), normal] })
    }

    /// Where a point lies along the axes, in metres.
    pub fn coordinates_of(&self, at: &Receiver) -> DVec3 {
        self.coordinates(at.origin)
    }

    fn coordinates(&self, at: Vec3) -> DVec3 {
        let from = at.as_dvec3() - self.origin.as_dvec3();
        DVec3::from_array(self.axes.map(|axis| axis.dot(from)))
    }
}

impl Space<'_> {
    /// Whether points lie on a flat surface, nothing stands between any two of them, nor on the surface
    /// around them up to a height of `headroom` times its longer side. If it holds, [`Space::sees`] does for
    /// every two of the points. False where nothing is known.
    pub fn is_clear<'p>(
        &self,
        axes: &SurfaceAxes,
        points: impl Iterator<Item = &'p Receiver>,
        headroom: f32,
    ) -> bool {
        /// Cosine of the angle by which normals of a flat surface differ at most: 2.6°.
        const FLAT: f64 = 0.999;
        /// How far rays stray from the line between two points, relative to its length: eight roundings.
        const STRAY: f64 = 4.0 * f32::EPSILON as f64;
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for point in points {
            if point.face_normal.as_dvec3().dot(axes.axes[2]) < FLAT {
                return false;
            }
            let at = axes.coordinates_of(point);
            (low, high) = (low.min(at), high.max(at));
        }
        let size = high - low;
        let side = size.x.max(size.y);
        if !(size.is_finite() && size.z <= side) {
            return false;
        }
        let stray = STRAY * size.max_element();
        (low, high) = (low - stray, high + stray);
        high.z += f64::from(headroom) * side;
        let [u, v, n] = axes.axes;
        let middle = 0.5 * (low + high);
        let middle = axes.origin.as_dvec3() + u * middle.x + v * middle.y + n * middle.z;
        let half = 0.5 * (high - low);
        let half = u.abs() * half.x + v.abs() * half.y + n.abs() * half.z;
        // (Rounded outwards.)
        let rounding = (middle.abs() + half) * f64::from(f32::EPSILON);
        let (from, to) = ((middle - half - rounding).as_vec3(), (middle + half + rounding).as_vec3());
        // A triangle stands in the way unless it lies beside the surface, over it, or below all points, as
        // the surface itself does.
        !self.ray_tracer.any_in_box(from, to, |_, corners| {
            let [a, b, c] = corners.map(|corner| axes.coordinates(corner));
            a.min(b).min(c).cmple(high).all() && a.max(b).max(c).cmpge(low).all()
        })
    }
}
