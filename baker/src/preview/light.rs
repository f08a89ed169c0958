//! The layers of the frames that are shown, each with its share.

use crate::Rgb;
use crate::bake::prepare::Plan;
use crate::geometry::Geometry;
use crate::light::times::Hours;
use crate::scene::Scene;
use crate::trace::sources::Lights;
use glam::Vec3;
use std::collections::BTreeMap;

/// The light that is shown.
pub(super) struct Light {
    /// One layer per distinct sun, sky and group that shines.
    pub lights: Lights,
    /// Per layer, what its light is multiplied by.
    weights: Vec<Rgb>,
}

impl Light {
    /// The light at some hours, each with its share: those of the texels beside it.
    pub(super) fn new(scene: &Scene, geometry: &Geometry, hours: &[(f64, f32)]) -> Self {
        let mut list: Vec<f64> = hours.iter().map(|&(hour, _)| hour).collect();
        list.sort_by(f64::total_cmp);
        let plan = Plan::new(scene, geometry, &Hours { list, ..Hours::default() }, 0);
        let mut shares: BTreeMap<usize, Rgb> = BTreeMap::new();
        for &(hour, weight) in hours {
            if let Some(m) = plan.times.iter().position(|m| (m.hour - hour).abs() < 1e-6) {
                for layer in plan.layers_of(m) {
                    *shares.entry(layer).or_default() += weight * plan.scale_of(layer);
                }
            }
        }
        let layers: Vec<usize> = shares.keys().copied().collect();
        Light { lights: plan.lights(scene, geometry, &layers), weights: shares.into_values().collect() }
    }

    /// The sum of all layers' light.
    pub(super) fn sum(&self, layers: &[Rgb]) -> Rgb {
        layers.iter().zip(&self.weights).map(|(light, weight)| *light * *weight).sum()
    }

    /// Radiance of the sky, and of the ground below the horizon.
    pub(super) fn sky(&self, direction: Vec3) -> Rgb {
        let mut radiance = vec![Rgb::ZERO; self.lights.layers()];
        self.lights.add_from_outside(direction, Rgb::ONE, &mut radiance, None);
        self.sum(&radiance)
    }

    /// Radiance that a triangle emits at a point.
    pub(super) fn emission(&self, geometry: &Geometry, triangle: usize, barycentrics: Vec3) -> Rgb {
        let material = geometry.material_of[triangle];
        let group = geometry.materials[material as usize].emission.map(|emission| emission.group as usize);
        let place = group.and_then(|group| self.lights.index_of_group.get(group).copied().flatten());
        place.map_or(Rgb::ZERO, |place| {
            self.lights.groups[place].emission[material as usize]
                * geometry.emission_map_at(triangle, barycentrics)
                * self.weights[self.lights.group_layer(place)]
        })
    }
}
