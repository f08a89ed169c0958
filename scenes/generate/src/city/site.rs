//! A place with a direction: local +Z faces the street, local x runs to the right as seen from there.

use crate::mesh::Mesh;
use crate::model::Model;
use glam::{DQuat, DVec3};

/// A turned and moved frame.
#[derive(Clone, Copy, Debug)]
pub struct Site {
    /// Metres.
    pub origin: DVec3,
    /// Degrees about +Y.
    pub turn: f64,
}

impl Site {
    /// A frame.
    pub fn new(origin: DVec3, turn: f64) -> Self {
        Self { origin, turn }
    }

    /// A local point in the world.
    pub fn at(&self, x: f64, y: f64, z: f64) -> DVec3 {
        self.origin + DQuat::from_rotation_y(self.turn.to_radians()) * DVec3::new(x, y, z)
    }

    /// A frame within this one.
    pub fn within(&self, x: f64, y: f64, z: f64, turn: f64) -> Self {
        Self { origin: self.at(x, y, z), turn: self.turn + turn }
    }

    /// A local mesh in the world.
    pub fn set(&self, mesh: Mesh) -> Mesh {
        mesh.turned(self.turn).translated(self.origin.x, self.origin.y, self.origin.z)
    }

    /// Places meshes here.
    pub fn place(&self, model: &mut Model, meshes: &[usize]) {
        model.place_all(meshes, self.origin, self.turn.rem_euclid(360.0), DVec3::ONE);
    }
}

/// A sheet seen from its other side.
pub fn turned_over(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh.smoothed()
}
