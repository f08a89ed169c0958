//! Lamps and cameras of a geometry file, as the file gives them: for what places lamps and writes scene
//! files.

use crate::scene::Profile;
use glam::{DMat4, DVec3};
use std::sync::Arc;

/// A lamp of a geometry file (`KHR_lights_punctual`, `EXT_lights_ies`).
#[derive(Clone, Debug, PartialEq)]
pub struct FileLamp {
    /// The node's name, else the light's, else `lamp N`.
    pub name: String,
    /// The names of its node and its light; where both are empty, its own.
    pub names: Vec<String>,
    /// Its node's place in the tree of its file.
    pub(super) node: usize,
    /// Its kind.
    pub kind: FileLampKind,
    /// Linear Rec. 709.
    pub colour: DVec3,
    /// Candela, the greatest of a photometric profile; lux for a directional light.
    pub intensity: f64,
    /// Places it: it stands at the origin and shines along −Z.
    pub file_from_lamp: DMat4,
}

/// The kind of a lamp of a geometry file.
#[derive(Clone, Debug, PartialEq)]
pub enum FileLampKind {
    /// Parallel light from far away.
    Directional,
    /// Shines evenly in all directions.
    Point,
    /// Shines into a cone.
    Spot {
        /// Half angle in radians.
        inner: f64,
        /// Half angle in radians, greater than `inner`.
        outer: f64,
    },
    /// Shines as a photometric profile says: its vertical angle 0 is −Z, its horizontal angle 0 +X.
    Ies(Arc<Profile>),
}

/// A perspective camera of a geometry file.
#[derive(Clone, Debug, PartialEq)]
pub struct FileCamera {
    /// The node's name, else the camera's, else `camera N`.
    pub name: String,
    /// In the file's space, metres.
    pub position: DVec3,
    /// Unit, in the file's space.
    pub direction: DVec3,
    /// Angle of view from left to right in degrees.
    pub fov: f64,
}

/// The lamps and cameras of a geometry file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contents {
    /// In the order of the file.
    pub lamps: Vec<FileLamp>,
    /// In the order of the file.
    pub cameras: Vec<FileCamera>,
}

impl FileLamp {
    /// Where it stands under a transform.
    pub fn position(&self, world_from_file: &DMat4) -> DVec3 {
        world_from_file.transform_point3(self.file_from_lamp.w_axis.truncate())
    }

    /// The unit direction of its light under a transform; `None` where the transform leaves none.
    pub fn direction(&self, world_from_file: &DMat4) -> Option<DVec3> {
        direction(&(*world_from_file * self.file_from_lamp))
    }

    /// The unit direction, perpendicular to that of its light, that its +X comes nearest under a transform.
    pub fn sideways(&self, world_from_file: &DMat4, direction: DVec3) -> DVec3 {
        let x = (*world_from_file * self.file_from_lamp).transform_vector3(DVec3::X);
        let across = (x / x.abs().max_element()).reject_from_normalized(direction);
        across.try_normalize().unwrap_or_else(|| direction.any_orthonormal_vector())
    }
}

/// Where a transform turns −Z to.
pub(super) fn direction(transform: &DMat4) -> Option<DVec3> {
    let direction = transform.transform_vector3(DVec3::NEG_Z);
    // Scaled first: squares of very small or large components leave the range of numbers.
    (direction / direction.abs().max_element()).try_normalize()
}
