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
pub(super) const UNITS: [Unit; 3] = [
    Unit { name: "metres", metres: 1.0 },
    Unit { name: "centimetres", metres: 0.01 },
    Unit { name: "millimetres", metres: 0.001 },
];

/// A unit by its name.
pub(super) fn parse(name: &str) -> Result<Unit, String> {
    let names = UNITS.map(|unit| unit.name);
    UNITS.into_iter().find(|unit| unit.name == name).ok_or_else(|| format!("expected {}", names.join(", ")))
}

/// The longest side of most scenes lies between these, in metres.
const USUAL_EXTENTS: [f64; 2] = [2.0, 500.0];
/// The longest side of a scene of which nothing else is known, in metres; it decides between two units that
/// fit.
const USUAL_EXTENT: f64 = 15.0;
/// The median of the longest edges of its triangles lies between these, in metres.
const USUAL_EDGES: [f64; 2] = [0.005, 20.0];

/// Another unit than glTF's must fit by this much better, as the logarithm of a length.
const MARGIN: f64 = std::f64::consts::LN_2;
/// A model that fits another unit by this much better than that of all is in another unit: a factor of 20.
const CONTRADICTION: f64 = 3.0;

/// How large a model is, in its own unit.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Size {
    /// Its longest side.
    extent: f64,
    /// The median of its triangles' longest edges.
    edge: f64,
}

impl Size {
    /// Of some triangles.
    pub(super) fn of(geometry: &Geometry, triangles: impl Iterator<Item = usize> + Clone) -> Self {
        let corners = triangles.clone().flat_map(|triangle| geometry.corners(triangle));
        let extent = Bounds::of(corners).size().max_element();
        let mut edges: Vec<f64> = triangles.map(|triangle| geometry.longest_edge(triangle)).collect();
        let middle = edges.len() / 2;
        let edge = match edges.is_empty() {
            true => 0.0,
            false => *edges.select_nth_unstable_by(middle, f64::total_cmp).1,
        };
        Size { extent, edge }
    }

    /// How badly it fits a scene that people walk through.
    fn misfit(&self, unit: &Unit) -> f64 {
        let (extent, edge) = (self.extent * unit.metres, self.edge * unit.metres);
        outside(extent, USUAL_EXTENTS) + outside(edge, USUAL_EDGES) + 0.2 * outside(extent, [USUAL_EXTENT; 2])
    }

    /// The unit in which the size of a model and of its triangles best fit a scene that people walk through.
    pub(super) fn unit(&self) -> Unit {
        let [metres, others @ ..] = UNITS;
        let best = others.into_iter().min_by(|a, b| self.misfit(a).total_cmp(&self.misfit(b)));
        best.filter(|unit| self.misfit(unit) < self.misfit(&metres) - MARGIN).unwrap_or(metres)
    }

    /// The unit of a model that cannot be in this one.
    pub(super) fn contradiction(&self, unit: &Unit) -> Option<Unit> {
        let own = UNITS.into_iter().min_by(|a, b| self.misfit(a).total_cmp(&self.misfit(b)))?;
        (self.misfit(&own) < self.misfit(unit) - CONTRADICTION).then_some(own)
    }
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{:.3} units long", self.extent)
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

    /// Of a strip along X of this length, cut into squares with sides of that.
    fn size(length: f32, edge: f32) -> Size {
        let mut geometry = Geometry::default();
        let steps = (length / edge) as u32;
        for i in 0..=steps {
            let x = i as f32 * edge;
            geometry.positions.extend([Vec3::new(x, 0.0, 0.0), Vec3::new(x, edge, 0.0)]);
        }
        for i in 0..2 * steps {
            geometry.triangles.push([i, i + 1, i + 2]);
        }
        Size::of(&geometry, 0..geometry.triangles.len())
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
            assert_eq!(size(length, edge).unit().name, expected, "{length} by {edge}");
        }
        assert_eq!(Size::default().unit().name, "metres");
    }

    #[test]
    fn models_of_another_unit_contradict_and_small_ones_do_not() {
        let [metres, centimetres, _] = UNITS;
        let other = |length, edge, unit| size(length, edge).contradiction(&unit).map(|unit| unit.name);
        assert_eq!(other(0.1, 0.01, metres), None, "a lamp");
        assert_eq!(other(90.0, 5.0, centimetres), None, "a chair");
        assert_eq!(other(8.0, 0.3, centimetres), Some("metres"), "a house");
        assert_eq!(other(8000.0, 900.0, metres), Some("millimetres"), "a house");
    }
}
