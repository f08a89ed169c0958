//! All lights of a group as one: its lamps and the emissive triangles of its meshes, one chosen for each
//! sample.

use super::emitter::Emitter;
use super::lamp::{LampSample, LampSampler, Outline};
use super::tree::LightTree;
use crate::light::luminance;
use crate::scene::Lamp;
use glam::{DVec3, Vec2, Vec3};

pub use super::emitter::emitters;

/// From this many lights on the choice is a tree's; below, every light's importance is computed.
const TREE_FROM: usize = 8;

/// The part of choices that goes evenly to all lights, whatever their importance: a faint lamp may be the
/// only one that is not hidden.
const EVEN_SHARE: f32 = 1.0 / 64.0;

/// Samples one light of a group at a time.
#[derive(Clone, Debug)]
pub struct GroupSampler {
    /// Lights 0 … : lamps.
    lamps: Vec<LampSampler>,
    /// The lights after them: triangles, ascending by index.
    emitters: Vec<Emitter>,
    tree: Option<LightTree>,
    /// Sum of the lights' luminous intensities.
    intensity: f32,
}

impl GroupSampler {
    /// Prepares a group's lights; `origin` is the world position of the local origin. Lights without power or
    /// area are dropped.
    pub fn new(lamps: &[Lamp], emitters: &[Emitter], origin: DVec3) -> Self {
        let lamps: Vec<LampSampler> = lamps.iter().map(|lamp| LampSampler::new(lamp, origin)).collect();
        let lamps: Vec<LampSampler> = lamps.into_iter().filter(|lamp| lamp.luminance() > 0.0).collect();
        let mut emitters: Vec<Emitter> = emitters.iter().copied().filter(Emitter::is_usable).collect();
        emitters.sort_by_key(|emitter| emitter.triangle);
        emitters.dedup_by_key(|emitter| emitter.triangle);
        let outlines = lamps.iter().map(LampSampler::outline);
        let outlines: Vec<Outline> = outlines.chain(emitters.iter().map(Emitter::outline)).collect();
        let intensity = outlines.iter().map(|outline| outline.intensity).sum::<f64>() as f32;
        let tree = (outlines.len() >= TREE_FROM).then(|| LightTree::new(&outlines));
        Self { lamps, emitters, tree, intensity }
    }

    /// Whether it has no light.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of lights: lamps and triangles.
    pub fn len(&self) -> usize {
        self.lamps.len() + self.emitters.len()
    }

    /// Samples one of the lights as seen from `point` with unit `normal`. `choice` in [0, 1) and `u` in [0,
    /// 1)² choose the light and the point of it. The irradiance is already divided by the probability of the
    /// choice. `None`: this sample is 0.
    pub fn sample(&self, point: Vec3, normal: Vec3, choice: f32, u: Vec2) -> Option<LampSample> {
        let (light, probability, left) = self.choose(point, normal, choice, u.x)?;
        let u = Vec2::new(left, u.y);
        let sample = match self.lamps.get(light as usize) {
            Some(lamp) => {
                let sample = lamp.sample(point, normal, u)?;
                LampSample { irradiance: sample.irradiance / probability, ..sample }
            }
            None => {
                let emitter = &self.emitters[light as usize - self.lamps.len()];
                let seen = emitter.seen_from(point.as_dvec3())?;
                let (direction, distance) = seen.sample(u.as_dvec2())?;
                let pdf = seen.pdf(distance) * f64::from(probability);
                let cosine = direction.dot(normal.as_dvec3()).max(0.0);
                LampSample {
                    direction: direction.as_vec3(),
                    distance: distance as f32,
                    irradiance: emitter.radiance * (cosine / pdf) as f32,
                    emitter: Some((emitter.triangle, pdf as f32)),
                    is_flat: true,
                }
            }
        };
        (sample.irradiance.is_finite() && sample.direction.is_finite() && sample.distance > 0.0)
            .then_some(sample)
    }

    /// A guess of the irradiance of all its lights together, per unit of their intensity: 0 only where
    /// `sample` gives nothing.
    pub fn worth(&self, point: Vec3, normal: Vec3) -> f32 {
        let importance = |light| self.importance(light, point, normal);
        let guess = match &self.tree {
            Some(tree) => tree.all(point, normal, importance),
            None => (0..self.len() as u32).map(importance).sum(),
        };
        let relative = guess / self.intensity.max(f32::MIN_POSITIVE);
        if guess > 0.0 { relative.clamp(f32::MIN_POSITIVE, 1e30) } else { 0.0 }
    }

    /// The density over solid angle with which [`GroupSampler::sample`] gives the unit direction from `point`
    /// to the point at `distance` on `triangle`; 0 if that is no emitter of this group, or is not sampled
    /// from there.
    pub fn emitter_pdf(
        &self,
        point: Vec3,
        normal: Vec3,
        triangle: u32,
        direction: Vec3,
        distance: f32,
    ) -> f32 {
        let Ok(at) = self.emitters.binary_search_by_key(&triangle, |emitter| emitter.triangle) else {
            return 0.0;
        };
        let Some(seen) = self.emitters[at].seen_from(point.as_dvec3()).filter(|_| direction.is_finite())
        else {
            return 0.0;
        };
        let probability = self.probability(point, normal, (self.lamps.len() + at) as u32);
        (seen.pdf(f64::from(distance)) * f64::from(probability)) as f32
    }

    /// One light, the probability of that choice, and what is left of `u` for the point of it (few lights are
    /// chosen by `u`, whose numbers are spread evenly over the samples; the tree by `choice`).
    fn choose(&self, point: Vec3, normal: Vec3, choice: f32, u: f32) -> Option<(u32, f32, f32)> {
        match &self.tree {
            None => {
                let shares = Shares::new(self, point, normal);
                let (light, left) = shares.choose(u)?;
                Some((light as u32, shares.probability(light), left))
            }
            Some(tree) => {
                let n = self.len() as f32;
                let importance = |light| self.importance(light, point, normal);
                let (light, by_tree) = if choice < EVEN_SHARE {
                    let light = ((choice / EVEN_SHARE * n) as u32).min(self.len() as u32 - 1);
                    (light, tree.probability(point, normal, light, importance)?)
                } else {
                    tree.choose(point, normal, (choice - EVEN_SHARE) / (1.0 - EVEN_SHARE), importance)?
                };
                Some((light, (1.0 - EVEN_SHARE) * by_tree + EVEN_SHARE / n, u))
            }
        }
    }

    /// The probability with which `choose` gives `light`.
    fn probability(&self, point: Vec3, normal: Vec3, light: u32) -> f32 {
        match &self.tree {
            None => Shares::new(self, point, normal).probability(light as usize),
            Some(tree) => {
                let importance = |light| self.importance(light, point, normal);
                let by_tree = tree.probability(point, normal, light, importance);
                by_tree.map_or(0.0, |by_tree| (1.0 - EVEN_SHARE) * by_tree + EVEN_SHARE / self.len() as f32)
            }
        }
    }

    /// A guess of the irradiance of a light: 0 only where `sample` gives nothing.
    fn importance(&self, light: u32, point: Vec3, normal: Vec3) -> f32 {
        match self.lamps.get(light as usize) {
            Some(lamp) => lamp.importance(point, normal),
            None => {
                let emitter = &self.emitters[light as usize - self.lamps.len()];
                let received = emitter.importance(point.as_dvec3(), normal.as_dvec3());
                let guess = (received * f64::from(luminance(emitter.radiance))) as f32;
                if received > 0.0 { guess.clamp(f32::MIN_POSITIVE, 1e30) } else { 0.0 }
            }
        }
    }
}

/// The importances of fewer than [`TREE_FROM`] lights.
struct Shares {
    of: [f32; TREE_FROM],
    len: usize,
    total: f32,
    /// How many are not 0.
    able: f32,
}

impl Shares {
    fn new(group: &GroupSampler, point: Vec3, normal: Vec3) -> Self {
        let mut of = [0.0; TREE_FROM];
        let len = group.len();
        // A single light needs no guess.
        if len == 1 {
            of[0] = 1.0;
        } else {
            for (light, share) in of[..len].iter_mut().enumerate() {
                *share = group.importance(light as u32, point, normal);
            }
        }
        let able = of.iter().filter(|share| **share > 0.0).count() as f32;
        Self { of, len, total: of.iter().sum(), able }
    }

    /// In proportion to importance, but for the even part.
    fn probability(&self, light: usize) -> f32 {
        if self.of[light] > 0.0 {
            (1.0 - EVEN_SHARE) * (self.of[light] / self.total) + EVEN_SHARE / self.able
        } else {
            0.0
        }
    }

    /// A light, and what is left of `u`, even in [0, 1) again.
    fn choose(&self, u: f32) -> Option<(usize, f32)> {
        let mut left = u;
        let mut chosen = None;
        for light in 0..self.len {
            let probability = self.probability(light);
            if probability > 0.0 {
                chosen = Some((light, (left / probability).min(1.0 - f32::EPSILON)));
                if left < probability {
                    break;
                }
                left -= probability;
            }
        }
        chosen
    }
}

#[cfg(test)]
#[path = "group_tests.rs"]
mod tests;
