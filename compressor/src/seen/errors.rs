//! The errors of a tile's texels, as histograms.

use super::histogram::{Histogram, Quantiles};
use super::pieces::{Pieces, mean_of_channels};

/// X, Y and Z (rows) of linear RGB (Rec. 709, white D65).
const XYZ_FROM_RGB: [[f64; 3]; 3] =
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];

/// Errors of texels, of one time or of many.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Errors {
    /// Root mean square over the channels of decoded − true light, ÷ local light.
    pub local: Histogram,
    /// The same of the error less its grey part, which is its mean over the channels.
    pub chroma: Histogram,
    /// Distance of the colours in the u′v′ plane (CIE 1976), of texels whose true light is above the floor. A
    /// black texel has the colour of white.
    pub colour: Histogram,
}

/// Median, 95 % and 99 % of texels of each; `None` without texels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// Of [`Errors::local`]: 0.1 is 10 % of the light around the texel.
    pub local: Option<Quantiles>,
    /// Of [`Errors::chroma`].
    pub chroma: Option<Quantiles>,
    /// Of [`Errors::colour`].
    pub colour: Option<Quantiles>,
}

impl Errors {
    /// The errors of a tile at some times, each as true and decoded light of its texels, row by row; `least`
    /// is the least floor of local light ([`super::least_floor`]).
    ///
    /// # Panics
    /// As [`Pieces::new`] and [`Errors::add`].
    pub fn of_tile<'a>(
        width: usize,
        valid: &[bool],
        frames: impl IntoIterator<Item = [&'a [[f32; 3]]; 2]>,
        least: f64,
    ) -> Errors {
        let (pieces, mut errors) = (Pieces::new(width, valid), Errors::default());
        frames.into_iter().for_each(|[light, decoded]| errors.add(&pieces, light, decoded, least));
        errors
    }

    /// Adds the errors of a tile at one time. A tile without true light adds nothing.
    ///
    /// # Panics
    /// If `light` or `decoded` has not a value for each texel of the tile.
    pub fn add(&mut self, pieces: &Pieces, light: &[[f32; 3]], decoded: &[[f32; 3]], least: f64) {
        assert_eq!(decoded.len(), pieces.texels(), "a value for each texel");
        let Some(local) = pieces.local_light(light, least) else { return };
        for (texel, piece) in pieces.valid() {
            let (wanted, found) = (light[texel], decoded[texel]);
            let error = [0, 1, 2].map(|c| f64::from(found[c]) - f64::from(wanted[c]));
            let grey = error.iter().sum::<f64>() / 3.0;
            self.local.add(rms(error) / local.of(piece));
            self.chroma.add(rms(error.map(|error| error - grey)) / local.of(piece));
            if mean_of_channels(wanted) > local.floor {
                let ([u, v], [u0, v0]) = (uv(found), uv(wanted));
                self.colour.add((u - u0).hypot(v - v0));
            }
        }
    }

    /// Adds the errors of others.
    pub fn merge(&mut self, other: &Errors) {
        self.local.merge(&other.local);
        self.chroma.merge(&other.chroma);
        self.colour.merge(&other.colour);
    }

    /// Their quantiles.
    pub fn figures(&self) -> Figures {
        let Errors { local, chroma, colour } = self;
        Figures { local: local.quantiles(), chroma: chroma.quantiles(), colour: colour.quantiles() }
    }
}

fn rms(values: [f64; 3]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / 3.0).sqrt()
}

/// u′ and v′ of CIE 1976.
fn uv(light: [f32; 3]) -> [f64; 2] {
    let light = if light.iter().all(|&value| value <= 0.0) { [1.0; 3] } else { light.map(f64::from) };
    let [x, y, z] = XYZ_FROM_RGB.map(|row| (0..3).map(|c| row[c] * light[c]).sum::<f64>());
    let sum = x + 15.0 * y + 3.0 * z;
    [4.0 * x / sum, 9.0 * y / sum]
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALID: [bool; 256] = [true; 256];

    fn errors(light: impl Fn(usize) -> [f32; 3], decoded: impl Fn(usize) -> [f32; 3]) -> Errors {
        let [light, decoded] = [(0..256).map(light).collect::<Vec<_>>(), (0..256).map(decoded).collect()];
        Errors::of_tile(16, &VALID, [[&light[..], &decoded[..]]], 0.0)
    }

    fn all(quantiles: Option<Quantiles>) -> [f64; 3] {
        let Quantiles { median, p95, p99 } = quantiles.unwrap();
        [median, p95, p99]
    }

    fn expect(found: [f64; 3], expected: f64) {
        assert!(found.iter().all(|found| (found - expected).abs() < 1e-6), "{found:?}, {expected}");
    }

    #[test]
    fn a_tenth_too_bright_is_a_local_error_of_a_tenth_and_no_other_colour() {
        let figures = errors(|_| [2.0; 3], |_| [2.2; 3]).figures();
        expect(all(figures.local), 0.1);
        expect(all(figures.chroma), 0.0);
        expect(all(figures.colour), 0.0);
        // Of coloured light the colour stays as well, though the error has a part that is not grey.
        let figures = errors(|_| [3.0, 2.0, 1.0], |_| [3.3, 2.2, 1.1]).figures();
        expect(all(figures.colour), 0.0);
        expect(all(figures.local), (0.14f64 / 3.0).sqrt() / 2.0);
        expect(all(figures.chroma), (0.02f64 / 3.0).sqrt() / 2.0);
    }

    #[test]
    fn an_error_of_colour_alone_is_all_chroma() {
        // Red more and blue less by 0.3 of 2: √(2/3) · 0.15.
        let figures = errors(|_| [2.0; 3], |_| [2.3, 2.0, 1.7]).figures();
        expect(all(figures.local), (2.0f64 / 3.0).sqrt() * 0.15);
        assert_eq!(figures.local, figures.chroma);
        // White D65 is at u′ 0.19784, v′ 0.46832; the decoded by hand.
        let [x, y, z] = XYZ_FROM_RGB.map(|row| row[0] * 2.3 + row[1] * 2.0 + row[2] * 1.7);
        let (u, v) = (4.0 * x / (x + 15.0 * y + 3.0 * z), 9.0 * y / (x + 15.0 * y + 3.0 * z));
        let distance = ((u - 0.19784f64).powi(2) + (v - 0.46832f64).powi(2)).sqrt();
        assert!(all(figures.colour).iter().all(|found| (found - distance).abs() < 2e-5), "{figures:?}");
    }

    #[test]
    fn errors_are_relative_to_the_light_around_not_to_the_texels_own() {
        // One texel in sixteen has 31, the others 1: a mean of 2.875. All are off by 0.2875.
        let light = |i: usize| if i.is_multiple_of(16) { 31.0 } else { 1.0 };
        let figures = errors(|i| [light(i); 3], |i| [light(i) + 0.2875; 3]).figures();
        expect(all(figures.local), 0.1);
    }

    #[test]
    fn colour_counts_above_the_floor_and_black_is_white() {
        // Half of the texels are black (median 0): the floor is 1/300 of the brightest. The others: one in
        // two is below it, and decoded as a colour; one is decoded as black.
        let light = |i: usize| [[0.0; 3], [0.0; 3], [9.0; 3], [0.01; 3]][i % 4];
        let decoded = |i: usize| match i % 4 {
            3 => [0.01, 0.0, 0.0],
            _ if i == 2 => [0.0; 3],
            _ => light(i),
        };
        let found = errors(light, decoded);
        assert_eq!((found.local.count(), found.colour.count()), (256, 64));
        expect(all(found.figures().colour), 0.0);
    }

    #[test]
    fn black_tiles_have_no_errors_and_nothing_is_no_number() {
        let black = errors(|_| [0.0; 3], |_| [0.1; 3]);
        assert_eq!((black.clone(), black.figures()), (Errors::default(), Figures::default()));
        let none = Errors::of_tile(16, &[false; 256], [[&[[1.0; 3]; 256][..], &[[2.0; 3]; 256][..]]], 0.0);
        assert_eq!(none, Errors::default());
        // What is decoded as no number is infinitely wrong.
        let broken = errors(|_| [1.0; 3], |_| [f32::NAN; 3]).figures();
        assert_eq!(broken.local.map(|local| local.median), Some(f64::INFINITY));
    }
}
