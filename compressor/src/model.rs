//! The representation of one tile: hybrid feature maps, a tiny decoder, and how they are sampled.
//!
//! A tile covers `width × height` stored texels (128×128; fewer, multiples of 4, at a page's right and bottom edge), of
//! which [`BORDER`] on each side repeat the neighbouring texels. With `k` the set's index among `n` sets,
//! `τ = (k + ½)/n` is the time coordinate, periodic with period 1 ([`crate::time`] maps hours to τ).
//! For the stored texel (x, y), with u = (x + ½)/width and v = (y + ½)/height:
//!
//! - `V_uv  = F_uv[x, y]` (no interpolation: F_uv has one texel per stored texel), 4 channels;
//! - `V_ut  = F_ut(u, τ)`, `V_vt = F_vt(v, τ)`, 2 channels each, bilinear, texel centres at (i + ½)/size, clamped in u and v, periodic in τ;
//! - `V_uvt = F_uvt(u, v, τ)`, 4 channels, trilinear, clamped in u and v, periodic in τ;
//! - `γ(τ) = [sin 2πτ, cos 2πτ, sin 4πτ, cos 4πτ]`;
//! - input `x = [c(V_uvt), c(V_uv), c(V_ut), c(V_vt), γ]` (16 values) with `c(f) = 3 (f − ½)`;
//! - `h₁ = gelu(W₁ x + b₁)`, `h₂ = gelu(W₂ h₁ + b₂)`, `y = W₃ h₂ + b₃`;
//! - irradiance of channel c: `E_c = mean_c(t) · max(y_c, 0)²`.
//!
//! That is the standard coding; the paper's literal one has another τ, γ and power ([`crate::time::Coding`]).
//! Everything that depends on τ alone folds into the first layer's bias. Feature values lie in [0, 1].

/// Side of a stored tile in texels.
pub const STORED: usize = 128;
/// Texels on each side of a tile that repeat its neighbours (mirrored at the page's edge): one is what bilinear filtering needs.
pub const BORDER: usize = 1;
/// Side of the part of a tile that is its own.
pub const PAYLOAD: usize = STORED - 2 * BORDER;
/// Values entering the decoder: V_uvt 4, V_uv 4, V_ut 2, V_vt 2, γ 4.
pub const INPUTS: usize = 16;

/// A named size of the representation (the paper's Table "NDGI profiles").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Profile {
    /// Name on the command line.
    pub name: &'static str,
    /// Side of F_uvt for a full tile.
    pub uvt: usize,
    /// Width of the two hidden layers.
    pub hidden: usize,
}

/// The paper's profiles.
pub const PROFILES: [Profile; 4] = [
    Profile { name: "L", uvt: 16, hidden: 16 },
    Profile { name: "M", uvt: 32, hidden: 16 },
    Profile { name: "M.64", uvt: 32, hidden: 64 },
    Profile { name: "H", uvt: 64, hidden: 16 },
];

/// All sizes of one tile's maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Stored texels across, a multiple of 4.
    pub width: usize,
    /// Stored texels down, a multiple of 4.
    pub height: usize,
    /// Sets n.
    pub sets: usize,
    /// Texels of F_ut along u (64 for a full tile).
    pub ut: usize,
    /// Texels of F_vt along v.
    pub vt: usize,
    /// Rows of F_ut and F_vt along τ: min(24, n).
    pub rows: usize,
    /// Width, height of F_uvt (multiples of 4) and its slices min(12, ⌈n/2⌉).
    pub uvt: [usize; 3],
    /// Width of the hidden layers.
    pub hidden: usize,
}

impl Shape {
    /// The shape of a tile of `width × height` stored texels.
    pub fn new(profile: &Profile, width: usize, height: usize, sets: usize) -> Self {
        let side = |stored: usize| (stored * profile.uvt).div_ceil(STORED).next_multiple_of(4);
        Shape {
            width,
            height,
            sets,
            ut: width.div_ceil(2),
            vt: height.div_ceil(2),
            rows: sets.min(24),
            uvt: [side(width), side(height), sets.div_ceil(2).min(12)],
            hidden: profile.hidden,
        }
    }

    /// Number of F_uv blocks, F_uvt blocks, F_ut texels, F_vt texels.
    pub fn counts(&self) -> [usize; 4] {
        let [width, height, slices] = self.uvt;
        let blocks = |width: usize, height: usize| (width / 4) * (height / 4);
        [
            blocks(self.width, self.height),
            blocks(width, height) * slices,
            self.rows * self.ut,
            self.rows * self.vt,
        ]
    }

    /// Whether some profile has this shape, so that every map holds a texel and the hidden layers are 16 or 64 wide.
    fn is_known(&self) -> bool {
        let side = |side: usize| (4..=STORED).contains(&side) && side.is_multiple_of(4);
        let of = |profile| Shape::new(profile, self.width, self.height, self.sets);
        side(self.width)
            && side(self.height)
            && self.sets > 0
            && PROFILES.iter().any(|profile| of(profile) == *self)
    }

    /// Number of decoder weights: W₁ b₁ W₂ b₂ W₃ b₃.
    pub fn mlp_len(&self) -> usize {
        let h = self.hidden;
        INPUTS * h + h + h * h + h + h * 3 + 3
    }
}

/// A tile as it is stored: everything a decoder needs.
#[derive(Clone, Debug, PartialEq)]
pub struct TileParams {
    /// The sizes of what follows.
    pub shape: Shape,
    /// F_uv as BC7 blocks, row by row, `width/4 · height/4`.
    pub f_uv: Vec<[u8; 16]>,
    /// F_uvt as BC7 blocks, slice by slice, row by row.
    pub f_uvt: Vec<[u8; 16]>,
    /// F_ut, `rows × ut` texels of 2 channels, row (τ) by row; value = byte / 255.
    pub f_ut: Vec<[u8; 2]>,
    /// F_vt likewise, `rows × vt`.
    pub f_vt: Vec<[u8; 2]>,
    /// W₁ (`hidden × 16`, row-major), b₁, W₂ (`hidden × hidden`), b₂, W₃ (`3 × hidden`), b₃.
    pub mlp: Vec<half::f16>,
    /// Per set: the mean that channel's curve is multiplied with, finite and ≥ 0; exactly 0 decodes to 0.
    pub means: Vec<[f32; 3]>,
}

impl TileParams {
    /// Checks that some profile has the shape, and that every list is as long as the shape says.
    ///
    /// # Errors
    /// What differs.
    pub fn check_lengths(&self) -> Result<(), String> {
        let shape = &self.shape;
        if !shape.is_known() {
            return Err(format!("{shape:?}; expected the shape of a profile"));
        }
        let [uv, uvt, ut, vt] = shape.counts();
        for (what, found, expected) in [
            ("blocks of F_uv", self.f_uv.len(), uv),
            ("blocks of F_uvt", self.f_uvt.len(), uvt),
            ("texels of F_ut", self.f_ut.len(), ut),
            ("texels of F_vt", self.f_vt.len(), vt),
            ("decoder weights", self.mlp.len(), shape.mlp_len()),
            ("means", self.means.len(), shape.sets),
        ] {
            if found != expected {
                return Err(format!("{found} {what}; expected {expected}"));
            }
        }
        Ok(())
    }
}

/// Beyond ±this, [`gelu`]'s factor is exactly 1 or 0.
pub const GELU_BOUND: f32 = 3.65;

/// Coefficients of P in [`gelu`], constant term first. They are the minimax fit of x·Φ(x) under the conditions that
/// y P(y²) is ½ and flat at y = [`GELU_BOUND`], so that the function and its derivative are continuous.
pub const GELU_COEFFICIENTS: [f32; 6] =
    [0.396_843_25, -0.062_936_08, 0.007_962_516, -6.341_749e-4, 2.801_160_5e-5, -5.182_709e-7];

/// GELU as the format defines it: `x · (½ + y P(y²))` with y = x clamped to ±[`GELU_BOUND`]: within 5e-4 of `x · Φ(x)`,
/// Φ the normal distribution function.
#[inline(always)]
pub fn gelu(x: f32) -> f32 {
    let y = x.clamp(-GELU_BOUND, GELU_BOUND);
    let [p0, p1, p2, p3, p4, p5] = GELU_COEFFICIENTS;
    let s = y * y;
    let p = ((((p5 * s + p4) * s + p3) * s + p2) * s + p1) * s + p0;
    x * (0.5 + y * p)
}

/// The derivative of [`gelu`]: `½ + y P(y²) + y (P(y²) + 2 y² P′(y²))`, which is 0 or 1 beyond ±[`GELU_BOUND`].
#[inline(always)]
pub fn gelu_derivative(x: f32) -> f32 {
    let y = x.clamp(-GELU_BOUND, GELU_BOUND);
    let [p0, p1, p2, p3, p4, p5] = GELU_COEFFICIENTS;
    let s = y * y;
    let p = ((((p5 * s + p4) * s + p3) * s + p2) * s + p1) * s + p0;
    // The derivative of y P(y²) is Σ (2 k + 1) p_k y^(2 k); it vanishes at the bound.
    let d = ((((11.0 * p5 * s + 9.0 * p4) * s + 7.0 * p3) * s + 5.0 * p2) * s + 3.0 * p1) * s + p0;
    0.5 + y * (p + d)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Φ(x) = ½ + φ(x) (x + x³/3 + x⁵/15 + …) (Abramowitz and Stegun 26.2.11), to double precision for |x| < 8.
    fn normal_distribution(x: f64) -> f64 {
        let (mut term, mut sum, mut n) = (x, x, 1.0);
        while (term / sum).abs() > 1e-17 {
            n += 2.0;
            term *= x * x / n;
            sum += term;
        }
        0.5 + sum * (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt()
    }

    #[test]
    fn gelu_is_close_to_the_exact_one() {
        let mut worst = (0.0f64, 0.0f64);
        for i in (-16_000..=16_000).filter(|i| *i != 0) {
            let x = f64::from(i) / 2000.0;
            let cdf = normal_distribution(x);
            let pdf = (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt();
            worst.0 = worst.0.max((f64::from(gelu(x as f32)) - x * cdf).abs());
            worst.1 = worst.1.max((f64::from(gelu_derivative(x as f32)) - (cdf + x * pdf)).abs());
        }
        assert!(worst.0 < 5e-4, "{}", worst.0);
        assert!(worst.1 < 6e-3, "{}", worst.1);
        assert_eq!(gelu(0.0), 0.0);
        assert!((gelu(50.0) - 50.0).abs() < 1e-4 && gelu(-50.0).abs() < 1e-4);
    }

    #[test]
    fn gelu_derivative_is_the_slope() {
        for i in -500..=500 {
            let (x, h) = (i as f32 / 100.0, 1e-2);
            let slope = (gelu(x + h) - gelu(x - h)) / (2.0 * h);
            assert!((slope - gelu_derivative(x)).abs() < 6e-4, "{x}: {slope} {}", gelu_derivative(x));
        }
    }
}
