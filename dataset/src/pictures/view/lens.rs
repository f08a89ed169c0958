//! Where a picture is seen from.

use crate::format::Config;
use glam::{DMat4, DVec3, DVec4};
use serde::{Deserialize, Serialize};

/// A viewpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Its name in the scene, unique there.
    pub name: String,
    /// World.
    pub position: DVec3,
    /// The point in the middle of the picture, world; another one than `position`.
    pub look_at: DVec3,
    /// Angle of view across the picture, from left to right, in degrees.
    pub fov: f64,
}

impl Camera {
    /// Angle of view where none is given, in degrees.
    pub const FOV: f64 = 60.0;

    /// Those of the scene file that was baked, which a dataset's manifest keeps.
    pub fn of_manifest(config: &Config) -> impl Iterator<Item = Camera> {
        let cameras = config.settings["cameras"].as_array().into_iter().flatten();
        let cameras = cameras.filter_map(|camera| serde_json::from_value::<Camera>(camera.clone()).ok());
        cameras.filter(Camera::is_usable)
    }

    /// Whether it sees anything at all: finite, and looking somewhere.
    pub(super) fn is_usable(&self) -> bool {
        let is_finite = self.position.is_finite() && self.look_at.is_finite();
        is_finite
            && (self.look_at - self.position).length_squared() > 0.0
            && (1.0..=170.0).contains(&self.fov)
    }

    /// From the world to x to the right, y up and z backwards.
    pub(super) fn view_from_world(&self) -> DMat4 {
        /// Nearer to straight up or down than this, +Y is no help.
        const STEEP: f64 = 0.9999;
        let back = (self.position - self.look_at).normalize();
        let upwards = if back.y.abs() < STEEP { DVec3::Y } else { DVec3::NEG_Z };
        let right = upwards.cross(back).normalize();
        let up = back.cross(right);
        let rotation = DMat4::from_cols(right.extend(0.0), up.extend(0.0), back.extend(0.0), DVec4::W);
        rotation.transpose() * DMat4::from_translation(-self.position)
    }

    /// Half of what is seen across and down at distance 1, for a picture of `size`.
    pub(super) fn half_view(&self, size: [usize; 2]) -> [f64; 2] {
        let half = (0.5 * self.fov.to_radians()).tan();
        [half, half * size[1] as f64 / size[0] as f64]
    }
}
