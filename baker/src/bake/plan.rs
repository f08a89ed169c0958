//! What will be traced: moments, the distinct layers they need, and what was left out and why.

use crate::geometry::Geometry;
use crate::light::lamp::LampSampler;
use crate::light::schedule::{Hours, Moment, moments};
use crate::light::sky::SkyTable;
use crate::light::sun::{self, SunDisc};
use crate::scene::{Scene, Sky};

/// The layers of a bake and how each moment is made of them.
#[derive(Debug)]
pub struct Plan {
    /// The moments, ascending.
    pub moments: Vec<Moment>,
    /// Distinct suns: moments with the same sun share its layer.
    pub suns: Vec<SunDisc>,
    /// Per moment, its sun among `suns`.
    pub sun_of: Vec<Option<usize>>,
    /// The sky at its distinct moments.
    pub sky: SkyTable,
    /// Per moment, its sky among `sky.lit`.
    pub sky_of: Vec<Option<usize>>,
    /// Lamps of the groups that are lit at any moment.
    pub lamps: Vec<Vec<LampSampler>>,
    /// Per group of the scene, its place among `lamps`.
    pub layer_of_group: Vec<Option<usize>>,
    /// What is not traced, and why, in words.
    pub left_out: Vec<String>,
}

impl Plan {
    /// Plans the bake of `scene` at `hours`.
    pub fn new(scene: &Scene, geometry: &Geometry, hours: &Hours) -> Self {
        let moments = moments(hours, &scene.groups);
        let mut left_out = Vec::new();

        // Suns, the same disc once.
        let mut suns: Vec<SunDisc> = Vec::new();
        let sun_of: Vec<Option<usize>> = moments
            .iter()
            .map(|m| {
                let disc = sun::at(scene.sun.as_ref()?, scene.place.as_ref(), m.hour)?;
                Some(suns.iter().position(|s| *s == disc).unwrap_or_else(|| {
                    suns.push(disc);
                    suns.len() - 1
                }))
            })
            .collect();
        let dark = sun_of.iter().filter(|s| s.is_none()).count();
        match (&scene.sun, dark) {
            (None, _) => left_out.push("no sun rays: the scene has no sun".to_owned()),
            (Some(_), 0) => {}
            (Some(_), n) => {
                left_out.push(format!(
                    "no sun rays at {n} of {} moments: the sun gives no light then",
                    moments.len()
                ));
            }
        }

        // Skies: a constant one is the same at every moment.
        let hours: Vec<f64> = moments.iter().map(|m| m.hour).collect();
        let constant = matches!(scene.sky, Some(Sky::Constant { .. }));
        let asked = if constant { hours.get(..1).unwrap_or(&[]) } else { &hours[..] };
        let sky = SkyTable::new(scene.sky.as_ref(), scene.place.as_ref(), asked);
        let sky_of: Vec<Option<usize>> = (0..moments.len())
            .map(|i| sky.lit.iter().position(|&hour| hour == if constant { 0 } else { i }))
            .collect();
        if scene.sky.is_none() {
            left_out.push("no sky lookups: the scene has no sky".to_owned());
        } else if sky.lit.is_empty() {
            left_out.push("no sky lookups: the sky is black at every moment".to_owned());
        }
        let (distinct_suns, distinct_skies) = (suns.len(), sky.lit.len());
        let with_sun = sun_of.iter().flatten().count();
        if distinct_suns < with_sun {
            left_out.push(format!("{with_sun} moments with sun share {distinct_suns} distinct suns"));
        }
        if constant && distinct_skies == 1 && moments.len() > 1 {
            left_out.push(format!("{} moments share one constant sky", moments.len()));
        }

        // Groups: only those some moment shows.
        let mut lamps = Vec::new();
        let layer_of_group = scene
            .groups
            .iter()
            .enumerate()
            .map(|(g, group)| {
                if !moments.iter().any(|m| m.groups_on[g]) {
                    left_out
                        .push(format!("group \"{}\" is not traced: off at every moment baked", group.name));
                    return None;
                }
                lamps.push(group.lamps.iter().map(|lamp| LampSampler::new(lamp, geometry.origin)).collect());
                Some(lamps.len() - 1)
            })
            .collect();
        if scene.groups.is_empty() {
            left_out.push("no lamp sampler and no switch extras: the scene has no light groups".to_owned());
        }
        if !geometry.materials.iter().any(|m| m.alpha_cutoff.is_some()) {
            left_out.push("no alpha tests: the scene has no cut-outs".to_owned());
        }
        Plan { moments, suns, sun_of, sky, sky_of, lamps, layer_of_group, left_out }
    }

    /// Number of layers: suns, skies, groups, in that order.
    pub fn layers(&self) -> usize {
        self.suns.len() + self.sky.lit.len() + self.lamps.len()
    }

    /// The layers whose sum is the light of a moment, ascending.
    pub fn layers_of(&self, moment: usize) -> Vec<usize> {
        let sky = self.sky_of[moment].map(|s| self.suns.len() + s);
        self.sun_of[moment].into_iter().chain(sky).chain(self.groups_of(moment)).collect()
    }

    /// The layers of the groups that are lit at a moment.
    pub fn groups_of(&self, moment: usize) -> impl Iterator<Item = usize> + '_ {
        let first = self.suns.len() + self.sky.lit.len();
        let on = &self.moments[moment].groups_on;
        on.iter()
            .zip(&self.layer_of_group)
            .filter(|(on, _)| **on)
            .filter_map(move |(_, l)| l.map(|l| first + l))
    }
}
