//! Shares of the light: which part of each light is baked, and the images that hold it.

use super::{Config, FileRef};
use serde::{Deserialize, Serialize};

/// Which part of a light the lightmaps hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Baked {
    /// All of it.
    All,
    /// Only indirect light; the reader draws the direct light.
    Indirect,
    /// Nothing.
    None,
}

impl Baked {
    /// As in the manifest.
    pub fn name(self) -> &'static str {
        match self {
            Baked::All => "all",
            Baked::Indirect => "indirect",
            Baked::None => "none",
        }
    }
}

/// The scene's sun or sky.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Daylight {
    /// Which part of it the lightmaps hold.
    pub baked: Baked,
}

/// A light, or a kind of lights, with its own layers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Light {
    /// The sun.
    Sun,
    /// The sky.
    Sky,
    /// One light group: as if it were always on.
    Group,
    /// All lamps together, in imported datasets: those that are on in each frame.
    Lamps,
}

impl Light {
    /// As in the manifest.
    pub fn name(self) -> &'static str {
        match self {
            Light::Sun => "sun",
            Light::Sky => "sky",
            Light::Group => "group",
            Light::Lamps => "lamps",
        }
    }
}

/// A part of a light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Part {
    /// Direct light.
    Direct,
    /// Indirect light.
    Indirect,
    /// Both in one.
    All,
}

impl Part {
    /// As in the manifest.
    pub fn name(self) -> &'static str {
        match self {
            Part::Direct => "direct",
            Part::Indirect => "indirect",
            Part::All => "all",
        }
    }
}

/// Images of one part of one light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Layer {
    /// The light.
    pub light: Light,
    /// Index into [`Config::groups`] for [`Light::Group`]; `None` for others.
    #[serde(deserialize_with = "Option::deserialize")]
    pub group: Option<u32>,
    /// The part of its light.
    pub part: Part,
    /// `files[frame][page]`; of a light group, whose light does not depend on the hour, `files[0][page]`.
    /// `None` is black.
    pub files: Vec<Vec<Option<FileRef>>>,
    /// Interpolation between two frames: a [`crate::format::curve::Curve`]; linear without one. Light groups
    /// have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curve: Option<FileRef>,
}

impl Layer {
    /// The image of a frame on a page; `None` if it is black.
    pub fn file(&self, frame: usize, page: usize) -> Option<&FileRef> {
        let row = if self.light == Light::Group { 0 } else { frame };
        self.files.get(row)?.get(page)?.as_ref()
    }

    /// True if it holds all of the sun's light in one.
    pub fn is_whole_sun(&self) -> bool {
        (self.light, self.part) == (Light::Sun, Part::All)
    }

    /// True for direct light of the sun, which the sun's visibility gives at any time.
    pub fn is_direct_sun(&self) -> bool {
        (self.light, self.part) == (Light::Sun, Part::Direct)
    }

    /// All images that it names.
    pub fn files(&self) -> impl Iterator<Item = &FileRef> {
        self.files.iter().flatten().flatten()
    }
}

impl Config {
    /// The layers of a light, in the order in which they are summed; `group` is that of [`Layer::group`].
    pub fn layers_of(&self, light: Light, group: Option<u32>) -> impl Iterator<Item = &Layer> {
        self.layers.iter().filter(move |layer| (layer.light, layer.group) == (light, group))
    }

    /// The files whose sum is one light's part of a lightmap, in the order in which they are summed; empty if
    /// it is black.
    pub fn files_of(&self, light: Light, group: Option<u32>, frame: usize, page: usize) -> Vec<&FileRef> {
        self.layers_of(light, group).filter_map(|layer| layer.file(frame, page)).collect()
    }

    /// Per light whose sum is the local light of a frame on a page, its [`Config::files_of`]: the groups that
    /// are on, then the lamps of an imported dataset.
    pub fn files_of_local(&self, frame: usize, page: usize) -> Vec<Vec<&FileRef>> {
        let on = (0u32..).zip(&self.frames[frame].groups_on).filter(|(_, on)| **on);
        let groups = on.map(|(group, _)| self.files_of(Light::Group, Some(group), frame, page));
        groups
            .chain([self.files_of(Light::Lamps, None, frame, page)])
            .filter(|files| !files.is_empty())
            .collect()
    }
}
