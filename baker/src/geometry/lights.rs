//! Light groups for what shines in geometry files: lamps, glowing materials, and a sun.

use super::Emission;
use super::contents::FileLampKind;
use super::look::fits;
use super::model::{FileMaterial, Model};
use super::notes::{self, Notes};
use super::texture::TextureStore;
use crate::scene::{Group, Lamp, Look, Scene, Sky, Sun, SunKey, SunTrack};
use glam::DVec3;
use std::collections::BTreeSet;
use std::path::Path;

/// Most groups that the scene file does not name; more become one.
const MOST_GROUPS: usize = 16;
/// Name of the group of all that the scene file does not name, where it has that group or there is too much.
const REST: &str = "file";
/// A lamp of a file this near to one of the scene file is the same, in metres.
const SAME_LAMP: f64 = 0.1;
/// Full angle of the disc of a file's sun in degrees.
const DISC_ANGLE: f64 = 0.533;
/// The brightest light, in kcd or klx.
const BRIGHTEST: f64 = 1e12;
/// Candela per kilocandela, lux per kilolux.
const KILO: f64 = 1000.0;

/// What shines in geometry files and belongs among the lights of the scene.
#[derive(Clone, Debug, Default)]
pub struct FileLights {
    /// Groups that follow those of the scene file; lit all day.
    groups: Vec<Group>,
    /// Lamps, each with its group's index.
    lamps: Vec<(usize, Lamp)>,
    sun: Option<Sun>,
}

impl FileLights {
    /// Adds the lamps, groups and the sun of the files to the scene they were loaded for.
    pub fn add_to(&self, scene: &mut Scene) {
        scene.groups.extend(self.groups.iter().cloned());
        for (group, lamp) in &self.lamps {
            scene.groups[*group].lamps.push(lamp.clone());
        }
        if scene.sun.is_none() {
            scene.sun = self.sun.clone();
        }
    }
}

/// Groups by name, as they are gathered: those of the scene, then those of the files.
pub(super) struct Groups<'a> {
    scene: &'a Scene,
    /// Names that the scene file does not have, in the order first met.
    new: Vec<String>,
    /// Per group of the scene, whether something of a file belongs to it.
    met: Vec<bool>,
    /// All names by which a group could have something of a file.
    names: BTreeSet<String>,
    /// Emission maps that are black all over.
    is_black: Vec<bool>,
    /// Materials that emit: file and number in it.
    glowing: BTreeSet<(std::path::PathBuf, usize)>,
}

/// The lamps of all files in the world, and the sun.
#[derive(Default)]
pub(super) struct Lamps {
    lamps: Vec<(u32, Lamp)>,
    sun: Option<Sun>,
}

impl<'a> Groups<'a> {
    /// Those of the scene.
    pub fn new(scene: &'a Scene, textures: &mut TextureStore) -> Self {
        let maps = &textures.emission().textures;
        let is_black =
            maps.iter().map(|map| map.rgba.iter().all(|[r, g, b, _]| [r, g, b] == [&0; 3])).collect();
        let met = vec![false; scene.groups.len()];
        Groups { scene, new: Vec::new(), met, names: BTreeSet::new(), is_black, glowing: BTreeSet::new() }
    }

    /// The group of something with these names, the first of which is its own, by the first that a group of the scene file has or lists; else
    /// a group of its own name.
    fn of(&mut self, names: &[&str]) -> u32 {
        let own = names.first().copied().unwrap_or("unnamed");
        self.names.insert(own.to_owned());
        let of_scene = |name: &&str| {
            let by_name = self.scene.groups.iter().position(|group| group.name == *name);
            let lists = || self.scene.lights.names.iter().find(|(pattern, _)| fits(pattern, name));
            by_name.or_else(|| lists().map(|(_, group)| *group))
        };
        let group = names.iter().find_map(of_scene).or_else(|| of_scene(&REST));
        if let Some(group) = group {
            self.met[group] = true;
            return group as u32;
        }
        let at = self.new.iter().position(|name| name == own).unwrap_or_else(|| {
            self.new.push(own.to_owned());
            self.new.len() - 1
        });
        (self.scene.groups.len() + at) as u32
    }

    /// What a material of a file emits under a look: what that says, else what the file says. `named` are the names of node, mesh and
    /// material that are not empty; `place` is the material's file and its number there.
    pub fn emission(
        &mut self,
        look: &Look,
        material: &FileMaterial,
        named: &[&str],
        place: (&Path, usize),
    ) -> Option<Emission> {
        let group_of = |name: &String| self.scene.groups.iter().position(|group| group.name == *name);
        let by_look = look.group.as_ref().and_then(group_of);
        if let Some(radiance) = look.emission {
            let group = by_look? as u32;
            return Some(Emission { radiance: radiance.as_vec3(), group, map: None });
        }
        let emission = material.emission.filter(|_| self.scene.lights.from_file)?;
        let radiance = emission.value.as_dvec3() * self.scene.lights.emission;
        let is_black = emission.texture.is_some_and(|map| self.is_black[map as usize]);
        if is_black || radiance.max_element() <= 0.0 {
            return None;
        }
        let group = match by_look {
            Some(group) => {
                self.met[group] = true;
                group as u32
            }
            None => {
                let own = (!material.name.is_empty()).then_some(material.name.as_str());
                let mut names: Vec<&str> = own.into_iter().chain(named.iter().copied()).collect();
                names.dedup();
                self.of(&names)
            }
        };
        self.glowing.insert((place.0.to_owned(), place.1));
        let radiance = radiance.min(DVec3::splat(BRIGHTEST)).as_vec3();
        Some(Emission { radiance, group, map: emission.texture })
    }

    /// The lights of the files, told in `warnings`; and the group that all emission of later groups belongs to, where there are too many.
    pub fn finish(
        self,
        scene: &Scene,
        lamps: Lamps,
        warnings: &mut Vec<String>,
    ) -> (FileLights, Option<u32>) {
        let Groups { mut new, met, names, glowing, .. } = self;
        let first = scene.groups.len();
        let of_files = |n: usize, noun: &str| (n > 0).then(|| notes::plural(n, noun));
        let free = lamps.lamps.iter().filter(|(group, _)| *group as usize >= first).count();
        let what: Vec<String> = [of_files(free, "lamp"), of_files(glowing.len(), "glowing material")]
            .into_iter()
            .flatten()
            .collect();
        let merged = (new.len() > MOST_GROUPS).then_some(first as u32);
        if merged.is_some() {
            warnings.push(format!(
                "{} of files shine all day in one light group, \"{REST}\", because they have {} names ({}): a [[group]] with \
                 `lights = [\"{}\"]` (* stands for any characters) takes some of them and switches them; `from_file = false` in [lights] leaves all out",
                what.join(" and "),
                new.len(),
                notes::list(&new, new.len()),
                new[0]
            ));
            new = vec![REST.to_owned()];
        } else if !new.is_empty() {
            warnings.push(format!(
                "{} of files shine all day, in the {} {}: a [[group]] of such a name in the scene file switches them; `from_file = false` in \
                 [lights] leaves them out",
                what.join(" and "),
                if new.len() == 1 { "light group" } else { "light groups" },
                new.iter().map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", ")
            ));
        }
        let names: Vec<String> = names.into_iter().collect();
        for (group, met) in scene.groups.iter().zip(met) {
            let looks = scene.objects.iter().flat_map(|o| o.parts.iter().map(|p| &p.look).chain([&o.look]));
            let shines = |look: &Look| look.emission.is_some() && look.group.as_ref() == Some(&group.name);
            if group.lamps.is_empty() && !met && !looks.into_iter().any(shines) {
                let have = match names.is_empty() {
                    true => "nothing of the files shines".to_owned(),
                    false => {
                        format!("what shines in the files is called {}", notes::list(&names, names.len()))
                    }
                };
                warnings.push(format!("group \"{}\" has no lamp and no emission ({have})", group.name));
            }
        }
        let group = |name| Group { name, on: vec![[0.0, 24.0]], lamps: Vec::new() };
        let to = |group: u32| merged.map_or(group, |most| group.min(most)) as usize;
        let lights = FileLights {
            groups: new.into_iter().map(group).collect(),
            lamps: lamps.lamps.into_iter().map(|(group, lamp)| (to(group), lamp)).collect(),
            sun: lamps.sun,
        };
        (lights, merged)
    }
}

/// Places the lamps of all files in the world. `model_of` has the index of each object's model.
pub(super) fn lamps(
    scene: &Scene,
    models: &[(String, Model)],
    model_of: &[Option<usize>],
    groups: &mut Groups,
    notes: &mut Notes,
) -> Lamps {
    let mut found = Lamps::default();
    if !scene.lights.from_file {
        return found;
    }
    let taken: Vec<DVec3> = scene.groups.iter().flat_map(|g| &g.lamps).map(middle).collect();
    let mut suns: Vec<(DVec3, DVec3)> = Vec::new();
    for (object, model) in scene.objects.iter().zip(model_of) {
        let Some(model) = model.map(|index| &models[index].1) else { continue };
        let file = object.file.display().to_string();
        for lamp in &model.contents.lamps {
            let light = lamp.colour * (lamp.intensity / KILO * scene.lights.scale);
            if light.max_element() <= 0.0 {
                notes.add(&file, "lamp", &lamp.name, "gives no light: its colour or its intensity is 0");
                continue;
            }
            let light = light.min(DVec3::splat(BRIGHTEST));
            for world_from_file in &object.world_from_file {
                let (position, direction) = (lamp.position(world_from_file), lamp.direction(world_from_file));
                let direction = match (lamp.kind, direction) {
                    (FileLampKind::Point, _) => DVec3::NEG_Y,
                    (_, Some(direction)) => direction,
                    (_, None) => {
                        notes.add(
                            &file,
                            "lamp",
                            &lamp.name,
                            "left out: its transform leaves it no direction",
                        );
                        continue;
                    }
                };
                if !position.is_finite() {
                    notes.add(
                        &file,
                        "lamp",
                        &lamp.name,
                        "left out: its transform leads out of the range of numbers",
                    );
                    continue;
                }
                if taken.iter().any(|other| other.distance(position) < SAME_LAMP) {
                    let what = "left out: a lamp of the scene file stands within 0.1 m of it";
                    notes.add(&file, "lamp", &lamp.name, what);
                    continue;
                }
                let made = match lamp.kind {
                    FileLampKind::Directional => {
                        if let Some(what) = why_no_sun(scene, -direction, light) {
                            notes.add(&file, "directional light", &lamp.name, what);
                        } else {
                            suns.push((-direction, light));
                        }
                        continue;
                    }
                    FileLampKind::Point => Lamp::Point { position, intensity: light },
                    FileLampKind::Spot { inner, outer } => {
                        Lamp::Spot { position, direction, inner, outer, intensity: light }
                    }
                };
                let names: Vec<&str> =
                    [&lamp.name].into_iter().chain(&lamp.parents).map(String::as_str).collect();
                found.lamps.push((groups.of(&names), made));
            }
        }
    }
    found.sun = sun(&suns, notes);
    found
}

/// Where a directional light is not used: why, and what to do. The sun and place of the scene go before it.
fn why_no_sun(scene: &Scene, to_sun: DVec3, light: DVec3) -> Option<String> {
    let write = || {
        let list = |v: DVec3| format!("[{:.4}, {:.4}, {:.4}]", v.x, v.y, v.z);
        format!("`track = [{{ hour = 0, direction = {}, irradiance = {} }}]`", list(to_sun), list(light))
    };
    match (&scene.sun, &scene.place, &scene.sky) {
        (Some(_), ..) => Some("left out: the scene file has a [sun]".to_owned()),
        (None, Some(_), _) => Some(format!(
            "left out: the scene file has a [place], whose sun a [sun] turns on; for the file's light at all hours write {} into it",
            write()
        )),
        (None, None, Some(Sky::Image(_))) => Some(format!(
            "left out: the picture of the sky may hold a sun; for the file's light at all hours write {} into [sun]",
            write()
        )),
        _ => None,
    }
}

/// The brightest of the directional lights as the sun of all hours.
fn sun(suns: &[(DVec3, DVec3)], notes: &mut Notes) -> Option<Sun> {
    let brightness = |&(_, light): &(DVec3, DVec3)| light.element_sum();
    let &(direction, irradiance) =
        suns.iter().reduce(|best, sun| if brightness(sun) > brightness(best) { sun } else { best })?;
    let others = match suns.len() - 1 {
        0 => String::new(),
        n => format!(" (the brightest; {} left out: a scene has one sun)", notes::plural(n, "other")),
    };
    notes.add(
        "[sun]",
        "source",
        format!("a directional light of a file{others}"),
        "it shines from the same direction at all hours; a [sun] with a [place] follows the day",
    );
    let track = SunTrack::Authored(vec![SunKey { hour: 0.0, direction, irradiance }]);
    Some(Sun { disc_angle: DISC_ANGLE, track })
}

/// The middle of a lamp.
fn middle(lamp: &Lamp) -> DVec3 {
    match lamp {
        Lamp::Sphere { centre, .. } | Lamp::Disc { centre, .. } => *centre,
        Lamp::Point { position, .. } | Lamp::Spot { position, .. } | Lamp::Ies { position, .. } => *position,
        Lamp::Rectangle { corner, edge_u, edge_v, .. } => *corner + 0.5 * (*edge_u + *edge_v),
    }
}
