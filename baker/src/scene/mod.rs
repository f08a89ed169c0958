//! The scene file: TOML as typed (`raw`), and what it means with every default filled in (here).

mod raw;
pub mod colour;
mod radiance;
mod sky;
mod schedule;
mod ies;
mod lamp;
mod lights;
mod object;
mod camera;
mod load;

pub use ies::Profile;
pub use load::{is_reserved, load};
pub use object::transform_of;
pub use radiance::read_radiance;
pub use sky::SkyImage;

pub use dataset::pictures::Camera;

use dataset::{Error, Result};
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A radiance or irradiance that makes sense; what is computed from it stays finite in `f32`.
fn is_light(x: f64) -> bool {
    (0.0..=1e12).contains(&x)
}

/// Most samples per texel.
pub const MAX_SAMPLES: u32 = 1 << 20;
/// Widest angle of view of a camera, in degrees.
pub const MAX_FOV: f64 = 170.0;
/// Albedos above this are warned about: light hardly fades between bounces.
pub(crate) const WHITE: f64 = 0.98;

/// A scene file, resolved: no option left open, every value checked, every path joined to the scene file's
/// folder. The default has no light and no surface.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Scene {
    /// One path component, and none that [`is_reserved`].
    pub name: String,
    /// What the scene is for; may be empty. Kept in the manifest's settings.
    pub description: String,
    /// Where and when; needed when the sun or the sky follow the date.
    pub location: Option<Location>,
    /// The sun; `None`: the scene has none.
    pub sun: Option<Sun>,
    /// The sky; `None`: black.
    pub sky: Option<Sky>,
    /// Which part of the sun's light lightmaps hold.
    #[serde(skip_serializing_if = "Baked::is_all")]
    pub sun_baked: Baked,
    /// How finely the sun's visibility is followed in time; `None`: as goes with the bake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun_visibility: Option<SunVisibility>,
    /// Which part of the sky's light they hold.
    #[serde(skip_serializing_if = "Baked::is_all")]
    pub sky_baked: Baked,
    /// Albedo of the ground that is seen below the horizon, lit by sun and sky; `None`: what the sky shows
    /// there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<DVec3>,
    /// Whether the scene file says so; a computed sky has a ground by default.
    #[serde(skip)]
    pub ground_is_written: bool,
    /// Openings to the sky, in file order.
    pub portals: Vec<Portal>,
    /// Whether openings are found where none are authored. (What is found stands among them, where digests
    /// see it.)
    #[serde(skip)]
    pub find_portals: bool,
    /// The boxes of the rooms behind portals that lead outdoors, by opposite corners in the world.
    #[serde(skip)]
    pub rooms: Vec<[DVec3; 2]>,
    /// Geometry, in file order.
    pub objects: Vec<Object>,
    /// Light groups, in file order; names are unique.
    pub groups: Vec<Group>,
    /// What becomes of the lamps and glowing materials of geometry files. (What they give stands among the
    /// groups, where digests see it.)
    #[serde(skip)]
    pub lights: LightsOfFiles,
    /// Lightmap layout.
    pub lightmap: Lightmap,
    /// Where the file says how large the lightmaps are, and what, for messages: `yard.toml:30: size = 512`.
    #[serde(skip)]
    pub size_as_written: String,
    /// Sampling.
    pub bake: Sampling,
    /// Viewpoints for pictures, in file order; names are unique. No part of what is baked, nor of any digest;
    /// the manifest keeps them for reports.
    #[serde(skip)]
    pub cameras: Vec<Camera>,
}

impl Scene {
    /// Models by themselves, each in its own unit: no light, and every default.
    ///
    /// # Errors
    /// Files that are no models, are not there, or are given twice.
    pub fn of_models(files: &[PathBuf]) -> Result<Scene> {
        let mut errors: Vec<Error> = files.iter().filter_map(|file| object::why_no_model(file)).collect();
        let same = |a: &Path, b: &Path| match (a.canonicalize(), b.canonicalize()) {
            (Ok(a), Ok(b)) => a == b,
            _ => false,
        };
        errors.extend(files.iter().enumerate().filter(|(i, file)| files[..*i].iter().any(|f| same(f, file))).map(
            |(_, file)| {
                let what = "is given twice; in a scene file, `instances` of an [[object]] place a model more than once";
                Error::invalid(file.display(), what)
            },
        ));
        if errors.len() > 1 {
            let list: String = errors.iter().map(|error| format!("\n  {error}")).collect();
            return Err(Error::invalid("the models", format!("{} errors:{list}", errors.len())));
        }
        if let Some(error) = errors.pop() {
            return Err(error);
        }
        let object = |file: &PathBuf| Object {
            file: file.clone(),
            source_line: file.display().to_string(),
            world_from_file: vec![DMat4::IDENTITY],
            overrides: SurfaceOverrides::default(),
            parts: Vec::new(),
            vt_is_lightmap: false,
        };
        let objects = files.iter().map(object).collect();
        Ok(Scene { name: "model".to_owned(), find_portals: true, objects, ..Scene::default() })
    }
}

/// How finely the sun's visibility is followed in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum SunVisibility {
    /// Not at all.
    #[serde(rename = "off")]
    Off,
    /// To 15 minutes.
    #[serde(rename = "15min")]
    Quarters,
    /// To 2.5 minutes.
    #[serde(rename = "2.5min")]
    Fine,
}

impl SunVisibility {
    /// The finest step in minutes; `None` where it is off.
    pub fn minutes(self) -> Option<f64> {
        match self {
            SunVisibility::Off => None,
            SunVisibility::Quarters => Some(15.0),
            SunVisibility::Fine => Some(2.5),
        }
    }
}

/// A place on Earth and a civil date.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Location {
    /// Degrees, north positive.
    pub latitude: f64,
    /// Degrees, east positive.
    pub longitude: f64,
    /// Hours to add to UTC for local time.
    pub utc_offset: f64,
    /// Year, month, day.
    pub date: (i32, u32, u32),
    /// Degrees from −Z clockwise, seen from above, to north.
    pub north: f64,
    /// Whether the air lifts the sun, as the standard atmosphere does.
    pub refraction: bool,
}

/// The sun.
#[derive(Clone, Debug, Serialize)]
pub struct Sun {
    /// Full angle of the disc in degrees; 0: a direction.
    pub disc_angle: f64,
    /// Where its position and irradiance come from.
    pub track: SunTrack,
}

/// Which part of a light the lightmaps hold. What they do not hold is left to the game.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Baked {
    /// What comes straight from the light and what surfaces reflect of it.
    #[default]
    All,
    /// What surfaces reflect of it.
    Indirect,
    /// Nothing: the light is not traced.
    None,
}

impl Baked {
    /// Whether nothing is left to the game.
    pub fn is_all(&self) -> bool {
        *self == Baked::All
    }

    /// Reads `baked` of a light.
    fn read(table: &raw::Table) -> Result<Self> {
        let expected = r#""all", "indirect" or "none""#;
        let Some(value) = table.get("baked") else { return Ok(Baked::All) };
        match value.text(expected)? {
            "all" => Ok(Baked::All),
            "indirect" => Ok(Baked::Indirect),
            "none" => Ok(Baked::None),
            _ => Err(value.error(format!("expected {expected}"))),
        }
    }
}

impl From<Baked> for dataset::format::Baked {
    fn from(baked: Baked) -> Self {
        match baked {
            Baked::All => Self::All,
            Baked::Indirect => Self::Indirect,
            Baked::None => Self::None,
        }
    }
}

/// The sun's course.
#[derive(Clone, Debug, Serialize)]
pub enum SunTrack {
    /// Astronomical position, clear-air irradiance at this turbidity.
    Computed {
        /// Linke-like turbidity of the Hosek–Wilkie model, 1 … 10.
        turbidity: f64,
    },
    /// Authored keys by ascending hour, interpolated linearly and periodically (direction renormalised); a
    /// single key holds all day.
    Authored(Vec<SunKey>),
}

/// A key of an authored sun track.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct SunKey {
    /// 0 ≤ hour < 24.
    pub hour: f64,
    /// Unit vector towards the sun.
    pub direction: DVec3,
    /// Perpendicular irradiance in kilolux.
    pub irradiance: DVec3,
}

/// The sky.
#[derive(Clone, Debug, Serialize)]
pub enum Sky {
    /// The same radiance from everywhere, below the horizon too.
    Constant {
        /// kcd/m².
        radiance: DVec3,
    },
    /// Hosek–Wilkie by day, a continuous twilight to −18°, a night floor after; black below the horizon.
    HosekWilkie {
        /// 1 … 10.
        turbidity: f64,
        /// 0 … 1.
        ground_albedo: f64,
    },
    /// A picture of the whole sphere, the same at all hours.
    Image(SkyImage),
    /// A part of a spherical harmonic at each hour: what a scene's transfer is baked under. No scene file can
    /// ask for it.
    Harmonics {
        /// Black below the horizon.
        upper: bool,
    },
}

/// A rectangle through which sky light is worth looking for, such as a window: it guides samples, it gives no
/// light.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Portal {
    /// Corner, world.
    pub corner: DVec3,
    /// First edge; perpendicular to the second.
    pub edge_u: DVec3,
    /// Second edge.
    pub edge_v: DVec3,
    /// Opposite corners of the box of points that look for the sky through it; `None`: all do.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub room: Option<[DVec3; 2]>,
}

/// One geometry file placed one or more times.
#[derive(Clone, Debug, Serialize)]
pub struct Object {
    /// `.obj`, `.gltf` or `.glb`, absolute or relative to the working folder.
    pub file: PathBuf,
    /// The scene file and line that names it, for messages.
    #[serde(skip)]
    pub source_line: String,
    /// World from file space, one per instance.
    pub world_from_file: Vec<DMat4>,
    /// What holds for all of its meshes.
    pub overrides: SurfaceOverrides,
    /// What holds for meshes whose material, mesh or node matches by name, or any node above; later entries
    /// win.
    pub parts: Vec<Part>,
    /// An OBJ's `vt` are lightmap coordinates too.
    pub vt_is_lightmap: bool,
}

/// An override for some meshes of an object.
#[derive(Clone, Debug, Serialize)]
pub struct Part {
    /// A name, `*` standing for any run of characters.
    pub pattern: String,
    /// What it overrides.
    pub overrides: SurfaceOverrides,
    /// Where it stands in the scene file, for messages.
    #[serde(skip)]
    pub source_line: String,
}

/// Overridable properties; `None` leaves what the file (or the object) says.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SurfaceOverrides {
    /// Replaces base colour factor and texture.
    pub albedo: Option<DVec3>,
    /// Share of the light that passes straight through, in place of the file's; 0: opaque.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transmission: Option<DVec3>,
    /// False: the mesh blocks and reflects light, but gets no texels. Default true.
    pub lightmap: Option<bool>,
    /// Whether it moves: it is in no part of the bake, and still in `scene.glb`. Default: what the file says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub movable: Option<bool>,
    /// Texel density relative to the scene's. Default 1.
    pub density: Option<f64>,
    /// Whether the back reflects too. Default: glTF's `doubleSided`, false for OBJ.
    pub two_sided: Option<bool>,
    /// Radiance emitted from the front (both sides if two-sided), kcd/m².
    pub emission: Option<DVec3>,
    /// The group that switches the emission, its own or the file's; must exist. Required with an `emission`
    /// above 0.
    pub group: Option<String>,
}

/// What becomes of the lamps and glowing materials of geometry files.
#[derive(Clone, Debug, PartialEq)]
pub struct LightsOfFiles {
    /// Whether they shine.
    pub from_file: bool,
    /// Candela of their points and spots where they write 1.
    pub candela: f64,
    /// Lux of their directional lights where they write 1.
    pub lux: f64,
    /// What the candela of their photometric profiles are multiplied by.
    pub profile: f64,
    /// Radiance in kcd/m² where a file's emission is 1.
    pub emission: f64,
    /// Names of lamps and materials (`*` stands for any run of characters), each with its group's index.
    pub names: Vec<(String, usize)>,
}

impl Default for LightsOfFiles {
    fn default() -> Self {
        Self { from_file: true, candela: 1.0, lux: 1.0, profile: 1.0, emission: 1.0, names: Vec::new() }
    }
}

/// Lights that switch together.
#[derive(Clone, Debug, Serialize)]
pub struct Group {
    /// Unique.
    pub name: String,
    /// Open on-intervals in hours within a day, normalised: sorted, disjoint, `from > to` crosses midnight,
    /// `[0, 24]` is always.
    pub on: Vec<[f64; 2]>,
    /// Its lamps.
    pub lamps: Vec<Lamp>,
    /// Which part of its light lightmaps hold.
    #[serde(skip_serializing_if = "Baked::is_all")]
    pub baked: Baked,
}

/// A lamp: invisible to camera and paths, sampled directly.
#[derive(Clone, Debug, Serialize)]
pub enum Lamp {
    /// A uniformly radiating ball.
    Sphere {
        /// Centre, world.
        centre: DVec3,
        /// Metres, > 0.
        radius: f64,
        /// kcd/m².
        radiance: DVec3,
    },
    /// A disc radiating from the side `direction` points to.
    Disc {
        /// Centre, world.
        centre: DVec3,
        /// Unit normal of the radiating side.
        direction: DVec3,
        /// Metres, > 0.
        radius: f64,
        /// kcd/m².
        radiance: DVec3,
    },
    /// A point radiating evenly in all directions.
    Point {
        /// World.
        position: DVec3,
        /// Luminous intensity as RGB, kcd.
        intensity: DVec3,
    },
    /// A parallelogram radiating from the side `edge_u × edge_v` points to.
    Rectangle {
        /// Corner, world.
        corner: DVec3,
        /// First edge; perpendicular to the second.
        edge_u: DVec3,
        /// Second edge.
        edge_v: DVec3,
        /// kcd/m².
        radiance: DVec3,
    },
    /// A point with a cone: full intensity inside `inner`, smooth to none at `outer` (smoothstep in the
    /// cosine).
    Spot {
        /// World.
        position: DVec3,
        /// Unit axis.
        direction: DVec3,
        /// Half angle in radians.
        inner: f64,
        /// Half angle in radians, ≥ inner.
        outer: f64,
        /// On-axis luminous intensity as RGB, kcd.
        intensity: DVec3,
    },
    /// A point that shines as a photometric file says, within a cone as a spot's.
    Ies {
        /// World.
        position: DVec3,
        /// Unit axis, towards the file's vertical angle 0.
        direction: DVec3,
        /// Unit, perpendicular to the axis, towards the file's horizontal angle 0.
        up: DVec3,
        /// Half angle in radians; π: no cone.
        inner: f64,
        /// Half angle in radians, ≥ inner.
        outer: f64,
        /// Luminous intensity as RGB where the file's is greatest, kcd.
        intensity: DVec3,
        /// The file.
        #[serde(serialize_with = "ies::serialize")]
        profile: Arc<Profile>,
    },
}

impl Lamp {
    /// Its light: radiance, or a spot's on-axis intensity.
    pub fn light(&self) -> DVec3 {
        let (Lamp::Sphere { radiance: light, .. }
        | Lamp::Disc { radiance: light, .. }
        | Lamp::Point { intensity: light, .. }
        | Lamp::Rectangle { radiance: light, .. }
        | Lamp::Spot { intensity: light, .. }
        | Lamp::Ies { intensity: light, .. }) = self;
        *light
    }

    /// The same lamp with another light.
    pub fn with_light(mut self, new: DVec3) -> Self {
        let (Lamp::Sphere { radiance: light, .. }
        | Lamp::Disc { radiance: light, .. }
        | Lamp::Point { intensity: light, .. }
        | Lamp::Rectangle { radiance: light, .. }
        | Lamp::Spot { intensity: light, .. }
        | Lamp::Ies { intensity: light, .. }) = &mut self;
        *light = new;
        self
    }
}

/// Lightmap layout.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Lightmap {
    /// How large the pages are.
    pub size: LightmapSize,
    /// Most pages, all of one size, at least 1.
    pub pages: u32,
    /// Width in texels of the filter that mixes no two charts, at least 2 (bilinear).
    pub padding: u32,
    /// What becomes of faces that nobody can see.
    pub hidden: HiddenFaces,
    /// Where lightmap coordinates come from.
    pub uv: UvSource,
}

impl Default for Lightmap {
    fn default() -> Self {
        Self {
            size: LightmapSize::Fixed { width: 512, height: 512 },
            pages: 1,
            padding: 2,
            hidden: HiddenFaces::Skip,
            uv: UvSource::Auto,
        }
    }
}

/// What becomes of faces that nobody can see: those inside solids, and those pressed against another surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HiddenFaces {
    /// They get no texels; they block and reflect light all the same.
    Skip,
    /// They get texels as all others do.
    Keep,
}

/// Where lightmap coordinates come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UvSource {
    /// Charts of the file's own layout where it is valid, else charts of the unwrapper; all are packed.
    Auto,
    /// The file's own coordinates as they are: each is a place on the page.
    Keep,
}

/// Page size, or texel density.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub enum LightmapSize {
    /// Pages of this size; the density follows.
    Fixed {
        /// Texels.
        width: u32,
        /// Texels.
        height: u32,
    },
    /// This density; one page as large as needed, multiples of 4, at most 16384; more than one only where
    /// that is too small.
    TexelsPerMetre(f64),
}

/// Sampling settings.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Sampling {
    /// Paths per texel, a power of two ≥ 2.
    pub samples: u32,
    /// Most reflections on the way to a texel, 0 for direct light only; `None`: no limit (Russian roulette).
    pub bounces: Option<u32>,
    /// Seed of all randomness.
    pub seed: u64,
    /// The most that materials of geometry files reflect in any channel, above 0 and at most 1; an albedo of
    /// the scene file is taken as it is.
    pub albedo_max: f64,
}

impl Default for Sampling {
    fn default() -> Self {
        Self { samples: 64, bounces: None, seed: 1, albedo_max: 0.95 }
    }
}
