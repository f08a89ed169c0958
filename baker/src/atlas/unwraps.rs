//! How meshes come apart into charts, as bytes that outlive a layout: a mesh that is the same as before need
//! not be unwrapped again.

use glam::Vec2;

/// Names a mesh by all that decides how it comes apart: the digest of its triangles, and of how they are
/// unwrapped.
pub type Key = [u8; 32];

/// Bytes of a triangle of [`Unwrap::to_bytes`].
pub const TRIANGLE: usize = 4 + 6 * 4;

/// How the triangles of a mesh come apart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unwrap {
    /// Per triangle, what becomes of it.
    pub triangles: Vec<Unwrapped>,
}

/// What becomes of a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unwrapped {
    /// Its chart, below the number of triangles; `None` where it lies flat by itself.
    pub chart: Option<u32>,
    /// Its corners in the plane of the chart, in units of the chart's own.
    pub corners: [Vec2; 3],
}

impl Unwrapped {
    /// A triangle that lies flat by itself.
    pub const ALONE: Self = Unwrapped { chart: None, corners: [Vec2::ZERO; 3] };
}

/// Keeps unwraps from layout to layout. Meshes are asked for in any order, and several at once.
pub trait Unwraps: Sync {
    /// The unwrap of a mesh of `triangles` triangles, if it is kept.
    fn get(&self, key: &Key, triangles: usize) -> Option<Unwrap>;

    /// Takes an unwrap that was made because [`Unwraps::get`] had none.
    fn put(&self, key: &Key, unwrap: &Unwrap);
}

/// Keeps nothing.
#[derive(Clone, Copy, Debug)]
pub struct AlwaysUnwrap;

impl Unwraps for AlwaysUnwrap {
    fn get(&self, _: &Key, _: usize) -> Option<Unwrap> {
        None
    }

    fn put(&self, _: &Key, _: &Unwrap) {}
}

impl Unwrap {
    /// Per triangle the chart (u32, the largest one for none) and six coordinates (f32), little-endian.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(TRIANGLE * self.triangles.len());
        for triangle in &self.triangles {
            bytes.extend(triangle.chart.unwrap_or(u32::MAX).to_le_bytes());
            let numbers = triangle.corners.iter().flat_map(|corner| corner.to_array());
            numbers.for_each(|x| bytes.extend(x.to_le_bytes()));
        }
        bytes
    }

    /// What [`Unwrap::to_bytes`] gave; `None` for bytes that no unwrap of so many triangles gives.
    pub fn from_bytes(bytes: &[u8], triangles: usize) -> Option<Self> {
        if Some(bytes.len()) != triangles.checked_mul(TRIANGLE) {
            return None;
        }
        let triangle = |bytes: &[u8]| {
            let word = |i: usize| [0, 1, 2, 3].map(|k| bytes[4 * i + k]);
            let corner = |i| Vec2::new(f32::from_le_bytes(word(i)), f32::from_le_bytes(word(i + 1)));
            let chart = Some(u32::from_le_bytes(word(0))).filter(|&chart| chart != u32::MAX);
            Unwrapped { chart, corners: [corner(1), corner(3), corner(5)] }
        };
        let unwrap = Unwrap { triangles: bytes.chunks_exact(TRIANGLE).map(triangle).collect() };
        unwrap.is_possible().then_some(unwrap)
    }

    /// Whether every number is finite, every chart one of the mesh's, and every chart of some area.
    fn is_possible(&self) -> bool {
        let mut areas = vec![None; self.triangles.len()];
        for Unwrapped { chart, corners } in &self.triangles {
            if !corners.iter().all(|corner| corner.is_finite()) {
                return false;
            }
            let Some(chart) = chart else { continue };
            let Some(area) = areas.get_mut(*chart as usize) else { return false };
            let [a, b, c] = corners.map(|corner| corner.as_dvec2());
            *area = Some(area.unwrap_or(0.0) + (b - a).perp_dot(c - a).abs());
        }
        areas.into_iter().flatten().all(|area| area > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_give_back_an_unwrap_and_no_other_is_believed() {
        let corners = [Vec2::ZERO, Vec2::X, Vec2::new(0.25, -3.0)];
        let chart = |chart| Unwrapped { chart: Some(chart), corners };
        let unwrap = Unwrap { triangles: vec![chart(2), Unwrapped::ALONE, chart(0)] };
        let bytes = unwrap.to_bytes();
        assert_eq!(Unwrap::from_bytes(&bytes, 3), Some(unwrap.clone()));
        for triangles in [0, 2, 4, usize::MAX] {
            assert_eq!(Unwrap::from_bytes(&bytes, triangles), None);
        }
        let changed = |change: &dyn Fn(&mut Unwrapped)| {
            let mut unwrap = unwrap.clone();
            change(&mut unwrap.triangles[2]);
            Unwrap::from_bytes(&unwrap.to_bytes(), 3)
        };
        assert_eq!(changed(&|t| t.chart = Some(3)), None);
        assert_eq!(changed(&|t| t.corners[1].y = f32::NAN), None);
        assert_eq!(changed(&|t| t.corners[1].y = f32::INFINITY), None);
        assert_eq!(changed(&|t| t.corners = [Vec2::ONE; 3]), None);
        assert!(changed(&|t| t.chart = Some(1)).is_some());
    }
}
