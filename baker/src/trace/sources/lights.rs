//! The light a bake traces: the distinct suns, the lit skies and the traced groups, one layer each, in that
//! order.

use super::light_subset::{FEW_GROUPS, chances};
use super::room::Room;
use crate::Rgb;
use crate::light::daylight::{DiscSampler, SkySampler, SkyTable, SunDisc};
use crate::light::lamps::GroupSampler;
use glam::{Vec2, Vec3};

/// Everything that shines, as layers: suns, then the lit hours of the sky, then groups as if always on.
pub struct Lights {
    /// The distinct suns.
    pub suns: Vec<SunLight>,
    /// The sky; its layers are `sky.lit`.
    pub sky: SkyTable,
    /// Where to look for the sky beyond what a diffuse path meets: portals, bright parts of an image.
    pub sky_sampler: Option<SkySampler>,
    /// Radiance of the ground below the horizon in each layer of suns and sky; empty: there is none.
    pub ground: Vec<Rgb>,
    /// The traced groups.
    pub groups: Vec<GroupLight>,
    /// Per group of the scene, its index among `groups`; `None`: not traced.
    pub index_of_group: Vec<Option<usize>>,
    /// Per layer, whether lightmaps hold what comes straight from its light.
    pub holds_direct: Vec<bool>,
    /// Per traced group, its index among those with emissive surfaces, which paths can meet.
    pub hit_index_of_group: Vec<Option<usize>>,
    /// Whether what comes straight from the sky is summed apart.
    pub is_sky_apart: bool,
    /// The rooms behind portals that lead outdoors.
    pub rooms: Vec<Room>,
}

/// A sun, ready for sampling.
#[derive(Clone, Copy, Debug)]
pub struct SunLight {
    sampler: DiscSampler,
    /// Two axes across the disc, as long as its radius at distance 1, where it is whole and small.
    across: Option<[Vec3; 2]>,
}

impl SunLight {
    /// Prepares a sun.
    pub fn new(disc: SunDisc) -> Self {
        /// Up to this half angle a uniform point of the flat disc is a uniform direction, to 2 parts in 10⁴.
        const SMALL: f32 = 0.01;
        let is_whole = !disc.horizon || disc.direction.y > disc.half_angle.sin();
        let (x, y) = disc.direction.any_orthonormal_pair();
        let radius = disc.half_angle.tan();
        let across = (is_whole && disc.half_angle <= SMALL).then(|| [x * radius, y * radius]);
        SunLight { sampler: DiscSampler::new(disc), across }
    }

    /// The disc.
    pub fn disc(&self) -> &SunDisc {
        &self.sampler.disc
    }

    /// Perpendicular irradiance.
    pub fn irradiance(&self) -> Rgb {
        self.disc().irradiance
    }

    /// A direction towards the disc; `sun_sample` is the same for all suns of a sample.
    #[inline]
    pub fn sample(&self, sun_sample: &SunSample) -> Vec3 {
        match self.across {
            Some([x, y]) => {
                (self.disc().direction + x * sun_sample.on_disc.x + y * sun_sample.on_disc.y).normalize()
            }
            None => self.sampler.sample(sun_sample.u),
        }
    }
}

/// What the suns of one sample share: a point of the unit square, and the point of the unit disc it stands
/// for.
#[derive(Clone, Copy, Debug)]
pub struct SunSample {
    u: Vec2,
    on_disc: Vec2,
}

impl SunSample {
    /// From a point of the unit square.
    pub fn new(u: Vec2) -> Self {
        let (sin, cos) = (u.y * std::f32::consts::TAU).sin_cos();
        SunSample { u, on_disc: Vec2::new(cos, sin) * u.x.sqrt() }
    }
}

/// The light of one group, in units of its scale (see [`crate::bake::prepare::plan`]).
pub struct GroupLight {
    /// Its lamps and emissive triangles.
    pub sampler: GroupSampler,
    /// Per material of the geometry, the radiance it emits into this group's layer.
    pub emission: Vec<Rgb>,
    /// Whether some of them emit by a map, which multiplies that.
    pub has_maps: bool,
    /// Decides the random numbers of the group's samples: a function of its name, so that they stay the same
    /// whichever other groups are traced with it.
    pub key: u32,
}

impl Lights {
    /// No light.
    pub fn none() -> Self {
        let sky = SkyTable::new(None, None, &[]);
        let (suns, ground) = (Vec::new(), Vec::new());
        let (groups, index_of_group) = (Vec::new(), Vec::new());
        Lights {
            suns,
            sky,
            sky_sampler: None,
            ground,
            groups,
            index_of_group,
            holds_direct: Vec::new(),
            hit_index_of_group: Vec::new(),
            is_sky_apart: false,
            rooms: Vec::new(),
        }
    }

    /// Adds to each layer what lightmaps hold of the light that comes straight from it: `direct` as sampled
    /// (by layer), `hit_light` as paths met it.
    pub fn add_held(&self, direct: &[Rgb], hit_light: &[Rgb], out: &mut [Rgb]) {
        let held = |(_, holds): &((&mut Rgb, &Rgb), &bool)| **holds;
        for ((out, direct), _) in out.iter_mut().zip(direct).zip(&self.holds_direct).filter(held) {
            *out += *direct;
        }
        for (layer, index) in self.layers_of_hit_lights().filter(|(layer, _)| self.holds_direct[*layer]) {
            out[layer] += hit_light[index];
        }
    }

    /// How many lights paths can meet straight from their start whose light is summed apart there: groups
    /// with emissive surfaces, then the hours of the sky if it is one.
    pub fn hit_lights(&self) -> usize {
        self.hit_index_of_group.iter().flatten().count() + self.sky_among_hit_lights().len()
    }

    /// The indices of the sky's layers among the hit lights.
    fn sky_among_hit_lights(&self) -> std::ops::Range<usize> {
        let groups = self.hit_index_of_group.iter().flatten().count();
        groups..groups + if self.is_sky_apart { self.sky.lit.len() } else { 0 }
    }

    /// The hit lights, each by its layer and its index.
    pub fn layers_of_hit_lights(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let indices = self.hit_index_of_group.iter().enumerate();
        let groups = indices.filter_map(|(group, index)| Some((self.group_layer(group), (*index)?)));
        groups.chain(self.sky_layers().zip(self.sky_among_hit_lights()))
    }

    /// Number of layers.
    pub fn layers(&self) -> usize {
        self.suns.len() + self.sky.lit.len() + self.groups.len()
    }

    /// Adds the light that comes from outside the scene in a direction, times `beta`: of the sky, to
    /// `hit_light` if it is there and the sky is summed apart, and of the ground below the horizon.
    #[inline]
    pub fn add_from_outside(
        &self,
        direction: Vec3,
        beta: Rgb,
        out: &mut [Rgb],
        hit_light: Option<&mut [Rgb]>,
    ) {
        match hit_light {
            Some(hit_light) if self.is_sky_apart => {
                self.sky.add(direction, beta, &mut hit_light[self.sky_among_hit_lights()])
            }
            _ => self.sky.add(direction, beta, &mut out[self.sky_layers()]),
        }
        if direction.y < 0.0 {
            out.iter_mut().zip(&self.ground).for_each(|(o, radiance)| *o += beta * *radiance);
        }
    }

    /// The layers of the sky.
    pub fn sky_layers(&self) -> std::ops::Range<usize> {
        self.suns.len()..self.suns.len() + self.sky.lit.len()
    }

    /// The layer of a traced group.
    pub fn group_layer(&self, group: usize) -> usize {
        self.suns.len() + self.sky.lit.len() + group
    }

    /// Number of lights that are sampled from a point: suns and groups.
    pub fn sampled(&self) -> usize {
        self.suns.len() + self.groups.len()
    }

    /// The chance with which each group is sampled at a point with a unit normal, where there are
    /// more than a few and `selected` of them are: in proportion to a guess of it, beside all that the
    /// group gives anywhere. `None`: all are.
    pub fn chances(&self, point: Vec3, normal: Vec3, selected: usize) -> Option<Vec<f32>> {
        /// The part of `selected` that goes evenly to all that may give light: the guess knows of no shadows.
        const EVEN: f32 = 0.2;
        if self.groups.len() <= FEW_GROUPS {
            return None;
        }
        let mut worth: Vec<f32> = self.groups.iter().map(|g| g.sampler.worth(point, normal)).collect();
        let able = worth.iter().filter(|w| **w > 0.0).count();
        let even = EVEN / (1.0 - EVEN) * worth.iter().sum::<f32>() / able.max(1) as f32;
        worth.iter_mut().filter(|w| **w > 0.0).for_each(|w| *w += even);
        chances(&mut worth, selected);
        Some(worth)
    }

    /// The layer of a sampled light.
    pub fn layer_of_sampled(&self, light: usize) -> usize {
        if light < self.suns.len() { light } else { self.sky.lit.len() + light }
    }
}
