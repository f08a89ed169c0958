//! Light groups for the emitters in geometry files.

use super::Emission;
use super::model::FileMaterial;
use super::names::{Names, fits};
use super::near;
use super::notes;
use super::texture::TextureStore;
use crate::scene::{Baked, Group, Lamp, Scene, Sun, SurfaceOverrides};
use glam::DVec3;
use std::collections::BTreeSet;
use std::path::Path;

/// Most groups that the scene file does not name; more become one.
const MOST_GROUPS: usize = 16;
/// Name of the group of all that the scene file does not name, where it has that group or there is too much.
const REST: &str = "file";
/// What has no name is called so.
const UNNAMED: &str = "unnamed";
/// The brightest light, in kcd or klx.
pub(super) const BRIGHTEST: f64 = 1e12;

/// The emitters in geometry files that belong among the lights of the scene.
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
    is_used: Vec<bool>,
    /// Per group of the scene, a pattern of its `lights` and the group that has what fits it instead.
    unused_reason: Vec<Option<(&'a str, usize)>>,
    /// All names by which a group could have something of a file.
    names: BTreeSet<String>,
    /// Emission maps that are black all over.
    is_black: Vec<bool>,
    /// Materials that emit in groups of their own: file and number in it.
    glowing: BTreeSet<(std::path::PathBuf, usize)>,
    /// Per group of the scene, what would belong to it if it did not move.
    moving: Vec<Vec<String>>,
}

/// The lamps of all files in the world, and the sun.
#[derive(Default)]
pub(super) struct Lamps {
    /// Each with its group.
    pub lamps: Vec<(u32, Lamp)>,
    pub sun: Option<Sun>,
}

impl<'a> Groups<'a> {
    /// Those of the scene.
    pub(super) fn new(scene: &'a Scene, textures: &mut TextureStore) -> Self {
        let maps = &textures.emission().textures;
        let is_black =
            maps.iter().map(|map| map.rgba.iter().all(|[r, g, b, _]| [r, g, b] == [&0; 3])).collect();
        let is_used = vec![false; scene.groups.len()];
        Groups {
            scene,
            new: Vec::new(),
            unused_reason: vec![None; is_used.len()],
            moving: vec![Vec::new(); is_used.len()],
            is_used,
            names: BTreeSet::new(),
            is_black,
            glowing: BTreeSet::new(),
        }
    }

    /// The group of something with these names, the first of which is its own, by the first that a group of
    /// the scene file has or lists; else a group of its own name.
    pub(super) fn of(&mut self, names: &Names) -> u32 {
        let own = names.first().unwrap_or(UNNAMED);
        self.names.insert(own.to_owned());
        let group = self.of_scene(names).or_else(|| self.of_scene_by(REST));
        if let Some(group) = group {
            self.give(group, names);
            return group as u32;
        }
        let at = self.new.iter().position(|name| name == own).unwrap_or_else(|| {
            self.new.push(own.to_owned());
            self.new.len() - 1
        });
        (self.scene.groups.len() + at) as u32
    }

    /// The group of the scene that has or lists the nearest name.
    fn of_scene(&self, names: &Names) -> Option<usize> {
        names.iter().find_map(|name| self.of_scene_by(name))
    }

    /// The group of the scene that has or lists a name.
    fn of_scene_by(&self, name: &str) -> Option<usize> {
        let by_name = self.scene.groups.iter().position(|group| group.name == name);
        let lists = || self.scene.lights.names.iter().find(|(pattern, _)| fits(pattern, name));
        by_name.or_else(|| lists().map(|(_, group)| *group))
    }

    /// Notes something that would shine if it did not move, in the group `by_overrides` or that of its names.
    pub(super) fn leave_out(&mut self, names: &Names, by_overrides: Option<usize>) {
        if let Some(group) = by_overrides.or_else(|| self.of_scene(names)) {
            let name = names.first().unwrap_or(UNNAMED).to_owned();
            if !self.moving[group].contains(&name) {
                self.moving[group].push(name);
            }
        }
    }

    /// Notes that a group of the scene has something with these names, and that others do not which list it.
    fn give(&mut self, group: usize, names: &Names) {
        self.is_used[group] = true;
        for (pattern, other) in &self.scene.lights.names {
            if *other != group && names.fit(pattern) {
                self.unused_reason[*other].get_or_insert((pattern, group));
            }
        }
    }

    /// What a material of a file emits under overrides, in no group yet: what they say, else what the file
    /// says.
    fn shining(&self, overrides: &SurfaceOverrides, material: &FileMaterial) -> Option<Emission> {
        let group = u32::MAX;
        if let Some(radiance) = overrides.emission {
            return Some(Emission { radiance: radiance.as_vec3(), group, map: None });
        }
        let emission = material.emission.filter(|_| self.scene.lights.from_file)?;
        let radiance = emission.value.as_dvec3() * self.scene.lights.emission;
        let is_black = emission.texture.is_some_and(|map| self.is_black[map as usize]);
        let radiance = radiance.min(DVec3::splat(BRIGHTEST)).as_vec3();
        let shines = !is_black && radiance.max_element() > 0.0;
        shines.then_some(Emission { radiance, group, map: emission.texture })
    }

    /// The group of the scene that overrides name.
    fn by_overrides(&self, overrides: &SurfaceOverrides) -> Option<usize> {
        let name = overrides.group.as_ref()?;
        self.scene.groups.iter().position(|group| group.name == *name)
    }

    /// What a material that moves would emit: for the geometry file alone.
    pub(super) fn emission_left_out(
        &mut self,
        overrides: &SurfaceOverrides,
        material: &FileMaterial,
        names: &Names,
    ) -> Option<Emission> {
        let emission = self.shining(overrides, material)?;
        if emission.radiance.max_element() > 0.0 {
            self.leave_out(names, self.by_overrides(overrides));
        }
        Some(emission)
    }

    /// What a material of a file emits under overrides: what they say, else what the file says. `place` is
    /// the material's file and its number there.
    pub(super) fn emission(
        &mut self,
        overrides: &SurfaceOverrides,
        material: &FileMaterial,
        names: &Names,
        place: (&Path, usize),
    ) -> Option<Emission> {
        let emission = self.shining(overrides, material)?;
        let by_overrides = self.by_overrides(overrides);
        if overrides.emission.is_some() {
            return Some(Emission { group: by_overrides? as u32, ..emission });
        }
        let group = match by_overrides {
            Some(group) => {
                self.give(group, names);
                group as u32
            }
            None => self.of(names),
        };
        if group as usize >= self.scene.groups.len() {
            self.glowing.insert((place.0.to_owned(), place.1));
        }
        Some(Emission { group, ..emission })
    }

    /// The lights of the files, told in `warnings`; and the group that all emission of later groups belongs
    /// to, where there are too many.
    pub(super) fn finish(
        self,
        scene: &Scene,
        lamps: Lamps,
        warnings: &mut Vec<String>,
    ) -> (FileLights, Option<u32>) {
        let Groups { mut new, is_used, unused_reason, names, glowing, moving, .. } = self;
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
                "lit all day: {} of files, in one light group, \"{REST}\", because they have {} names ({}): a [[group]] with \
                 `lights = [\"*\"]` takes them all and switches them, one with `lights = [{:?}]` some (* stands for any characters); \
                 `from_file = false` in [lights] leaves all out",
                what.join(" and "),
                new.len(),
                notes::list(&new, new.len()),
                pattern_like(&new[0])
            ));
            new = vec![REST.to_owned()];
        } else if !new.is_empty() {
            warnings.push(format!(
                "lit all day: {} of files, in the {} {}: a [[group]] of such a name in the scene file switches them; `from_file = false` in \
                 [lights] leaves them out",
                what.join(" and "),
                if new.len() == 1 { "light group" } else { "light groups" },
                new.iter().map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", ")
            ));
        }
        for (group, names) in scene.groups.iter().zip(&moving).filter(|(_, names)| !names.is_empty()) {
            warnings.push(format!(
                "light group {:?} lacks the light of lamps and materials that move ({}): the game has to add it, or `movable = false` bakes them where they stand",
                group.name,
                notes::list(names, names.len())
            ));
        }
        let names: Vec<String> = names.into_iter().collect();
        for (number, ((group, is_used), unused_reason)) in
            scene.groups.iter().zip(is_used).zip(unused_reason).enumerate()
        {
            let all_overrides =
                scene.objects.iter().flat_map(|o| o.parts.iter().map(|p| &p.overrides).chain([&o.overrides]));
            let shines = |overrides: &SurfaceOverrides| {
                overrides.emission.is_some() && overrides.group.as_ref() == Some(&group.name)
            };
            let has_moving = !moving[number].is_empty();
            if group.lamps.is_empty() && !is_used && !has_moving && !all_overrides.into_iter().any(shines) {
                let lists = scene.lights.names.iter().filter(|(_, of)| *of == number);
                let lists: Vec<&str> =
                    lists.map(|(pattern, _)| pattern.as_str()).chain([group.name.as_str()]).collect();
                let near = near::nearest(&lists, names.iter().map(String::as_str));
                let have = match unused_reason {
                    Some((pattern, other)) => format!(
                        "what fits `lights = [{pattern:?}]` belongs to group {:?}; of groups that list the same, the first has it, so a group \
                         with fewer names should stand before one with more",
                        scene.groups[other].name
                    ),
                    None if names.is_empty() => "nothing of the files shines".to_owned(),
                    None if near.is_empty() => {
                        format!("the lights of the files are called {}", notes::list(&names, names.len()))
                    }
                    None => format!("similar names of lights: {}", notes::list(&near, near.len())),
                };
                warnings.push(format!("group \"{}\" has no lamp and no emission ({have})", group.name));
            }
        }
        let group = |name| Group { name, on: vec![[0.0, 24.0]], lamps: Vec::new(), baked: Baked::All };
        let to = |group: u32| merged.map_or(group, |most| group.min(most)) as usize;
        let lights = FileLights {
            groups: new.into_iter().map(group).collect(),
            lamps: lamps.lamps.into_iter().map(|(group, lamp)| (to(group), lamp)).collect(),
            sun: lamps.sun,
        };
        (lights, merged)
    }
}

/// A pattern that fits a name and those that differ from it in a number at the end.
fn pattern_like(name: &str) -> String {
    let stem = name.trim_end_matches(|c: char| c.is_ascii_digit() || "._- #".contains(c));
    if stem.is_empty() || stem == name { name.to_owned() } else { format!("{stem}*") }
}
