//! The representation of one tile: hybrid feature maps, a tiny decoder, and how they are sampled.
//!
//! A tile covers `width × height` stored texels (128×128; fewer, multiples of 4, at a page's right and bottom
//! edge), of which [`BORDER`] on each side repeat the neighbouring texels. Each tile has some of the
//! following ([`Contents`]). Its time coordinate τ is periodic with period 1: with `i_k` the place of frame
//! `k` on the tile's time axis of `m` places, `τ_k = (i_k + ½)/m`; frames that look alike share a place
//! ([`crate::time`] has the times between frames). For the stored texel (x, y), with u = (x + ½)/width and
//! v = (y + ½)/height:
//!
//! - `V_uv  = F_uv[x, y]` (no interpolation: F_uv has one texel per stored texel), 4 channels;
//! - `V_ut  = F_ut(u, τ)`, `V_vt = F_vt(v, τ)`, 2 channels each, bilinear, texel centres at (i + ½)/size,
//!   clamped in u and v, periodic in τ;
//! - `V_uvt = F_uvt(u, v, τ)`, 4 channels, trilinear, clamped in u and v, periodic in τ;
//! - `γ(τ) = [sin 2πτ, cos 2πτ, sin 4πτ, cos 4πτ]`;
//! - a *gate* per light group that switches the tile's light: [`gate`] of whether the group is on;
//! - input `x = [c(V_uvt), c(V_uv), c(V_ut), c(V_vt), γ, gates]`, of those that the tile has, with
//!   `c(f) = 3 (f − ½)`;
//! - `h₁ = gelu(W₁ x + b₁)`, `h₂ = gelu(W₂ h₁ + b₂)`, `y = W₃ h₂ + b₃`;
//! - irradiance of channel c: `E_c = mean_c(t) · max(y_c, 0)²`, y_c at most 65504 and E_c the largest f32.
//!
//! That is the standard coding; the paper's literal one has another τ, γ and power ([`crate::time::Coding`]),
//! and no gates. Everything that depends only on time (γ and the gates) is folded into the first layer's
//! bias. Feature values lie in [0, 1].

use crate::time::{Axis, Coding};

/// Side of a stored tile in texels.
pub const STORED: usize = 128;
/// Texels on each side of a tile that repeat its neighbours (mirrored at the page's edge): one is what
/// bilinear filtering needs.
pub const BORDER: usize = 1;
/// Side of a tile's payload (without its border), in texels.
pub const PAYLOAD: usize = STORED - 2 * BORDER;
/// Features entering the decoder, at most: V_uvt 4, V_uv 4, V_ut 2, V_vt 2.
pub const FEATURES: usize = 12;
/// Most gates of a tile.
pub const MOST_GATES: usize = 63;
/// Most slices of F_uvt.
const MOST_SLICES: usize = 127;
/// Most rows of F_ut and F_vt.
const MOST_ROWS: usize = 255;
/// Upper clamp of a decoder's output before it is raised to its power: the largest finite f16.
pub(crate) const Y_MAX: f32 = 65504.0;
/// Widths of hidden layers, by their number in a word.
const WIDTHS: [usize; 3] = [16, 64, 32];

/// A gate's input: whether its light group is on.
pub fn gate(on: bool) -> f32 {
    if on { 1.0 } else { -1.0 }
}

/// A named size of the representation (the paper's Table "NDGI profiles").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Profile {
    /// Name on the command line.
    pub name: &'static str,
    /// Side of F_uvt for a full tile.
    pub uvt: usize,
    /// True if it has F_ut and F_vt.
    pub planes: bool,
    /// Width of the two hidden layers.
    pub hidden: usize,
}

/// The paper's profiles, the same with hidden layers of 32, and one without F_ut and F_vt for light that is
/// smooth in time.
pub const PROFILES: [Profile; 8] = [
    Profile::L,
    Profile::M,
    Profile::M_64,
    Profile::H,
    Profile::L_32,
    Profile::M_32,
    Profile::S,
    Profile::S_32,
];

impl Profile {
    /// `L`.
    pub const L: Profile = Profile { name: "L", uvt: 16, planes: true, hidden: 16 };
    /// `M`.
    pub const M: Profile = Profile { name: "M", uvt: 32, planes: true, hidden: 16 };
    /// `M.64`.
    pub const M_64: Profile = Profile { name: "M.64", uvt: 32, planes: true, hidden: 64 };
    /// `H`.
    pub const H: Profile = Profile { name: "H", uvt: 64, planes: true, hidden: 16 };
    /// `L.32`.
    pub const L_32: Profile = Profile { name: "L.32", uvt: 16, planes: true, hidden: 32 };
    /// `M.32`.
    pub const M_32: Profile = Profile { name: "M.32", uvt: 32, planes: true, hidden: 32 };
    /// `S`.
    pub const S: Profile = Profile { name: "S", uvt: 16, planes: false, hidden: 16 };
    /// `S.32`.
    pub const S_32: Profile = Profile { name: "S.32", uvt: 16, planes: false, hidden: 32 };

    /// All maps of the profile, for `distinct` frames that differ and `gates` gates: min(12, ⌈distinct/2⌉)
    /// slices of F_uvt, min(24, distinct) rows of F_ut and F_vt.
    pub fn contents(&self, distinct: usize, gates: usize) -> Contents {
        Contents {
            uv: true,
            uvt: self.uvt,
            slices: distinct.div_ceil(2).min(12),
            ut: self.planes,
            vt: self.planes,
            rows: if self.planes { distinct.min(24) } else { 0 },
            gamma: true,
            gates,
            hidden: self.hidden,
        }
    }
}

/// A tile's configuration: which maps and inputs it has; one word in the bundle's index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contents {
    /// F_uv.
    pub uv: bool,
    /// Side of F_uvt for a full tile: 0 (no F_uvt), 4, 8, 16, 32, 64 or 128.
    pub uvt: usize,
    /// Slices of F_uvt, 1 … 127; 0 without it.
    pub slices: usize,
    /// F_ut.
    pub ut: bool,
    /// F_vt.
    pub vt: bool,
    /// Rows of F_ut and F_vt along τ, 1 … 255; 0 without both.
    pub rows: usize,
    /// γ.
    pub gamma: bool,
    /// Number of gates, at most [`MOST_GATES`].
    pub gates: usize,
    /// Width of the two hidden layers: 16, 32 or 64.
    pub hidden: usize,
}

impl Contents {
    /// No map and no input: only means, and a decoder with 16 hidden units that gives one colour.
    pub const NONE: Contents = Contents {
        uv: false,
        uvt: 0,
        slices: 0,
        ut: false,
        vt: false,
        rows: 0,
        gamma: false,
        gates: 0,
        hidden: 16,
    };

    /// Bits of a word that are not part of the contents; the payload's coding uses them.
    pub const SPARE: u32 = 0b11 << 30;

    /// The contents as a word (FORMAT.md, section 2); `None` for invalid contents.
    pub fn word(&self) -> Option<u32> {
        let side = match self.uvt {
            0 => 0,
            4 | 8 | 16 | 32 | 64 | 128 => self.uvt.ilog2() - 1,
            _ => return None,
        };
        let known = self.slices <= MOST_SLICES
            && self.rows <= MOST_ROWS
            && self.gates <= MOST_GATES
            && (self.uvt > 0) == (self.slices > 0)
            && (self.ut || self.vt) == (self.rows > 0);
        let hidden = WIDTHS.iter().position(|width| *width == self.hidden)? as u32;
        known.then(|| {
            let flags = [self.uv, self.ut, self.vt, self.gamma];
            let flags = (0..).zip(flags).map(|(bit, flag)| u32::from(flag) << bit).sum::<u32>();
            let sizes = (self.slices as u32) << 8 | (self.rows as u32) << 16 | (self.gates as u32) << 24;
            flags | side << 4 | (hidden & 1) << 7 | (hidden >> 1) << 15 | sizes
        })
    }

    /// The contents of a word, ignoring its spare bits; `None` for a word that [`Contents::word`] never
    /// returns.
    pub fn of_word(word: u32) -> Option<Self> {
        let flag = |bit: u32| word >> bit & 1 == 1;
        let byte = |bit: u32| (word >> bit & 0xff) as usize;
        let contents = Contents {
            uv: flag(0),
            uvt: match word >> 4 & 7 {
                0 => 0,
                side => 2 << side,
            },
            slices: byte(8) & MOST_SLICES,
            ut: flag(1),
            vt: flag(2),
            rows: byte(16),
            gamma: flag(3),
            gates: byte(24) & MOST_GATES,
            hidden: *WIDTHS.get(((word >> 7 & 1) | (word >> 15 & 1) << 1) as usize)?,
        };
        (contents.word()? == word & !Self::SPARE).then_some(contents)
    }
}

/// The contents as text, such as `F_uv, F_uvt 32² × 12, γ, 2 gates`.
impl std::fmt::Display for Contents {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let plane = |name: &str| format!("{name} × {}", self.rows);
        let mut parts = Vec::new();
        parts.extend(self.uv.then(|| "F_uv".to_owned()));
        parts.extend((self.uvt > 0).then(|| format!("F_uvt {}² × {}", self.uvt, self.slices)));
        parts.extend(self.ut.then(|| plane("F_ut")));
        parts.extend(self.vt.then(|| plane("F_vt")));
        parts.extend(self.gamma.then(|| "γ".to_owned()));
        parts.extend((self.gates > 0).then(|| match self.gates {
            1 => "1 gate".to_owned(),
            n => format!("{n} gates"),
        }));
        parts.extend((self.hidden != 16).then(|| format!("hidden layers of {}", self.hidden)));
        if parts.is_empty() {
            parts.push("means alone".to_owned());
        }
        f.write_str(&parts.join(", "))
    }
}

/// All sizes of one tile's maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// The tile's contents.
    pub contents: Contents,
    /// Stored texels across, a multiple of 4.
    pub width: usize,
    /// Stored texels down, a multiple of 4.
    pub height: usize,
    /// Frames n.
    pub frames: usize,
    /// Texels of F_ut along u (64 for a full tile); 0 without it.
    pub ut: usize,
    /// Texels of F_vt along v; 0 without it.
    pub vt: usize,
    /// Rows of F_ut and F_vt along τ.
    pub rows: usize,
    /// Width, height of F_uvt (multiples of 4) and its slices; zeros without it.
    pub uvt: [usize; 3],
    /// Width of the hidden layers.
    pub hidden: usize,
    /// True if the tile has its own time axis: with the standard coding.
    pub axis: bool,
}

impl Shape {
    /// The shape of a tile of `width × height` stored texels.
    pub fn new(contents: &Contents, width: usize, height: usize, frames: usize, coding: Coding) -> Self {
        let side = |stored: usize| (stored * contents.uvt).div_ceil(STORED).next_multiple_of(4);
        Shape {
            contents: *contents,
            width,
            height,
            frames,
            ut: if contents.ut { width.div_ceil(2) } else { 0 },
            vt: if contents.vt { height.div_ceil(2) } else { 0 },
            rows: contents.rows,
            uvt: [side(width), side(height), contents.slices],
            hidden: contents.hidden,
            axis: coding == Coding::Standard,
        }
    }

    /// Number of F_uv blocks, F_uvt blocks, F_ut texels, F_vt texels.
    pub fn counts(&self) -> [usize; 4] {
        let [width, height, slices] = self.uvt;
        let blocks = |width: usize, height: usize| (width / 4) * (height / 4);
        [
            if self.contents.uv { blocks(self.width, self.height) } else { 0 },
            blocks(width, height) * slices,
            self.rows * self.ut,
            self.rows * self.vt,
        ]
    }

    /// True if the contents are valid and the sizes match them.
    fn is_known(&self) -> bool {
        let side = |side: usize| (4..=STORED).contains(&side) && side.is_multiple_of(4);
        let coding = if self.axis { Coding::Standard } else { Coding::Paper };
        side(self.width)
            && side(self.height)
            && self.frames > 0
            && self.contents.word().is_some()
            && Shape::new(&self.contents, self.width, self.height, self.frames, coding) == *self
    }

    /// The columns of W₁ of V_uvt, V_uv, V_ut, V_vt, γ and the gates, in this order; empty for what the tile
    /// does not have.
    pub fn columns(&self) -> [std::ops::Range<usize>; 6] {
        let c = &self.contents;
        let lengths = [
            if c.uvt > 0 { 4 } else { 0 },
            if c.uv { 4 } else { 0 },
            if c.ut { 2 } else { 0 },
            if c.vt { 2 } else { 0 },
            if c.gamma { 4 } else { 0 },
            c.gates,
        ];
        let mut end = 0;
        lengths.map(|length| {
            end += length;
            end - length..end
        })
    }

    /// Number of the decoder's inputs: columns of W₁.
    pub fn inputs(&self) -> usize {
        self.columns()[5].end
    }

    /// Number of decoder weights: W₁ b₁ W₂ b₂ W₃ b₃.
    pub fn mlp_len(&self) -> usize {
        self.mlp_lens().iter().sum()
    }

    /// Lengths of W₁ b₁ W₂ b₂ W₃ b₃.
    fn mlp_lens(&self) -> [usize; 6] {
        let h = self.hidden;
        [self.inputs() * h, h, h * h, h, 3 * h, 3]
    }

    /// The parts W₁ b₁ W₂ b₂ W₃ b₃ of a decoder's weights, which are as many as [`Shape::mlp_len`].
    pub fn split_mlp<'a>(&self, mlp: &'a [f32]) -> [&'a [f32]; 6] {
        let mut rest = mlp;
        self.mlp_lens().map(|length| {
            let (part, tail) = rest.split_at(length);
            rest = tail;
            part
        })
    }
}

/// A tile's brightness at one hour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Knot {
    /// Factor of each channel's curve, finite and ≥ 0; exactly 0 decodes to 0.
    pub mean: [f32; 3],
    /// Approximate upper bound of the tile's values, finite and ≥ 0: for output in few bits. Decoding does
    /// not need it.
    pub peak: f32,
    /// Between two frames, the second frame's share of the light, from 0 to 1; 0 at a frame.
    pub share: f32,
}

/// A stored tile: everything a decoder needs.
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
    /// W₁ (`hidden × inputs`, row-major), b₁, W₂ (`hidden × hidden`), b₂, W₃ (`3 × hidden`), b₃.
    pub mlp: Vec<crate::half::F16>,
    /// The tile's brightness at each of [`crate::time::Timeline::knots`].
    pub knots: Vec<Knot>,
    /// The time axis; empty under the paper's coding.
    pub axis: Axis,
    /// The light groups that are gates, strictly ascending.
    pub gates: Vec<u16>,
}

impl TileParams {
    /// Checks that the shape is valid and that every list has the length it gives.
    ///
    /// # Errors
    /// A message that says what differs.
    pub fn check_lengths(&self) -> Result<(), String> {
        let shape = &self.shape;
        if !shape.is_known() {
            return Err(format!("{shape:?}; expected a shape that its contents give"));
        }
        let [uv, uvt, ut, vt] = shape.counts();
        for (what, found, expected) in [
            ("blocks of F_uv", self.f_uv.len(), uv),
            ("blocks of F_uvt", self.f_uvt.len(), uvt),
            ("texels of F_ut", self.f_ut.len(), ut),
            ("texels of F_vt", self.f_vt.len(), vt),
            ("decoder weights", self.mlp.len(), shape.mlp_len()),
            (
                "coordinates on the time axis",
                self.axis.places.len(),
                if shape.axis { shape.frames } else { 0 },
            ),
            ("gates", self.gates.len(), shape.contents.gates),
        ] {
            if found != expected {
                return Err(format!("{found} {what}; expected {expected}"));
            }
        }
        if self.knots.len() < shape.frames {
            return Err(format!(
                "{} knots; expected one for each of {} frames",
                self.knots.len(),
                shape.frames
            ));
        }
        Ok(())
    }

    /// The input of each gate, given the states of the light groups; a missing group is off.
    pub fn gate_inputs<'a>(&'a self, state: &'a [bool]) -> impl Iterator<Item = f32> + 'a {
        self.gates.iter().map(|&group| gate(state.get(usize::from(group)).copied().unwrap_or(false)))
    }
}

/// Beyond ±this, [`gelu`]'s factor is exactly 1 or 0.
pub const GELU_BOUND: f32 = 9.0 / 4.0;

/// Coefficients of P in [`gelu`], constant term first: those with which y P(y²) is ½ and flat at y =
/// [`GELU_BOUND`], so that the function and its derivative are continuous.
pub const GELU_COEFFICIENTS: [f32; 2] = [1.0 / 3.0, -16.0 / 729.0];

/// The activation: `x · (½ + y P(y²))` with y = x clamped to ±[`GELU_BOUND`]. It is GELU, `x · Φ(x)` (Φ the
/// normal distribution function), but for 0.031, at 6 operations; at 10, within 5e-4 of it, decoders are
/// better by 0.1 dB at most and a sixth slower.
#[inline(always)]
pub fn gelu(x: f32) -> f32 {
    let y = x.clamp(-GELU_BOUND, GELU_BOUND);
    let [p0, p1] = GELU_COEFFICIENTS;
    x * (0.5 + y * (p1 * (y * y) + p0))
}

/// How bright a tile is, known without reading it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Brightness {
    /// Per knot, the light of what is not apart.
    pub knots: Vec<Knot>,
    /// Per light group that is apart, in their order, its light when it is on; without a share.
    pub lamps: Vec<Knot>,
}

/// A section of a tile, encoded.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Section {
    /// Its word in the index; for features, [`Contents::word`] and which maps omit grey blocks.
    pub word: u32,
    /// The bytes, a multiple of 16; empty if the tile has no such section.
    pub bytes: Vec<u8>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Φ(x) = ½ + φ(x) (x + x³/3 + x⁵/15 + …) (Abramowitz and Stegun 26.2.11), to double precision for |x|
    /// < 8.
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
    fn gelu_is_close_to_the_exact_one_and_smooth() {
        let mut worst = 0.0f64;
        for i in (-16_000..=16_000).filter(|i| *i != 0) {
            let x = f64::from(i) / 2000.0;
            let cdf = normal_distribution(x);
            worst = worst.max((f64::from(gelu(x as f32)) - x * cdf).abs());
        }
        assert!((0.030..0.0315).contains(&worst), "{worst}");
        assert_eq!(gelu(0.0), 0.0);
        assert!((gelu(50.0) - 50.0).abs() < 1e-4 && gelu(-50.0).abs() < 1e-4);
        // Flat factor at the bound: no kink.
        let slope = |x: f32| (gelu(x + 1e-2) - gelu(x - 1e-2)) / 2e-2;
        assert!((slope(GELU_BOUND) - 1.0).abs() < 0.02 && slope(-GELU_BOUND).abs() < 0.02);
    }
}
