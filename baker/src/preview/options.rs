//! What a preview is asked for.

use crate::scene::MAX_FOV;
use crate::trace::rays::Backend;
use glam::DVec3;
use std::path::PathBuf;

/// What to show, how, and where to.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Time of day, such as 18.5 or 18:30. Between two frames the light is interpolated linearly; if lamps
    /// switch between them, the frame with the same lamps on is shown. A bundle has light at every time.
    #[arg(long, value_name = "HOUR", value_parser = dataset::typed::hour)]
    pub hour: f64,
    /// A camera of the scene, by name, or a viewpoint "x,y,z" [default: the scene's first camera; else a
    /// viewpoint from the south-west, inside if the scene is a room and above it otherwise; if a wall is
    /// there, the viewpoint that sees most lit surfaces].
    #[arg(long, value_name = "NAME|X,Y,Z", allow_hyphen_values = true)]
    pub camera: Option<String>,
    /// The point in the middle of the picture [default: the camera's; else the middle of the lightmapped
    /// surfaces].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    pub look_at: Option<DVec3>,
    /// Angle of view from left to right, in degrees [default: the camera's, else 60].
    #[arg(long, value_name = "DEGREES", value_parser = parse_fov)]
    pub fov: Option<f64>,
    /// Width and height in pixels.
    #[arg(long, default_value = "1280x720", value_name = "WxH", value_parser = parse_size)]
    pub size: [u32; 2],
    /// Camera rays per pixel, stratified (16: 4 × 4); best a power of two.
    #[arg(long, default_value_t = 16, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub samples: u32,
    /// Radiance in kcd/m² is multiplied by 2 to the power EV: use one value for several hours to compare
    /// them [default: so that the surfaces' log-average luminance becomes 0.18, and its 95th percentile
    /// at most 1].
    #[arg(long, value_name = "EV", allow_hyphen_values = true, value_parser = parse_exposure)]
    pub exposure: Option<f64>,
    /// The dataset's folder [default: that of the scene in dataset/].
    #[arg(long, value_name = "DIR")]
    pub dataset: Option<PathBuf>,
    /// Show the light that a compressed bundle of this dataset decodes to, instead of the dataset's
    /// lightmaps.
    #[arg(long, value_name = "FILE.ndgi")]
    pub bundle: Option<PathBuf>,
    /// Show only what lightmaps or bundle give an engine: what has no texels is unlit, black, and needs
    /// texels or the engine's own light, such as probes.
    #[arg(long)]
    pub as_game: bool,
    /// The picture to write [default: in the dataset's folder, named by camera, hour, bundle and --as-game].
    #[arg(long, value_name = "FILE.png")]
    pub out: Option<PathBuf>,
    /// Ray-tracing backend: obvhs (built in), or embree in builds with that feature.
    #[arg(long, default_value = "obvhs", value_name = "BACKEND")]
    pub backend: Backend,
}

impl Options {
    /// The defaults, at an hour.
    pub fn new(hour: f64) -> Self {
        Options {
            hour,
            camera: None,
            look_at: None,
            fov: None,
            size: [1280, 720],
            samples: 16,
            exposure: None,
            dataset: None,
            bundle: None,
            as_game: false,
            out: None,
            backend: Backend::default(),
        }
    }
}

/// For `--help`.
pub const HELP: &str = "\
Examples:
  bake preview scenes/yard.toml --hour 18.5
  bake preview scenes/yard.toml --hour 12 --camera gate --out gate.png
  bake preview scenes/yard.toml --hour 21 --camera \"0,1.7,5\" --look-at \"0,1,-5\" --fov 75
  bake preview scenes/yard.toml --hour 18.05 --bundle dataset/yard/yard.ndgi     decoded light
  bake preview scenes/yard.toml --hour 18.05 --bundle dataset/yard/yard.ndgi --as-game   and nothing but that
  bake preview scenes/yard.toml --hour 7 --exposure -3 --size 640x360 --samples 4

Surfaces with texels show the baked irradiance, filtered bilinearly, times their albedo ÷ π; texture and cut-outs count. Surfaces
without texels (lightmap = false, and the backs of two-sided ones) have no baked light. It is estimated at every sample, by
shadow rays to sun and lamps, and by paths that end where they read baked light or meet the sky: it is noisier (less with more
--samples), and is not part of the dataset. The backs of one-sided surfaces are not drawn. Lamps and the sun's disc are invisible;
emissive surfaces and the sky are not. Below the horizon of a computed sky lies the ground of `[sky] ground` (black if false).

With --as-game nothing is estimated: surfaces without texels are black, and do not count for the exposure. The backs of two-sided
surfaces show their front's texels, as engines sample lightmaps. Emission and sky, which engines draw themselves, stay.

Tone curve, per channel: linear up to 0.7, from there 1 - 0.3 exp(-(x - 0.7) / 0.3), then sRGB in 8 bits.

With --json, one object on stdout: scene, dataset, bundle (null without one), image, hour, frames (hour, weight; none with --bundle), camera (name, position, look_at, fov), size,
samples, exposure, unlit (with --as-game the share of the surfaces in view that has no texels, else null), seconds, warnings.";

/// `x,y,z`.
pub fn parse_point(text: &str) -> Result<DVec3, String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|n: &f64| n.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
        _ => Err("expected three numbers in metres, such as \"0,1.7,5\"".to_owned()),
    }
}

fn parse_fov(text: &str) -> Result<f64, String> {
    let fov = text.parse().ok().filter(|fov| (1.0..=MAX_FOV).contains(fov));
    fov.ok_or_else(|| format!("expected degrees from 1 to {MAX_FOV}"))
}

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    /// Longest side of a picture.
    const MOST: u32 = 16384;
    let side = |text: &str| text.trim().parse().ok().filter(|side| (1..=MOST).contains(side));
    let sides = text.split_once('x').and_then(|(w, h)| Some([side(w)?, side(h)?]));
    sides.ok_or_else(|| format!("expected a width and a height from 1 to {MOST}, such as 1280x720"))
}

fn parse_exposure(text: &str) -> Result<f64, String> {
    let exposure = text.parse().ok().filter(|ev| (-60.0..=60.0).contains(ev));
    exposure.ok_or_else(|| "expected a power of two from -60 to 60, such as -2.5".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_sizes_are_parsed() {
        assert_eq!(parse_point("-1, 2.5,3e1"), Ok(DVec3::new(-1.0, 2.5, 30.0)));
        for bad in ["", "1,2", "1,2,3,4", "1,2,x", "1,2,inf"] {
            assert!(parse_point(bad).is_err(), "{bad}");
        }
        assert_eq!(parse_size("64x32"), Ok([64, 32]));
        for bad in ["64", "0x3", "3x0", "x", "99999x1", "64×32"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }
}
