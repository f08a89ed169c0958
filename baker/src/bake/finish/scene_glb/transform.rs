//! Transforms as nodes: glTF allows a translation, a rotation and a scale, so one that shears takes two
//! nodes.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use serde_json::{Map, Value, json};

/// How far from perpendicular columns may be for the transform not to count as shearing.
const SHEAR: f64 = 1e-7;

/// The properties of the nodes, from the outer one to the inner one, whose product is a transform.
pub(super) fn nodes(transform: &DAffine3) -> Vec<Map<String, Value>> {
    let linear = transform.matrix3;
    let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis].map(DVec3::normalize_or_zero);
    if [x.dot(y), y.dot(z), z.dot(x)].into_iter().all(|cosine| cosine.abs() <= SHEAR) {
        return vec![properties(transform.translation, linear)];
    }
    // M = U Σ Vᵀ, so that M V = U Σ has perpendicular columns.
    let (columns, v) = perpendicular(linear);
    vec![properties(transform.translation, columns), properties(DVec3::ZERO, v.transpose())]
}

/// A node's properties for a linear part whose columns are perpendicular; what is the default is left out.
fn properties(translation: DVec3, linear: DMat3) -> Map<String, Value> {
    let mut scale = DVec3::new(linear.x_axis.length(), linear.y_axis.length(), linear.z_axis.length());
    if linear.determinant() < 0.0 {
        scale.x = -scale.x;
    }
    let columns = [linear.x_axis / scale.x, linear.y_axis / scale.y, linear.z_axis / scale.z];
    let rotation = DMat3::from_cols(columns[0], columns[1], columns[2]);
    let mut properties = Map::new();
    if translation != DVec3::ZERO {
        properties.insert("translation".into(), json!(translation.to_array()));
    }
    if rotation != DMat3::IDENTITY && rotation.is_finite() {
        properties.insert("rotation".into(), json!(DQuat::from_mat3(&rotation).normalize().to_array()));
    }
    if scale != DVec3::ONE {
        properties.insert("scale".into(), json!(scale.to_array()));
    }
    properties
}

/// M V and the rotation V that makes the columns of M V perpendicular, by Jacobi's method from one side.
fn perpendicular(mut m: DMat3) -> (DMat3, DMat3) {
    let mut v = DMat3::IDENTITY;
    // It converges quadratically: far fewer sweeps are enough.
    for _ in 0..20 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b) = (m.col(p), m.col(q));
            if a.dot(b) == 0.0 {
                continue;
            }
            let angle = 0.5 * f64::atan2(2.0 * a.dot(b), b.length_squared() - a.length_squared());
            let (sin, cos) = angle.sin_cos();
            let mut turn = DMat3::IDENTITY;
            (turn.col_mut(p)[p], turn.col_mut(q)[q]) = (cos, cos);
            (turn.col_mut(p)[q], turn.col_mut(q)[p]) = (-sin, sin);
            (m, v) = (m * turn, v * turn);
        }
    }
    (m, v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    /// The product of the nodes.
    fn product(nodes: &[Map<String, Value>]) -> DAffine3 {
        let of = |node: &Map<String, Value>| {
            let list = |key: &str, default: &[f64]| -> Vec<f64> {
                node.get(key).map_or(default.to_vec(), |v| serde_json::from_value(v.clone()).unwrap())
            };
            DAffine3::from_scale_rotation_translation(
                DVec3::from_slice(&list("scale", &[1.0; 3])),
                DQuat::from_slice(&list("rotation", &[0.0, 0.0, 0.0, 1.0])),
                DVec3::from_slice(&list("translation", &[0.0; 3])),
            )
        };
        nodes.iter().map(of).fold(DAffine3::IDENTITY, |all, one| all * one)
    }

    #[test]
    fn nodes_multiply_to_the_transform_also_where_it_shears() {
        let turn = DMat3::from_quat(DQuat::from_axis_angle(dvec3(1.0, 2.0, -3.0).normalize(), 0.7));
        let other = DMat3::from_quat(DQuat::from_axis_angle(dvec3(-2.0, 0.3, 1.0).normalize(), 2.0));
        let stretch = DMat3::from_diagonal(dvec3(1.0, 2.0, 3.0));
        let mirror = DMat3::from_diagonal(dvec3(1.0, 1.0, -1.0));
        for (linear, count) in [
            (DMat3::IDENTITY, 1),
            (turn, 1),
            (turn * stretch, 1),
            (turn * mirror, 1),
            (stretch * turn, 2),
            (other * stretch * turn * mirror, 2),
            (turn * stretch * other * stretch, 2),
            (DMat3::from_diagonal(dvec3(1e-6, 1.0, 1e3)) * turn, 2),
        ] {
            let transform = DAffine3 { matrix3: linear, translation: dvec3(1e6, -2.0, 3.0) };
            let nodes = nodes(&transform);
            assert_eq!(nodes.len(), count, "{linear}");
            let found = product(&nodes);
            let size = linear.to_cols_array().into_iter().fold(0.0f64, |m, x| m.max(x.abs()));
            assert!(
                (found.matrix3 - linear).abs_diff_eq(DMat3::ZERO, 1e-9 * size),
                "{linear} {}",
                found.matrix3
            );
            assert_eq!(found.translation, transform.translation);
        }
        assert!(nodes(&DAffine3::IDENTITY)[0].is_empty());
    }
}
