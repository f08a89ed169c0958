//! HDR-ꟻLIP of one tile: the difference seen when flipping between two images, at any exposure.
//!
//! Andersson et al. 2020, "ꟻLIP: A Difference Evaluator for Alternating Images", for one exposure; Andersson
//! et al. 2021, "Visualizing Errors in Rendered High Dynamic Range Images", for the exposures: per texel the
//! largest error over those between the one at which the reference's brightest texel is nearly white and the
//! one at which its median is. Sections below are those of the first.

use super::TileQuality;
use crate::format::Rect;
use crate::image::{Image, Mask};
use std::f64::consts::PI;

/// Pixels per degree of visual angle: a display 0.7 m wide of 3840 pixels, seen from 0.7 m, as the authors
/// propose.
const PIXELS_PER_DEGREE: f64 = 0.7 * 3840.0 / 0.7 * PI / 180.0;

/// Contrast sensitivity (section 4.1): amplitude and width (squared degrees) of the Gaussians of luminance,
/// red–green, blue–yellow.
const SENSITIVITY: [[[f64; 2]; 2]; 3] =
    [[[1.0, 0.0047], [0.0, 1e-5]], [[1.0, 0.0053], [0.0, 1e-5]], [[34.1, 0.04], [13.5, 0.025]]];
/// The widest of them.
const WIDEST: f64 = 0.04;
/// Width of what edges and points are found by, in degrees (section 4.2).
const FEATURE_WIDTH: f64 = 0.082;
/// Exponents of colour and feature differences, and the bend of the former: up to this share of the largest
/// colour difference, errors are mapped to this share of the scale (section 4.1, 4.2).
const COLOUR_EXPONENT: f32 = 0.7;
const FEATURE_EXPONENT: f32 = 0.5;
const BEND: [f32; 2] = [0.4, 0.95];

/// What the tone mapper (an approximation of ACES) gives: (k₀x² + k₁x + k₂) ÷ (k₃x² + k₄x + k₅).
const TONES: [f64; 6] = [0.36 * 2.51, 0.6 * 0.03, 0.0, 0.36 * 2.43, 0.6 * 0.59, 0.14];
/// What it gives for what is nearly white.
const NEARLY_WHITE: f64 = 0.85;
/// Exposures, at most: one per stop, of a range of 1 : 10⁹.
const MOST_EXPOSURES: f64 = 30.0;

/// X, Y, Z (rows) of linear RGB (Rec. 709), over those of white, which are the sums of the rows.
const XYZ_FROM_RGB: [[f64; 3]; 3] = over_sums([
    [10135552.0 / 24577794.0, 8788810.0 / 24577794.0, 4435075.0 / 24577794.0],
    [2613072.0 / 12288897.0, 8788810.0 / 12288897.0, 887015.0 / 12288897.0],
    [1425312.0 / 73733382.0, 8788810.0 / 73733382.0, 70074185.0 / 73733382.0],
]);
const RGB_FROM_XYZ: [[f64; 3]; 3] = inverse(XYZ_FROM_RGB);

const fn over_sums([a, b, c]: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    const fn row([x, y, z]: [f64; 3]) -> [f64; 3] {
        let sum = x + y + z;
        [x / sum, y / sum, z / sum]
    }
    [row(a), row(b), row(c)]
}

/// Cramer's rule.
const fn inverse([a, b, c]: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    const fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    }
    let (x, y, z) = (cross(b, c), cross(c, a), cross(a, b));
    let d = a[0] * x[0] + a[1] * x[1] + a[2] * x[2];
    [[x[0] / d, y[0] / d, z[0] / d], [x[1] / d, y[1] / d, z[1] / d], [x[2] / d, y[2] / d, z[2] / d]]
}

fn times(matrix: [[f64; 3]; 3], [a, b, c]: [f32; 3]) -> [f32; 3] {
    matrix.map(|row| row[0] as f32 * a + row[1] as f32 * b + row[2] as f32 * c)
}

/// The error of a decoded tile whose `quality` is known, 0 to 1, mean over valid texels; `None` if that has
/// no SSIM. What is not valid is black in both. Exposures are those of valid texels that have light, so that
/// a tile of which more than half is black has some.
pub fn flip(
    decoded: &Image,
    reference: &Image,
    mask: &Mask,
    tile: Rect,
    quality: &TileQuality,
) -> Option<f64> {
    quality.ssim?;
    let (width, height) = (tile.width(), tile.height());
    let places = tile.texels(mask.width);
    let valid: Vec<bool> = places.clone().map(|i| mask.valid[i]).collect();
    let [decoded, reference] = [decoded, reference].map(|image| {
        let texels = places.clone().map(|i| if mask.valid[i] { image.texels[i] } else { [0.0; 3] });
        texels.collect::<Vec<_>>()
    });
    let eye = Eye::new();
    let mut largest = vec![0.0f32; valid.len()];
    for exposure in exposures(&reference) {
        let seen = [&reference, &decoded].map(|light| eye.see(light, exposure, width, height));
        for (largest, error) in largest.iter_mut().zip(eye.errors(&seen)) {
            *largest = largest.max(error);
        }
    }
    let errors = largest.iter().zip(&valid).filter(|(_, valid)| **valid);
    Some(errors.map(|(error, _)| f64::from(*error)).sum::<f64>() / quality.texels as f64)
}

/// ꟻLIP per pixel of two pictures as a screen shows them, linear in light, 1 being white.
pub(super) fn of_pictures(
    found: &[[f32; 3]],
    reference: &[[f32; 3]],
    [width, height]: [usize; 2],
) -> Vec<f32> {
    let eye = Eye::new();
    let seen = [reference, found].map(|shown| eye.see_shown(shown.iter().copied(), width, height));
    eye.errors(&seen).collect()
}

/// The factors that light is exposed by.
fn exposures(light: &[[f32; 3]]) -> Vec<f64> {
    let luminance = |rgb: &[f32; 3]| -> f64 {
        rgb.iter().zip([0.2126, 0.7152, 0.0722]).map(|(&value, share)| f64::from(value) * share).sum()
    };
    let mut lit: Vec<f64> = light.iter().map(luminance).filter(|y| *y > 0.0).collect();
    lit.sort_unstable_by(f64::total_cmp);
    let Some(&brightest) = lit.last() else { return Vec::new() };
    let median = (lit[lit.len() / 2] + lit[(lit.len() - 1) / 2]) / 2.0;
    let [a, b, c] = std::array::from_fn(|i| TONES[i] - NEARLY_WHITE * TONES[i + 3]);
    let white = (-b + (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
    let [first, last] = [brightest, median].map(|y| (white / y).log2());
    let steps = (last - first).ceil().clamp(2.0, MOST_EXPOSURES) - 1.0;
    (0..=steps as usize).map(|i| (first + (last - first) * i as f64 / steps).exp2()).collect()
}

/// Light by the tone mapper.
fn tone(light: f64) -> f32 {
    let [k0, k1, k2, k3, k4, k5] = TONES;
    // (Far above white, squares would be infinite.)
    let x = light.min(1e6);
    ((k0 * x * x + k1 * x + k2) / (k3 * x * x + k4 * x + k5)).clamp(0.0, 1.0) as f32
}

/// What is found of an image at one exposure.
struct Seen {
    /// L*, a*, b* after the filters of contrast sensitivity, a* and b* scaled by L* (Hunt 1952).
    colours: [Vec<f32>; 3],
    /// Strength of edges and of points.
    features: [Vec<f32>; 2],
}

/// An odd number of weights about a texel.
struct Filter(Vec<f32>);

impl Filter {
    /// Of this many texels to either side.
    fn new(radius: usize, weight: impl Fn(f64) -> f64) -> Self {
        Filter((0..=2 * radius).map(|i| weight(i as f64 - radius as f64) as f32).collect())
    }

    /// A Gaussian of sum 1.
    fn gaussian(radius: usize, exponent: f64) -> Self {
        let weight = |x: f64| (-exponent * x * x).exp();
        let sum: f64 = (0..=2 * radius).map(|i| weight(i as f64 - radius as f64)).sum();
        Filter::new(radius, |x| weight(x) / sum)
    }

    /// Filters along rows; beyond the ends lies what is at them.
    fn along(&self, plane: &[f32], width: usize) -> Vec<f32> {
        let radius = self.0.len() / 2;
        let mut out = vec![0.0; plane.len()];
        let mut padded = vec![0.0; width + 2 * radius];
        for (row, out) in plane.chunks_exact(width).zip(out.chunks_exact_mut(width)) {
            padded[..radius].fill(row[0]);
            padded[radius..radius + width].copy_from_slice(row);
            padded[radius + width..].fill(row[width - 1]);
            for (i, weight) in self.0.iter().enumerate() {
                out.iter_mut().zip(&padded[i..]).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        out
    }

    /// The same along columns.
    fn down(&self, plane: &[f32], width: usize) -> Vec<f32> {
        let (radius, height) = (self.0.len() / 2, plane.len() / width);
        let mut out = vec![0.0; plane.len()];
        for (y, out) in out.chunks_exact_mut(width).enumerate() {
            for (i, weight) in self.0.iter().enumerate() {
                let from = (y + i).saturating_sub(radius).min(height - 1) * width;
                let row = &plane[from..from + width];
                out.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        out
    }
}

/// The filters, and the scale of colour differences.
struct Eye {
    /// Per channel its Gaussians, with their shares.
    sensitivity: [Vec<(f32, Filter)>; 3],
    /// A Gaussian and its first and second derivatives, what is positive and what is negative of each having
    /// sums of ±1.
    features: [Filter; 3],
    /// The difference of green and blue, the largest there is.
    most: f32,
}

impl Eye {
    fn new() -> Self {
        let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as usize;
        let sensitivity = SENSITIVITY.map(|gaussians| {
            let gaussians = gaussians.map(|[amplitude, width]| {
                let exponent = PI * PI / (width * PIXELS_PER_DEGREE * PIXELS_PER_DEGREE);
                let sum: f64 =
                    (0..=2 * radius).map(|i| (-exponent * (i as f64 - radius as f64).powi(2)).exp()).sum();
                (amplitude * (PI / width).sqrt() * sum * sum, exponent)
            });
            let all: f64 = gaussians.iter().map(|(sum, _)| sum).sum();
            let parts = gaussians.iter().filter(|(sum, _)| *sum > 0.0);
            parts.map(|(sum, exponent)| ((sum / all) as f32, Filter::gaussian(radius, *exponent))).collect()
        });
        let deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
        let radius = (3.0 * deviation).ceil() as usize;
        let exponent = 0.5 / (deviation * deviation);
        let derivative = |factor: &dyn Fn(f64) -> f64| {
            let weight = |x: f64| factor(x / deviation) * (-exponent * x * x).exp();
            let sum = |sign: f64| -> f64 {
                (0..=2 * radius).map(|i| (sign * weight(i as f64 - radius as f64)).max(0.0)).sum()
            };
            let (more, less) = (sum(1.0), sum(-1.0));
            Filter::new(radius, |x| weight(x) / if weight(x) > 0.0 { more } else { less })
        };
        let features =
            [Filter::gaussian(radius, exponent), derivative(&|x| -x), derivative(&|x| x * x - 1.0)];
        let [green, blue] = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|rgb| hunt_lab(xyz(rgb)));
        let most = hyab(green, blue).powf(COLOUR_EXPONENT);
        Eye { sensitivity, features, most }
    }

    /// Looks at light exposed by a factor.
    fn see(&self, light: &[[f32; 3]], exposure: f64, width: usize, height: usize) -> Seen {
        let shown = light.iter().map(|rgb| rgb.map(|value| tone(f64::from(value) * exposure)));
        self.see_shown(shown, width, height)
    }

    /// Looks at what a screen shows, linear in light, 1 being white.
    fn see_shown(&self, shown: impl Iterator<Item = [f32; 3]>, width: usize, height: usize) -> Seen {
        let mut opponents = [0; 3].map(|_| Vec::with_capacity(width * height));
        for rgb in shown {
            let values = opponent(xyz(rgb));
            opponents.iter_mut().zip(values).for_each(|(plane, value)| plane.push(value));
        }
        let luminance: Vec<f32> = opponents[0].iter().map(|y| (y + 16.0) / 116.0).collect();
        let mut colours: [Vec<f32>; 3] = std::array::from_fn(|c| {
            let mut sums = vec![0.0; width * height];
            for (share, filter) in &self.sensitivity[c] {
                let part = filter.down(&filter.along(&opponents[c], width), width);
                sums.iter_mut().zip(part).for_each(|(sum, value)| *sum += share * value);
            }
            sums
        });
        for i in 0..width * height {
            let shown = in_gamut(from_opponent([colours[0][i], colours[1][i], colours[2][i]]));
            let lab = hunt_lab(xyz(shown));
            colours.iter_mut().zip(lab).for_each(|(plane, value)| plane[i] = value);
        }
        let [gaussian, first, second] = &self.features;
        let across = gaussian.along(&luminance, width);
        let strength = |derivative: &Filter| -> Vec<f32> {
            let x = gaussian.down(&derivative.along(&luminance, width), width);
            let y = derivative.down(&across, width);
            x.iter().zip(y).map(|(x, y)| x.hypot(y)).collect()
        };
        Seen { colours, features: [strength(first), strength(second)] }
    }

    /// The error of each texel between what is seen of two images.
    fn errors<'a>(&'a self, [reference, decoded]: &'a [Seen; 2]) -> impl Iterator<Item = f32> + 'a {
        let colour = |seen: &Seen, i: usize| [seen.colours[0][i], seen.colours[1][i], seen.colours[2][i]];
        (0..reference.colours[0].len()).map(move |i| {
            let difference = hyab(colour(reference, i), colour(decoded, i)).powf(COLOUR_EXPONENT);
            let [share, scale] = BEND;
            let bend = share * self.most;
            let of_colour = match difference < bend {
                true => difference * scale / bend,
                false => scale + (difference - bend) / (self.most - bend) * (1.0 - scale),
            };
            let features = reference.features.iter().zip(&decoded.features);
            let largest = features.map(|(a, b)| (a[i] - b[i]).abs()).fold(0.0, f32::max);
            let of_features = (largest / std::f32::consts::SQRT_2).powf(FEATURE_EXPONENT);
            of_colour.clamp(0.0, 1.0).powf(1.0 - of_features.clamp(0.0, 1.0))
        })
    }
}

/// CIE XYZ over that of white.
fn xyz(rgb: [f32; 3]) -> [f32; 3] {
    times(XYZ_FROM_RGB, rgb)
}

/// Y, Cx, Cz, linear in light.
fn opponent([x, y, z]: [f32; 3]) -> [f32; 3] {
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

/// XYZ over that of white.
fn from_opponent([y, cx, cz]: [f32; 3]) -> [f32; 3] {
    let y = (y + 16.0) / 116.0;
    [y + cx / 500.0, y, y - cz / 200.0]
}

/// The RGB that is shown for an XYZ over that of white.
fn in_gamut(xyz: [f32; 3]) -> [f32; 3] {
    times(RGB_FROM_XYZ, xyz).map(|value| value.clamp(0.0, 1.0))
}

/// L*, a*, b* of an XYZ over that of white, a* and b* scaled by L*/100.
fn hunt_lab(xyz: [f32; 3]) -> [f32; 3] {
    const DELTA: f32 = 6.0 / 29.0;
    let f = |t: f32| {
        if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    };
    let [x, y, z] = xyz.map(f);
    let l = 116.0 * y - 16.0;
    [l, 0.01 * l * 500.0 * (x - y), 0.01 * l * 200.0 * (y - z)]
}

/// The distance of two colours, city block between lightness and the rest (Abasi et al. 2020).
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}
