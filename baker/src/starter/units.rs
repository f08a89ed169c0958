//! The unit of length of a model, guessed from its size and detail.

use crate::geometry::{Bounds, Geometry};

/// A unit that modelling programs export in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unit {
    /// Its name, in the plural.
    pub name: &'static str,
    /// Metres.
    pub metres: f64,
}

/// Metres first: glTF says so, and what fits two units alike is taken as metres.
pub const UNITS: [Unit; 3] = [
    Unit { name: "metres", metres: 1.0 },
    Unit { name: "centimetres", metres: 0.01 },
    Unit { name: "millimetres", metres: 0.001 },
];

/// The longest side of most scenes lies between these, in metres.
const USUAL_EXTENTS: [f64; 2] = [2.0, 500.0];
/// The longest side of a scene of which nothing else is known, in metres; it decides between two units that
/// fit.
const USUAL_EXTENT: f64 = 15.0;
/// The median of the longest edges of its triangles lies between these, in metres.
const USUAL_EDGES: [f64; 2] = [0.005, 20.0];

/// The unit in which the size of a model and of its triangles best fit a scene that people walk through.
pub fn guess(geometry: &Geometry) -> Unit {
    /// Another unit than glTF's must fit by this much better, as the logarithm of a length.
    const MARGIN: f64 = std::f64::consts::LN_2;
    let extent = Bounds::of(geometry.positions.iter().copied()).size().max_element();
    let edge = median_edge(geometry);
    let misfit = |unit: &Unit| {
        let (extent, edge) = (extent * unit.metres, edge * unit.metres);
        outside(extent, USUAL_EXTENTS) + outside(edge, USUAL_EDGES) + 0.2 * outside(extent, [USUAL_EXTENT; 2])
    };
    let [metres, others @ ..] = UNITS;
    let best = others.into_iter().min_by(|a, b| misfit(a).total_cmp(&misfit(b)));
    best.filter(|unit| misfit(unit) < misfit(&metres) - MARGIN).unwrap_or(metres)
}

/// The median of the triangles' longest edges.
fn median_edge(geometry: &Geometry) -> f64 {
    let mut edges: Vec<f32> = (0..geometry.triangles.len())
        .map(|t| {
            let [a, b, c] = geometry.corners(t);
            a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a))
        })
        .collect();
    let middle = edges.len() / 2;
    match edges.is_empty() {
        true => 0.0,
        false => f64::from(*edges.select_nth_unstable_by(middle, f32::total_cmp).1).sqrt(),
    }
}

/// How far a length lies outside an interval, as a logarithm.
fn outside(length: f64, [low, high]: [f64; 2]) -> f64 {
    let length = length.max(f64::MIN_POSITIVE);
    (low / length).ln().max((length / high).ln()).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// A box of this size whose sides are cut into squares of this length; only along X.
    fn strip(length: f32, edge: f32) -> Geometry {
        let mut geometry = Geometry::default();
        let steps = (length / edge) as u32;
        for i in 0..=steps {
            let x = i as f32 * edge;
            geometry.positions.extend([Vec3::new(x, 0.0, 0.0), Vec3::new(x, edge, 0.0)]);
        }
        for i in 0..2 * steps {
            geometry.triangles.push([i, i + 1, i + 2]);
        }
        geometry
    }

    #[test]
    fn sizes_of_rooms_and_towns_tell_their_unit() {
        for (length, edge, expected) in [
            (8.0, 0.3, "metres"),
            (0.5, 0.05, "metres"),
            (400.0, 4.0, "metres"),
            (500.0, 8.0, "metres"),
            (8000.0, 200.0, "millimetres"),
            (12_000.0, 2000.0, "millimetres"),
            (900.0, 30.0, "centimetres"),
            (3000.0, 50.0, "centimetres"),
        ] {
            assert_eq!(guess(&strip(length, edge)).name, expected, "{length} by {edge}");
        }
        assert_eq!(guess(&Geometry::default()).name, "metres");
    }
}
