//! `config.json`: the manifest of a dataset.

use crate::digest::Digest;
use serde::{Deserialize, Serialize};
use serde_json::json;

mod halved;
mod layers;

pub use halved::Halved;
pub use layers::{Baked, Daylight, Layer, Light, Part};

/// The value of [`Config::format`].
pub const FORMAT: &str = "temporal-lightmaps";
/// The version of the format that this crate reads and writes.
pub const VERSION: u32 = 2;

/// The manifest. Everything in it is reproducible; timings are in `run.json`. All keys are always present,
/// with `None` as `null` (`deserialize_with` makes serde insist on them).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Always [`FORMAT`].
    pub format: String,
    /// Always [`VERSION`].
    pub version: u32,
    /// The scene's name, a single path component.
    pub scene: String,
    /// The program that wrote the dataset, e.g. `bake 0.1.0`.
    pub generator: String,
    /// Unit of the texels, as text.
    pub unit: String,
    /// The seed all randomness derives from.
    pub seed: u64,
    /// Digest of everything that decides the texels (settings, geometry, textures): equal digests, equal
    /// datasets, but for noise that earlier bakes in the folder left, and for where a time limit fell.
    pub inputs: String,
    /// Samples of indirect light per texel of the last round: those of a texel of mean deviation, or their
    /// maximum if the bake had a target or a time limit. (The writer's report has the average number drawn.)
    pub samples: u32,
    /// The lightmaps' pages.
    pub pages: Vec<Page>,
    /// The sun; `None` if the scene has none, or the writer does not know of it.
    #[serde(deserialize_with = "Option::deserialize")]
    pub sun: Option<Daylight>,
    /// The sky, in the same way.
    #[serde(deserialize_with = "Option::deserialize")]
    pub sky: Option<Daylight>,
    /// The light groups, in the order their layers are summed.
    pub groups: Vec<Group>,
    /// The shares of each light: sun, sky, groups in their order, lamps; of each direct before indirect.
    /// Empty if layers are not stored.
    pub layers: Vec<Layer>,
    /// The frames, by ascending hour.
    pub frames: Vec<Frame>,
    /// Estimated sampling error per tile and frame, where the writer knows it: a [`Noise`] file.
    #[serde(deserialize_with = "Option::deserialize")]
    pub noise: Option<FileRef>,
    /// The geometry with its lightmap coordinates (glTF binary).
    #[serde(deserialize_with = "Option::deserialize")]
    pub geometry: Option<FileRef>,
    /// The chart placements of the geometry's instances, in the order of the nodes of [`Config::geometry`]
    /// that have lightmap coordinates; empty if the writer does not know. An instance too large for one page
    /// is several nodes.
    pub instances: Vec<Instance>,
    /// The resolved settings of the writer, for the reader's information.
    pub settings: serde_json::Value,
    /// The sun by the minute: a [`super::sun::SunPath`]. Only datasets of scenes with a sun have the key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sun_path: Option<FileRef>,
    /// The sun's visibility as a function of time. Only datasets that hold it have the key; they have a
    /// `sun_path`, too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub visibility: Option<SunVisibility>,
    /// Where an imported dataset comes from. Only imported datasets have the key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<Source>,
    /// The functions and coefficients of a scene's transfer. Only transfers have the key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub transfer: Option<Transfer>,
}

/// Hours between two times of day, the short way around the clock.
pub fn hours_apart(a: f64, b: f64) -> f64 {
    let straight = (a - b).abs();
    straight.min(24.0 - straight)
}

impl Config {
    /// The frame that is nearest to an hour around the clock.
    pub fn nearest_frame(&self, hour: f64) -> Option<usize> {
        let away = |frame: &usize| hours_apart(self.frames[*frame].hour, hour);
        (0..self.frames.len()).min_by(|a, b| away(a).total_cmp(&away(b)))
    }

    /// The names of the light groups that are on at a frame.
    pub fn names_on(&self, frame: &Frame) -> impl Iterator<Item = &str> {
        self.groups.iter().zip(&frame.groups_on).filter(|(_, on)| **on).map(|(group, _)| &*group.name)
    }

    /// Digest of the light itself, which bundles record: hours, schedules, and the content of masks and
    /// lightmaps. Equal light has the same digest in every version of the format.
    pub fn digest_of_light(&self) -> String {
        let pages: Vec<_> =
            self.pages.iter().map(|page| json!([page.width, page.height, page.mask.blake3])).collect();
        let groups: Vec<_> = self.groups.iter().map(|group| json!([group.name, group.on])).collect();
        let frame = |frame: &Frame| {
            let maps: Vec<_> = frame.maps.iter().map(|map| &map.blake3).collect();
            json!([frame.hour, frame.groups_on, maps])
        };
        let frames: Vec<_> = self.frames.iter().map(frame).collect();
        let all = json!([self.scene, pages, groups, frames]).to_string();
        blake3::hash(all.as_bytes()).to_hex().to_string()
    }
}

/// The sun's visibility as a function of time, page by page.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SunVisibility {
    /// The finest step between its times, in minutes.
    pub minutes: f64,
    /// Per page, a [`super::visibility::Visibility`].
    pub files: Vec<FileRef>,
    /// Per page, the normals by which visibility becomes light: [`super::normals::Normals`].
    pub normals: Vec<FileRef>,
}

impl SunVisibility {
    /// All files that it names.
    pub fn references(&self) -> impl Iterator<Item = &FileRef> {
        self.files.iter().chain(&self.normals)
    }
}

/// A scene's transfer: each frame is the irradiance under one part of a spherical harmonic as the sky, and
/// the scene's own daylight is about a sum of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Transfer {
    /// The name of the scene whose transfer it is.
    pub scene: String,
    /// [`Config::inputs`] of a bake of the scene's whole day by the same settings: the dataset that it goes
    /// with.
    pub inputs: String,
    /// Per frame, the light that it shows.
    pub parts: Vec<TransferPart>,
    /// The scene's sky and sun at its times, by ascending hour.
    pub light: Vec<TransferLight>,
}

/// One sign of one function: max(Y, 0), or max(−Y, 0).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferPart {
    /// Index of the function, l² + l + m of the harmonic.
    pub function: u32,
    /// True for the negative part.
    pub negative: bool,
}

/// The light of one time in terms of the functions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferLight {
    /// The time, in hours, 0 ≤ hour < 24.
    pub hour: f64,
    /// Per function, its coefficients for red, green and blue.
    pub coefficients: Vec<[f64; 3]>,
}

/// The origin of an imported dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// What was read: the name of a [`crate::layout::Layout`], or [`crate::layout::EXR`].
    #[serde(deserialize_with = "crate::layout::read_name")]
    pub layout: String,
    /// Its configuration file as it was, where the layout has one: it names the lightmaps, and an export to
    /// the same layout writes it again.
    #[serde(deserialize_with = "Option::deserialize")]
    pub config: Option<FileRef>,
    /// Values outside the masks that were negative or not finite, and are 0 here.
    pub replaced_values: u64,
}

/// The kind of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PageKind {
    /// The charts of surfaces.
    Atlas,
}

/// One page: an independent lightmap image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Page {
    /// The page's kind.
    pub kind: PageKind,
    /// Width in texels, at least 1.
    pub width: u32,
    /// Height in texels, at least 1.
    pub height: u32,
    /// The validity mask: 8-bit grey PNG, 255 where a texel is valid: surface that light reaches; 0
    /// elsewhere.
    pub mask: FileRef,
}

impl Page {
    /// Width and height in texels.
    pub fn size(&self) -> [usize; 2] {
        [self.width as usize, self.height as usize]
    }
}

impl Page {
    /// An atlas page of this size in texels.
    pub fn atlas(width: u32, height: u32, mask: FileRef) -> Self {
        Page { kind: PageKind::Atlas, width, height, mask }
    }
}

/// The chart placement of one instance: `page coordinates = scale × TEXCOORD_1 + offset`, per axis, where
/// TEXCOORD_1 is that of its mesh in [`Config::geometry`] (instances may share a mesh) and page coordinates
/// run from (0, 0), the page's top left corner, to (1, 1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Instance {
    /// The name of its node in the geometry; several may have the same, the parts of one mesh on several
    /// pages among them.
    pub name: String,
    /// Index into [`Config::pages`].
    pub page: u32,
    /// Page coordinates per layout coordinate, along u and v.
    pub scale: [f32; 2],
    /// Page coordinates of the layout's top left corner.
    pub offset: [f32; 2],
}

/// A named group of lights that switch together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Group {
    /// The group's name.
    pub name: String,
    /// Open on-intervals `[from, to]` in hours; `from > to` crosses midnight; `[0, 24]` is always on.
    pub on: Vec<[f64; 2]>,
    /// Which part of its light the lightmaps hold.
    pub baked: Baked,
}

impl Group {
    /// Faults of the schedule: each interval whose ends are not two different hours in [0, 24].
    pub fn faults_of_schedule(&self) -> impl Iterator<Item = String> + '_ {
        let is_hour = |hour| (0.0..=24.0).contains(&hour);
        let bad = self.on.iter().filter(move |&&[from, to]| !is_hour(from) || !is_hour(to) || from == to);
        bad.map(|[from, to]| {
            format!("group {:?}: on {from} to {to}; expected two different hours in [0, 24]", self.name)
        })
    }

    /// True if the schedule has the light group on at an hour; `None` exactly at the ends of its intervals,
    /// where several may meet.
    pub fn is_on(&self, hour: f64) -> Option<bool> {
        let ends = self.on.iter().flatten();
        // Whole days have no ends.
        if self.on.iter().any(|[from, to]| to - from >= 24.0) {
            return Some(true);
        }
        if ends.into_iter().any(|end| hours_apart(*end, hour) < 1e-6) {
            return None;
        }
        Some(self.on.iter().any(|&[from, to]| match from < to {
            true => from < hour && hour < to,
            false => from < hour || hour < to,
        }))
    }
}

/// All lightmaps of one time of day. Where layers are stored, each is `(sun + sky) + local` in float32, bit
/// for bit: `sun` is direct + indirect, `local` the sum of the lights of the groups that are on, in order,
/// starting from zero, each direct + indirect. In imported datasets `local` is the layer of the lamps, and
/// the sum holds about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// The time, in hours, 0 ≤ hour < 24.
    pub hour: f64,
    /// For each group of [`Config::groups`], whether it is on.
    pub groups_on: Vec<bool>,
    /// Estimated relative error of the frame (root of the mean squared standard error over valid texels ÷
    /// their mean).
    #[serde(deserialize_with = "Option::deserialize")]
    pub relative_error: Option<f64>,
    /// One lightmap per page: RGB float32 EXR, linear Rec. 709 irradiance.
    pub maps: Vec<FileRef>,
}

/// A file of the dataset. Identical content is stored once, so several entries may name one file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileRef {
    /// Path relative to the folder of `config.json`, with `/`.
    pub path: String,
    /// Length in bytes.
    pub bytes: u64,
    /// BLAKE3 of the content.
    pub blake3: Digest,
}

/// Sampling error per tile: the content of the file [`Config::noise`] names (JSON).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Side of the tiles in texels (128), tiles counted row by row from texel (0, 0).
    pub tile: u32,
    /// `mse[frame][page][tile]`: mean over the tile's valid texels and channels of the squared standard
    /// error.
    pub mse: Vec<Vec<Vec<f64>>>,
}
