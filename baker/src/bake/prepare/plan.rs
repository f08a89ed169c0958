//! What will be traced: times, the distinct layers they need, and what is skipped and why.

use crate::bake::store::json;
use crate::geometry::Geometry;
use crate::light::daylight::{SkySampler, SkyTable, SunDisc, ground, harmonics, sky, sun};
use crate::light::lamps::GroupSampler;
use crate::light::lamps::emitter::emitters;
use crate::light::times::schedule::{Hours, TimePoint, switches_outside};
use crate::light::times::{ExtraTimes, extra_times};
use crate::scene::{Baked, Lamp, Scene, Sky};
use crate::trace::sources::{GroupLight, Lights, Room, SunLight};
use crate::{Result, Rgb};
use dataset::format::TransferPart;
use dataset::observe::count;
use glam::{DVec3, Vec3};

/// A part of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The light that comes straight from a sun or a light group.
    Direct,
    /// The rest; of the sky, all that lightmaps hold.
    Rest,
}

/// The layers of a bake and how each time is made of them.
#[derive(Debug)]
pub struct Plan {
    /// The times, ascending.
    pub times: Vec<TimePoint>,
    /// Those of them that were added where light changes fast.
    pub extra_times: ExtraTimes,
    /// Distinct suns: times with the same sun share its layer.
    pub suns: Vec<SunDisc>,
    /// Per time, its sun among `suns`.
    pub sun_of: Vec<Option<usize>>,
    /// Distinct skies that are not black: the hour of each (the first of those that share it).
    pub sky_hours: Vec<f64>,
    /// What each is called.
    sky_names: Vec<String>,
    /// Per time, its sky among `sky_hours`.
    pub sky_of: Vec<Option<usize>>,
    /// The groups that shine at some time.
    pub groups: Vec<PlannedGroup>,
    /// Per group of the scene, its index among `groups`.
    pub index_of_group: Vec<Option<usize>>,
    /// Which part of the suns' light lightmaps hold.
    sun_baked: Baked,
    /// Which part of the skies' light they hold.
    sky_baked: Baked,
    /// What is not traced, and why, in words.
    pub skipped: Vec<String>,
}

/// A group to trace, in units of its own brightest light: a change of its colour or intensity changes `scale`
/// alone.
#[derive(Debug)]
pub struct PlannedGroup {
    /// Its name.
    pub name: String,
    /// Its index among the groups of the scene.
    index: u32,
    /// Per channel, what the traced layer is multiplied by: the greatest light of its lamps and surfaces.
    pub scale: Rgb,
    /// Its lamps ÷ `scale`.
    pub lamps: Vec<Lamp>,
    /// Per material of the geometry, the radiance it emits for this group ÷ `scale`, its map not counted.
    pub emission: Vec<Rgb>,
    /// Digest of the emission maps, if it has any.
    maps: Option<blake3::Hash>,
    /// Which part of its light lightmaps hold.
    baked: Baked,
}

impl Plan {
    /// Plans the bake of `scene` at `hours`, and at no more than `most` extra times.
    pub fn new(scene: &Scene, geometry: &Geometry, hours: &Hours, most: u32) -> Self {
        let (times, extra_times) = extra_times::all_times(scene, hours, most);
        let mut skipped = Vec::new();
        skipped.extend(extra_times.skipped());
        let outside = switches_outside(hours, &scene.groups);
        if !outside.is_empty() {
            skipped.push(format!(
                "no frames beside the light switches at {}: the hours asked for end before or begin after",
                outside.iter().map(|&at| hour(at)).collect::<Vec<_>>().join(", ")
            ));
        }
        let (suns, sun_of) = plan_suns(scene, &times, &mut skipped);
        let (skies, sky_of) = plan_skies(scene, &times, &mut skipped);

        // Groups: only those some time shows, and that shine.
        let mut groups = Vec::new();
        let mut index_of_group = vec![None; scene.groups.len()];
        for (g, group) in scene.groups.iter().enumerate() {
            if group.baked == Baked::None {
                skipped.push(format!("group \"{}\" is not traced: baked = \"none\"", group.name));
                continue;
            }
            if !times.iter().any(|m| m.groups_on[g]) {
                skipped.push(format!("group \"{}\" is not traced: off at every time baked", group.name));
                continue;
            }
            let planned = PlannedGroup::new(group, g, geometry);
            if planned.scale == Rgb::ZERO {
                skipped.push(format!("group \"{}\" is not traced: nothing in it shines", group.name));
                continue;
            }
            index_of_group[g] = Some(groups.len());
            groups.push(planned);
        }
        if matches!(scene.sky, Some(Sky::Harmonics { .. })) {
            skipped.push("no sun and no lamps: a transfer is of the sky's functions".to_owned());
        } else if scene.groups.is_empty() {
            skipped.push("no lamp sampler and no switch frames: the scene has no light groups".to_owned());
        }
        if !geometry.materials.iter().any(|m| m.alpha_cutoff.is_some()) {
            skipped.push("no alpha tests: the scene has no cut-outs".to_owned());
        }
        if geometry.textures.is_empty() {
            skipped.push("no texture lookups: the scene has no textures".to_owned());
        }
        let sky_names = skies.iter().map(|&at| sky_name(scene, at)).collect();
        Plan {
            times,
            extra_times,
            suns,
            sun_of,
            sky_hours: skies,
            sky_names,
            sky_of,
            groups,
            index_of_group,
            sun_baked: scene.sun_baked,
            sky_baked: scene.sky_baked,
            skipped,
        }
    }

    /// Number of layers: suns, skies, groups, in that order.
    pub fn layers(&self) -> usize {
        self.suns.len() + self.sky_hours.len() + self.groups.len()
    }

    /// The layers whose sum is the light of a time, ascending.
    pub fn layers_of(&self, time: usize) -> Vec<usize> {
        let sky = self.sky_of[time].map(|s| self.suns.len() + s);
        self.sun_of[time].into_iter().chain(sky).chain(self.group_layers_of(time)).collect()
    }

    /// The layers of the groups that are lit at a time.
    pub fn group_layers_of(&self, time: usize) -> impl Iterator<Item = usize> + '_ {
        let first = self.suns.len() + self.sky_hours.len();
        let on = &self.times[time].groups_on;
        on.iter()
            .zip(&self.index_of_group)
            .filter(|(on, _)| **on)
            .filter_map(move |(_, l)| l.map(|l| first + l))
    }

    /// The group a layer belongs to.
    pub fn group_of_layer(&self, layer: usize) -> Option<&PlannedGroup> {
        self.groups.get(layer.checked_sub(self.suns.len() + self.sky_hours.len())?)
    }

    /// What a layer's values are multiplied by.
    pub fn scale_of(&self, layer: usize) -> Rgb {
        self.group_of_layer(layer).map_or(Rgb::ONE, |g| g.scale)
    }

    /// What a layer shows, in words.
    pub fn name_of(&self, layer: usize) -> String {
        let n = self.suns.len();
        match (layer < n, self.group_of_layer(layer)) {
            (true, _) => {
                let time = self.sun_of.iter().position(|s| *s == Some(layer)).unwrap_or(0);
                format!("sun at {}", hour(self.times[time].hour))
            }
            (_, Some(group)) => format!("group \"{}\"", group.name),
            _ => self.sky_names[layer - n].clone(),
        }
    }

    /// The digest of each layer: of `base` (all that decides a texel but light) and of the emitters in it.
    pub fn digests(&self, scene: &Scene, base: &blake3::Hash) -> Result<Vec<String>> {
        (0..self.layers())
            .map(|layer| {
                let mut hash = blake3::Hasher::new();
                hash.update(base.as_bytes());
                if let Some(sun) = self.suns.get(layer) {
                    hash.update(&json::bytes(&("sun", sun), "sun")?);
                } else if let Some(group) = self.group_of_layer(layer) {
                    hash.update(&json::bytes(
                        &("group", &group.name, &group.lamps, &group.emission),
                        "group",
                    )?);
                    if let Some(maps) = &group.maps {
                        hash.update(maps.as_bytes());
                    }
                } else {
                    hash.update(&json::bytes(&("sky", &scene.sky, &scene.portals), "sky")?);
                    // (It is another sum.)
                    if !self.sky_baked.is_all() {
                        hash.update(&json::bytes(&("baked", self.sky_baked), "sky")?);
                    }
                    let hour = self.sky_hours[layer - self.suns.len()];
                    match part(scene, hour) {
                        Some(part) => hash.update(&json::bytes(&part, "part")?),
                        None => hash.update(bytemuck::cast_slice(&signature(scene, hour))),
                    };
                }
                if let Some(ground) = scene.ground
                    && self.group_of_layer(layer).is_none()
                {
                    hash.update(&json::bytes(&("ground", ground), "ground")?);
                }
                Ok(hash.finalize().to_hex().to_string())
            })
            .collect()
    }

    /// The light of some layers (ascending), ready for sampling: its layers are these, in this order.
    pub fn lights(&self, scene: &Scene, geometry: &Geometry, layers: &[usize]) -> Lights {
        let (n, m) = (self.suns.len(), self.sky_hours.len());
        let suns = layers.iter().filter_map(|&l| self.suns.get(l).copied().map(SunLight::new)).collect();
        let hours: Vec<f64> =
            layers.iter().filter(|&&l| (n..n + m).contains(&l)).map(|&l| self.sky_hours[l - n]).collect();
        let sky = SkyTable::new(scene.sky.as_ref(), scene.location.as_ref(), &hours);
        let ground = self.ground(scene, layers);
        let sky_sampler = SkySampler::new(scene, &sky, geometry.origin);
        let mut groups: Vec<GroupLight> = Vec::new();
        let mut index_of_group = vec![None; self.index_of_group.len()];
        for &layer in layers.iter().filter(|&&l| l >= n + m) {
            let group = &self.groups[layer - n - m];
            index_of_group[group.index as usize] = Some(groups.len());
            groups.push(group.light(geometry));
        }
        let holds_direct = layers.iter().map(|&layer| self.baked_of(layer) == Baked::All).collect();
        let mut next_index = 0..;
        let shines = |group: &GroupLight| group.emission.iter().any(|radiance| *radiance != Rgb::ZERO);
        let hit_index_of_group =
            groups.iter().map(|g| shines(g).then(|| next_index.next()).flatten()).collect();
        let is_sky_apart = self.sky_baked == Baked::Indirect;
        let local = |corner: DVec3| (corner - geometry.origin).as_vec3();
        let rooms = Room::merged(scene.rooms.iter().map(|room| room.map(local)));
        Lights {
            suns,
            sky,
            sky_sampler,
            ground,
            groups,
            index_of_group,
            holds_direct,
            hit_index_of_group,
            is_sky_apart,
            rooms,
        }
    }

    /// Which part of a layer's light lightmaps hold.
    pub fn baked_of(&self, layer: usize) -> Baked {
        match (self.suns.get(layer), self.group_of_layer(layer)) {
            (Some(_), _) => self.sun_baked,
            (_, Some(group)) => group.baked,
            _ => self.sky_baked,
        }
    }

    /// The parts in which a layer is kept: what comes straight from suns and groups lies apart; from the sky
    /// only where it is not baked.
    pub fn parts_of(&self, layer: usize) -> &'static [Part] {
        let is_sky = self.suns.get(layer).is_none() && self.group_of_layer(layer).is_none();
        if is_sky && self.sky_baked.is_all() { &[Part::Rest] } else { &[Part::Direct, Part::Rest] }
    }

    /// The parts of a layer that lightmaps hold.
    pub fn held_parts_of(&self, layer: usize) -> &'static [Part] {
        if self.baked_of(layer) == Baked::All { self.parts_of(layer) } else { &[Part::Rest] }
    }

    /// Radiance of the ground below the horizon in those of some layers that are suns or skies; none where
    /// the scene has no ground.
    fn ground(&self, scene: &Scene, layers: &[usize]) -> Vec<Rgb> {
        let (Some(albedo), Some(sky)) = (scene.ground, &scene.sky) else { return Vec::new() };
        let of_layer = |&layer: &usize| match self.suns.get(layer) {
            Some(sun) => ground::under_sun(albedo, sun),
            None => {
                let hour = self.sky_hours[layer - self.suns.len()];
                ground::under_sky(albedo, sky, scene.location.as_ref(), hour)
            }
        };
        let last = self.suns.len() + self.sky_hours.len();
        layers.iter().filter(|&&layer| layer < last).map(of_layer).collect()
    }
}

/// Such as `6:54`.
pub fn hour(hour: f64) -> String {
    let minutes = (hour * 60.0).round() as i64;
    format!("{}:{:02}", minutes / 60, minutes % 60)
}

/// The distinct suns, and which one each time has.
fn plan_suns(
    scene: &Scene,
    times: &[TimePoint],
    skipped: &mut Vec<String>,
) -> (Vec<SunDisc>, Vec<Option<usize>>) {
    let mut suns: Vec<SunDisc> = Vec::new();
    let traced = scene.sun.as_ref().filter(|_| scene.sun_baked != Baked::None);
    let sun_of: Vec<Option<usize>> = times
        .iter()
        .map(|m| {
            let disc = sun::at(traced?, scene.location.as_ref(), m.hour)?;
            Some(suns.iter().position(|s| *s == disc).unwrap_or_else(|| {
                suns.push(disc);
                suns.len() - 1
            }))
        })
        .collect();
    let with_sun = sun_of.iter().flatten().count();
    if matches!(scene.sky, Some(Sky::Harmonics { .. })) {
        // Told with the lamps.
    } else if scene.sun.is_none() {
        skipped.push("no sun rays: the scene has no sun".to_owned());
    } else if scene.sun_baked == Baked::None {
        skipped.push("no sun rays: [sun] baked = \"none\"".to_owned());
    } else if with_sun < times.len() {
        skipped.push(format!(
            "no sun rays at {} of {}: the sun gives no light then",
            times.len() - with_sun,
            count(times.len(), "time")
        ));
    }
    if suns.len() < with_sun {
        skipped.push(format!("{with_sun} times with sun share {}", count(suns.len(), "distinct sun")));
    }
    (suns, sun_of)
}

/// The distinct skies that are not black (their hours), and which one each time has.
fn plan_skies(
    scene: &Scene,
    times: &[TimePoint],
    skipped: &mut Vec<String>,
) -> (Vec<f64>, Vec<Option<usize>>) {
    let mut skies: Vec<(f64, Vec<Vec3>)> = Vec::new();
    let mut black = 0;
    let mut sky_of = vec![None; times.len()];
    for (m, sky_of) in times.iter().zip(&mut sky_of) {
        let signature = match scene.sky_baked {
            Baked::None => Vec::new(),
            _ => signature(scene, m.hour),
        };
        if signature.iter().all(|v| *v == Vec3::ZERO) {
            black += 1;
            continue;
        }
        *sky_of = Some(skies.iter().position(|(_, s)| *s == signature).unwrap_or_else(|| {
            skies.push((m.hour, signature));
            skies.len() - 1
        }));
    }
    let lit = times.len() - black;
    if scene.sky.is_none() {
        skipped.push("no sky lookups: the scene has no sky".to_owned());
    } else if scene.sky_baked == Baked::None {
        skipped.push("no sky lookups: [sky] baked = \"none\"".to_owned());
    } else if lit == 0 {
        skipped.push("no sky lookups: the sky is black at every time".to_owned());
    } else if black > 0 {
        skipped.push(format!("no sky at {black} of {}: it is black then", count(times.len(), "time")));
    }
    if skies.len() < lit {
        skipped.push(format!(
            "{lit} times with light in the sky share {}",
            if skies.len() == 1 { "one".to_owned() } else { format!("{} distinct skies", skies.len()) }
        ));
    }
    (skies.into_iter().map(|(hour, _)| hour).collect(), sky_of)
}

/// The part of a harmonic that is the sky of an hour, in a transfer.
fn part(scene: &Scene, hour: f64) -> Option<TransferPart> {
    match scene.sky {
        Some(Sky::Harmonics { upper }) => harmonics::part_at(upper, hour),
        _ => None,
    }
}

fn sky_name(scene: &Scene, at: f64) -> String {
    part(scene, at).map_or_else(|| format!("sky at {}", hour(at)), harmonics::name)
}

/// The sky of an hour in a few hundred directions: equal signatures, equal skies (they come from one model).
fn signature(scene: &Scene, hour: f64) -> Vec<Vec3> {
    const RINGS: usize = 16;
    let Some(sky) = &scene.sky else { return Vec::new() };
    match sky {
        Sky::Constant { radiance } => return vec![radiance.as_vec3()],
        Sky::Image(_) => {
            let is_lit = !SkyTable::new(Some(sky), None, &[hour]).lit.is_empty();
            return vec![Vec3::splat(f32::from(u8::from(is_lit)))];
        }
        // The hour tells the parts apart.
        Sky::Harmonics { upper } => return vec![Vec3::new(1.0, f32::from(u8::from(*upper)), hour as f32)],
        Sky::HosekWilkie { .. } => {}
    }
    sky::radiances(sky, scene.location.as_ref(), hour, &directions(RINGS))
}

/// Directions of the upper hemisphere, ring by ring.
fn directions(rings: usize) -> Vec<Vec3> {
    (0..rings * rings)
        .map(|i| {
            let (y, phi) = (
                (i / rings) as f32 / rings as f32,
                (i % rings) as f32 / rings as f32 * std::f32::consts::TAU,
            );
            let r = (1.0 - y * y).sqrt();
            Vec3::new(r * phi.cos(), y, r * phi.sin())
        })
        .collect()
}

impl PlannedGroup {
    fn new(group: &crate::scene::Group, index: usize, geometry: &Geometry) -> Self {
        let emission: Vec<DVec3> = geometry
            .materials
            .iter()
            .map(|m| match m.emission {
                Some(emission) if emission.group as usize == index => emission.radiance.as_dvec3(),
                _ => DVec3::ZERO,
            })
            .collect();
        let lights = group.lamps.iter().map(Lamp::light).chain(emission.iter().copied());
        let scale = lights.fold(DVec3::ZERO, DVec3::max);
        // Rounded to single precision, in which equal ratios stay equal when all are multiplied.
        let unit = |light: DVec3| {
            let ratio = |l: f64, s: f64| if s > 0.0 { f64::from((l / s) as f32) } else { 0.0 };
            DVec3::new(ratio(light.x, scale.x), ratio(light.y, scale.y), ratio(light.z, scale.z))
        };
        PlannedGroup {
            name: group.name.clone(),
            index: index as u32,
            scale: scale.as_vec3(),
            lamps: group.lamps.iter().map(|lamp| lamp.clone().with_light(unit(lamp.light()))).collect(),
            emission: emission.into_iter().map(|e| unit(e).as_vec3()).collect(),
            maps: geometry.emission_map_digest(index as u32),
            baked: group.baked,
        }
    }

    fn light(&self, geometry: &Geometry) -> GroupLight {
        let mut emitters = emitters(geometry, self.index);
        for emitter in &mut emitters {
            let material = geometry.material_of[emitter.triangle as usize];
            let radiance = self.emission[material as usize];
            emitter.radiance = match geometry.materials[material as usize].emission.and_then(|e| e.map) {
                None => radiance,
                Some(_) => radiance * geometry.emission_map_mean(emitter.triangle as usize),
            };
        }
        let name = blake3::hash(self.name.as_bytes());
        let key = u32::from_le_bytes([
            name.as_bytes()[0],
            name.as_bytes()[1],
            name.as_bytes()[2],
            name.as_bytes()[3],
        ]);
        GroupLight {
            sampler: GroupSampler::new(&self.lamps, &emitters, geometry.origin),
            emission: self.emission.clone(),
            has_maps: self.maps.is_some(),
            key,
        }
    }
}
