//! The compute shader: its text, `decode.wgsl`, with the network of a width and precision unrolled, and the
//! job that it reads for a tile.

use bytemuck::{Pod, Zeroable};
use std::fmt::Write;

/// The shader with its places still empty.
const TEMPLATE: &str = include_str!("decode.wgsl");
/// Rows of texels that a workgroup decodes.
pub(crate) const STRIP: usize = 4;
/// Columns, one a thread: the stored texels of a whole tile.
const COLUMNS: usize = 128;

/// Texels of F_uvt that a strip reads where that is as large as the tile.
const MOST_COARSE: usize = (STRIP + 1) * COLUMNS;

// What a job has, as the shader knows it.
pub(crate) const HAS_MAPS: u32 = 1;
pub(crate) const HAS_UVT: u32 = 2;
pub(crate) const HAS_UV: u32 = 4;
pub(crate) const HAS_UT: u32 = 8;
pub(crate) const HAS_VT: u32 = 16;
pub(crate) const HAS_SUN: u32 = 32;
pub(crate) const HAS_COLOUR: u32 = 64;
pub(crate) const HAS_WORDS: u32 = 128;

/// `Job` of the shader but for its biases, field by field.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub(crate) struct Job {
    pub size: [u32; 2],
    pub has: u32,
    pub weights: u32,
    pub own: [u32; 4],
    pub to: [i32; 2],
    pub share_of_slice: f32,
    pub share_of_row: f32,
    pub uv: [u32; 4],
    pub first: [u32; 4],
    pub second: [u32; 4],
    pub uvt: [u32; 2],
    pub ut: [u32; 2],
    pub vt: [u32; 2],
    pub sides: [u32; 2],
    pub mean: [f32; 4],
    pub direction: [f32; 4],
    pub irradiance: [f32; 4],
    pub seen: [u32; 4],
    pub normals: [u32; 4],
}

/// The precision of the network. Features, light and the sun are always in single precision.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Precision {
    /// 32-bit floats.
    #[default]
    Single,
    /// 16-bit floats (`shader-f16`): about a thousandth of the light off.
    Half,
}

/// What is written to the target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Output {
    /// E × exposure, as 16-bit floats; what is above 65504 is cut. An exposure of 256, which the material
    /// divides by, reaches 255 kilolux (twice full daylight) and holds 11 bits down to a quarter of a
    /// millilux. Lux (1000) cut daylight at 65.5 kilolux; kilolux (1) lose bits below 61 millilux.
    Rgba16Float,
    /// E × exposure, as 32-bit floats.
    Rgba32Float,
    /// √(E × exposure), cut at 1, in 8 bits: an exposure of 1/peak.
    Rgba8Unorm,
}

impl Output {
    fn name(self) -> &'static str {
        match self {
            Output::Rgba16Float => "rgba16float",
            Output::Rgba32Float => "rgba32float",
            Output::Rgba8Unorm => "rgba8unorm",
        }
    }

    /// What is stored of `exposed`.
    fn stored(self) -> &'static str {
        match self {
            Output::Rgba16Float => "min(exposed, vec3(NOT_LARGER))",
            Output::Rgba32Float => "min(exposed, vec3(LARGEST))",
            Output::Rgba8Unorm => "sqrt(clamp(exposed, vec3(0.0), vec3(1.0)))",
        }
    }
}

/// A shader.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Shader {
    /// Width of the hidden layers: 16, 32 or 64; 0 for a shader of tiles that have the sun alone.
    pub hidden: usize,
    /// Precision of the network.
    pub precision: Precision,
    /// What is written.
    pub output: Output,
    /// Most texels of F_uvt that a strip reads: [`coarse`] of the widest tile.
    pub coarse: usize,
    /// Memory of a workgroup in bytes that the device has: weights that do not fit are read where they lie.
    pub shared: usize,
}

/// Most texels of an F_uvt slice that a strip reads, rounded up to a power of two (at least 64, and at most
/// the 640 that there can be). `uvt`: the slice's size; `height`: the tile's stored height. The shader reads
/// no more rows than fit, whatever rounding says.
pub fn coarse(uvt: [usize; 2], height: usize) -> usize {
    // From the row above the first texel to that below the last.
    let rows = (STRIP - 1) as f64 * uvt[1] as f64 / height.max(1) as f64;
    // One of few sizes: each is a shader.
    (uvt[0] * (rows.ceil() as usize + 2).min(uvt[1])).next_power_of_two().clamp(64, MOST_COARSE)
}

/// Words of a tile's weights in the resident buffer.
pub(crate) fn words(hidden: usize) -> usize {
    8 * matrices(hidden) + 2 * biases(hidden)
}

/// Matrices of 4×4 weights: of three groups of four inputs to every unit, of every unit to every unit, and of
/// every unit to the output.
pub(crate) fn matrices(hidden: usize) -> usize {
    let h = hidden / 4;
    3 * h + h * h + h
}

/// Vectors of four biases: of the second layer, and of the third.
fn biases(hidden: usize) -> usize {
    hidden / 4 + 1
}

impl Shader {
    /// Texels of a column that a thread decodes at once: weights are read once for all of them, so far as
    /// registers go.
    fn texels(&self) -> usize {
        64usize.checked_div(self.hidden).map_or(STRIP, |texels| STRIP.min(texels))
    }

    /// Whether a workgroup copies the weights into its memory.
    fn shares_weights(&self) -> bool {
        let scalar = if self.precision == Precision::Half { 2 } else { 4 };
        let rest = 4 * scalar * biases(self.hidden) + 16 * self.coarse.max(1) + 8 * STRIP;
        self.hidden > 0 && 16 * scalar * matrices(self.hidden) + rest <= self.shared
    }

    /// The shader in WGSL.
    pub fn wgsl(&self) -> String {
        let (h, scalar) = (self.hidden / 4, if self.precision == Precision::Half { "f16" } else { "f32" });
        let mut header = String::new();
        if self.precision == Precision::Half {
            header += "enable f16;\n";
        }
        let _ = write!(
            header,
            "alias Scalar = {scalar};\nalias Vec = vec4<{scalar}>;\nalias Mat = mat4x4<{scalar}>;\n\
             const H: u32 = {h}u;         // vectors of four units of a hidden layer\n\
             const MATRICES: u32 = {}u;\nconst BIASES: u32 = {}u;\n\
             const STRIP: u32 = {STRIP}u;     // rows of texels of a workgroup\n\
             const TEXELS: u32 = {}u;    // of them at once in a thread\n\
             const COARSE: u32 = {}u;",
            matrices(self.hidden),
            biases(self.hidden),
            self.texels(),
            self.coarse.max(1),
        );
        let shares = self.shares_weights();
        let shared = if shares { "var<workgroup> net: array<Mat, MATRICES>;" } else { "" };
        let load = if shares {
            format!("for (var i = x; i < MATRICES; i += {COLUMNS}u) {{ net[i] = matrix(weights + 8u * i); }}")
        } else {
            String::new()
        };
        let mut text = String::new();
        // An array of no biases there cannot be.
        let is_omitted = |line: &str| line.starts_with("//$") || h == 0 && line.trim().starts_with("bias:");
        for line in TEMPLATE.lines().filter(|line| !is_omitted(line)) {
            let indent = line.len() - line.trim_start().len();
            match line.trim() {
                "$HEADER" => text += &header,
                "$SHARED" => text += shared,
                "$LOAD" => text += &format!("{:indent$}{load}", ""),
                "$NETWORK" if h == 0 => {}
                "$NETWORK" => {
                    let network = self.network();
                    let lines: Vec<String> =
                        network.lines().map(|line| format!("{:indent$}{line}", "")).collect();
                    text += &lines.join("\n");
                }
                _ => {
                    text +=
                        &line.replace("$STORED", self.output.stored()).replace("$FORMAT", self.output.name());
                }
            }
            text.push('\n');
        }
        text
    }

    /// The layers, for the texels of a thread: `a` are features, `h` units of the first layer, `s` four of
    /// the second, `o` the output.
    fn network(&self) -> String {
        let (h, texels) = (self.hidden / 4, self.texels());
        let weight = |i: &str| match self.shares_weights() {
            true => format!("net[{i}]"),
            false => format!("matrix(weights + 8u * ({i}))"),
        };
        let mut lines = Vec::new();
        for t in 0..texels {
            lines.push(format!("let y{t} = min(row + {t}u, end - 1u);"));
            lines.extend((0..h).map(|j| format!("var h{j}_{t} = Vec(jobs[j].bias[{j}]);")));
        }
        let of_uvt = "centred(between(vec2(along, place(Y, size.y, uvt.y)), uvt, top, bottom))";
        let of_uv = "centred(textureLoad(maps, jobs[j].uv.xy + vec2(x, Y), jobs[j].uv.z, 0))";
        let of_planes = "centred(vec4(ut, of_vt[Y - start]))";
        let groups = [("HAS_UVT", of_uvt), ("HAS_UV", of_uv), ("(HAS_UT | HAS_VT)", of_planes)];
        for (group, (flag, feature)) in groups.into_iter().enumerate() {
            lines.push(format!("if ((has & {flag}) != 0u) {{"));
            for t in 0..texels {
                lines.push(format!("    let a{t} = {};", feature.replace('Y', &format!("y{t}"))));
            }
            for j in 0..h {
                lines.push(format!("    {{ let w = {};", weight(&format!("{}u", group * h + j))));
                lines.extend((0..texels).map(|t| format!("    h{j}_{t} += w * a{t};")));
                lines.push("    }".to_owned());
            }
            lines.push("}".to_owned());
        }
        for t in 0..texels {
            lines.extend((0..h).map(|j| format!("h{j}_{t} = gelu(h{j}_{t});")));
            lines.push(format!("var o{t} = vec3<f32>(biases[{h}].xyz);"));
        }
        // Four units of the second layer at a time, which go into the output at once.
        lines.push("for (var unit = 0u; unit < H; unit++) {".to_owned());
        lines.extend((0..texels).map(|t| format!("    var s{t} = biases[unit];")));
        for k in 0..h {
            lines.push(format!("    {{ let w = {};", weight(&format!("{}u + unit * H", 3 * h + k))));
            lines.extend((0..texels).map(|t| format!("    s{t} += w * h{k}_{t};")));
            lines.push("    }".to_owned());
        }
        lines.push(format!("    let w = {};", weight(&format!("{}u + unit", 3 * h + h * h))));
        lines.extend((0..texels).map(|t| format!("    o{t} += vec3<f32>((w * gelu(s{t})).xyz);")));
        lines.push("}".to_owned());
        lines.extend((0..texels).map(|t| format!("e[{t}] = light(j, o{t});")));
        lines.join("\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `place` of the shader, in its precision.
    fn place(i: usize, side: usize, n: usize) -> f32 {
        ((i as f32 + 0.5) / side as f32 * n as f32 - 0.5).clamp(0.0, (n - 1) as f32)
    }

    #[test]
    fn the_rows_of_every_map_fit_and_none_that_counts_is_omitted() {
        let mut too_many = 0;
        for side in [4, 8, 16, 32, 64, 128] {
            let stored = |a: usize| 4 * (a * side).div_ceil(128).div_ceil(4);
            for (width, height) in
                (4..=128).step_by(4).flat_map(|w| (4..=128).step_by(4).map(move |h| (w, h)))
            {
                let uvt = [stored(width), stored(height)];
                let rows = coarse(uvt, height) / uvt[0];
                for start in (0..height).step_by(STRIP) {
                    let places = [start, (start + STRIP).min(height) - 1].map(|y| place(y, height, uvt[1]));
                    let bottom = (places[1] as usize + 1).min(uvt[1] - 1);
                    let top = places[0] as usize;
                    if bottom + 1 - top > rows {
                        // All of the first texel is in the row below.
                        assert!(
                            bottom - top == rows && 1.0 - places[0].fract() < 2e-5,
                            "{uvt:?} of {height}"
                        );
                        too_many += 1;
                    }
                }
            }
        }
        assert!(too_many > 0);
    }
}
