//! Rays through the picture of a camera.

use crate::scene::Camera;
use glam::{DVec3, Vec2, Vec3};

/// The triangle of a ray that starts on none.
pub(crate) const NO_TRIANGLE: u32 = u32::MAX;

/// A camera ready to see: rays through its picture.
pub(crate) struct Lens {
    /// Where it stands, relative to the geometry's origin.
    pub origin: Vec3,
    forward: Vec3,
    /// To the right and upper edge of the picture, at distance 1.
    right: Vec3,
    up: Vec3,
    size: [u32; 2],
}

impl Lens {
    /// A camera for a picture of `size` pixels.
    pub(crate) fn new(camera: &Camera, origin: DVec3, size: [u32; 2]) -> Self {
        /// Nearer to straight up or down than this, +Y is no help.
        const STEEP: f64 = 0.9999;
        let forward = (camera.look_at - camera.position).normalize();
        let upwards = if forward.y.abs() < STEEP { DVec3::Y } else { DVec3::NEG_Z };
        let right = forward.cross(upwards).normalize();
        let half = (0.5 * camera.fov.to_radians()).tan();
        let up = right.cross(forward) * (half * f64::from(size[1]) / f64::from(size[0]));
        Lens {
            origin: (camera.position - origin).as_vec3(),
            forward: forward.as_vec3(),
            right: (right * half).as_vec3(),
            up: up.as_vec3(),
            size,
        }
    }

    /// The unit direction through a place in pixels; (0, 0) is the top left corner.
    pub(crate) fn direction(&self, place: Vec2) -> Vec3 {
        let x = 2.0 * place.x / self.size[0] as f32 - 1.0;
        let y = 1.0 - 2.0 * place.y / self.size[1] as f32;
        (self.forward + self.right * x + self.up * y).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_picture_is_upright_and_as_wide_as_asked_for() {
        let camera =
            Camera { name: "c".into(), position: DVec3::X, look_at: DVec3::new(1.0, 0.0, -5.0), fov: 90.0 };
        let lens = Lens::new(&camera, DVec3::X, [200, 100]);
        let near = |place: [f32; 2], expected: Vec3| {
            let found = lens.direction(Vec2::from_array(place));
            assert!((found - expected.normalize()).length() < 1e-6, "{place:?}: {found}");
        };
        assert_eq!(lens.origin, Vec3::ZERO);
        near([100.0, 50.0], Vec3::NEG_Z);
        near([0.0, 50.0], Vec3::new(-1.0, 0.0, -1.0));
        near([200.0, 0.0], Vec3::new(1.0, 0.5, -1.0));
        let down = Lens::new(&Camera { look_at: DVec3::new(1.0, -3.0, 0.0), ..camera }, DVec3::X, [9, 9]);
        assert!((down.direction(Vec2::splat(4.5)) - Vec3::NEG_Y).length() < 1e-6);
        assert!(down.up.z < 0.0, "north is up in a plan");
    }
}
