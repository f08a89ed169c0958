//! Whether two instances of a mesh have the same shape: one is the other turned, mirrored, moved and scaled
//! uniformly.

use super::Instance;
use glam::{DAffine3, DMat3, DVec3};

/// How far a linear part may be from rotation × uniform scale, relative to the scale: texels then stretch by
/// no more.
const TOLERANCE: f64 = 1e-3;

/// A map that keeps shapes, from one instance of a mesh to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Metres there per metre here.
    pub scale: f64,
    /// Whether it turns left hands into right hands.
    pub mirrored: bool,
    /// Positions there from positions here, both in metres relative to the `origin` it was asked for.
    pub map: DAffine3,
}

impl Instance {
    /// The map from this instance to another of the same mesh, about `origin`; `None` when they show
    /// different meshes, have different shapes (a linear part M′·M⁻¹ that stretches by more than 10⁻³), or
    /// this one is flattened.
    pub fn similarity(&self, other: &Instance, origin: DVec3) -> Option<Similarity> {
        if self.mesh != other.mesh
            || self.triangles.len() != other.triangles.len()
            || self.vertices.len() != other.vertices.len()
        {
            return None;
        }
        let (from, to) = (&self.world_from_mesh, &other.world_from_mesh);
        // Equal transforms must give the identity itself, not its rounding.
        let linear = match from.matrix3 == to.matrix3 {
            true => DMat3::IDENTITY,
            false => to.matrix3 * from.matrix3.inverse(),
        };
        // L = s·Q with Q orthogonal means LᵀL = s²·1, and s³ = |det L|. Anything not finite fails the
        // comparison.
        let determinant = linear.determinant();
        let scale = determinant.abs().cbrt();
        let gram = linear.transpose() * linear * (scale * scale).recip();
        let same_shape = gram.abs_diff_eq(DMat3::IDENTITY, 2.0 * TOLERANCE);
        // Rotation and scale go by the mesh's coordinates; the rest of p ↦ L(p + o − t) + t′ − o is the
        // translation.
        let translation = linear * (origin - from.translation) + (to.translation - origin);
        let map = DAffine3 { matrix3: linear, translation };
        (scale > 0.0 && same_shape && map.is_finite()).then_some(Similarity {
            scale,
            mirrored: determinant < 0.0,
            map,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, dvec3};

    fn instance(linear: DMat3, translation: DVec3) -> Instance {
        Instance {
            name: String::new(),
            mesh: 0,
            world_from_mesh: DAffine3 { matrix3: linear, translation },
            triangles: 0..1,
            vertices: 0..3,
            lightmap: true,
            has_lightmap_uvs: false,
            lightmap_place: Default::default(),
            density: 1.0,
        }
    }

    #[test]
    fn turned_mirrored_and_scaled_is_the_same_shape_and_stretched_is_not() {
        // The first one is sheared itself: what counts is how they differ.
        let shear = DMat3::from_cols(dvec3(2.0, 0.1, 0.0), dvec3(1.0, 1.0, 0.0), dvec3(0.0, 0.3, 0.5));
        let turn = DMat3::from_quat(DQuat::from_axis_angle(dvec3(1.0, 2.0, 3.0).normalize(), 0.7));
        let mirror = DMat3::from_diagonal(dvec3(-1.0, 1.0, 1.0));
        let far = dvec3(1e6, 2e6, -3e6);
        let a = instance(shear, far);
        for (linear, scale, mirrored) in
            [(turn, 1.0, false), (turn * 0.25, 0.25, false), (turn * mirror * 3.0, 3.0, true)]
        {
            let b = instance(linear * shear, far + dvec3(5.0, 6.0, 7.0));
            let s = a.similarity(&b, far).unwrap();
            assert!((s.scale / scale - 1.0).abs() < 1e-12 && s.mirrored == mirrored);
            let p = dvec3(0.3, -0.4, 0.5);
            let place = |i: &Instance| i.world_from_mesh.transform_point3(p) - far;
            assert!((s.map.transform_point3(place(&a)) - place(&b)).length() < 1e-8);
        }
        for (stretch, same) in [(1.0008, true), (1.01, false), (2.0, false), (0.0, false)] {
            let b = instance(turn * DMat3::from_diagonal(dvec3(1.0, stretch, 1.0)) * shear, far);
            assert_eq!(a.similarity(&b, far).is_some(), same, "{stretch}");
        }
        let flat = instance(DMat3::from_diagonal(dvec3(1.0, 0.0, 1.0)), DVec3::ZERO);
        assert!(flat.similarity(&a, DVec3::ZERO).is_none());
        let other = Instance { mesh: 1, ..a.clone() };
        assert!(a.similarity(&other, DVec3::ZERO).is_none());
        assert_eq!(a.similarity(&a, DVec3::ZERO).unwrap().map, DAffine3::IDENTITY);
    }
}
